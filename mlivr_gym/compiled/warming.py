"""What happens on the first use of an installation: kernels are compiled, and a bar is shown.

The steps' kernels are compiled by a second process beside the stance set's.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core import event

from mlivr_gym.compiled.cache import kernel_folder
from mlivr_gym.compiled.ready_made import why_compiled

EXPECTED = 260
"""Functions that both processes compile together, about; only the bar depends on it."""

PATIENCE = 0.5
"""Time after which a bar is shown [s]."""

WAIT = 180.0
"""How long the second process may take [s]; then its kernels are compiled here."""

QUIET = "MLIVR_GYM_COMPILING"
"""Environment variable that is set in the second process."""


_asked: set[Path] = set()
"""Marks that this process has looked for: it compiles nothing a second time."""

_showing: list[object] = []
"""The bar that is drawn on the terminal now, if there is one."""


def is_showing() -> bool:
    """Whether a bar is drawn on the terminal now, so that nothing else should be."""
    return bool(_showing)


def mark_of(source: Path) -> Path:
    """The mark that all is compiled: one for each state of a source and of what it imports."""
    return kernel_folder(str(source)) / "compiled"


class _Bar(event.Listener):
    """A line on the terminal, and a bar that counts compiled functions."""

    def __init__(self, why: str) -> None:
        """Start with none; why there are any is told when the bar is."""
        self.why = why
        self.done, self._began, self._shown = 0, time.perf_counter(), -1
        self._told = False

    def on_start(self, event: Any) -> None:
        """A function is about to be compiled."""

    def on_end(self, event: Any) -> None:
        """A function was compiled."""
        self.count(1)

    def count(self, more: int) -> None:
        """Count some more."""
        self.done += more
        if time.perf_counter() - self._began < PATIENCE:
            return
        if not self._told:
            self._told = True
            print(
                "mlivr-gym: compiling for this machine, once for this version; "
                f"ready-made machine code is not used: {self.why}",
                file=sys.stderr,
                flush=True,
            )
        filled = min(30 * self.done // EXPECTED, 29)
        if sys.stderr.isatty() and filled != self._shown:
            if self not in _showing:
                _showing.append(self)
            self._shown = filled
            spent = time.perf_counter() - self._began
            bar = "#" * filled + "." * (30 - filled)
            print(f"\r[{bar}] {spent:.0f} s", end="", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Clear the bar."""
        if self._shown >= 0:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
            _showing.remove(self)


@contextmanager
def warming(module: str, mark: Path) -> Iterator[None]:
    """Run the block, in which kernels may have to be compiled.

    Where that was not done yet and they are not ready-made, `python -m module` is run beside the
    block to compile others, and waited for; progress is shown.

    Parameters
    ----------
    module
        What compiles the others.
    mark
        A file that is made when all is compiled, see `mark_of`.
    """
    if os.environ.get(QUIET) or mark in _asked or mark.exists():
        yield
        return
    _asked.add(mark)
    why = why_compiled(mark.parent.name)
    if not why:
        yield
        return
    bar = _Bar(why)
    with event.install_listener("numba:compile", bar):
        process = _second(module, bar)
        try:
            yield
        except BaseException:
            # An error or an interruption is not to wait for what nobody will call.
            if process is not None:
                _stop(process)
            raise
        else:
            _wait(process, mark)
        finally:
            bar.close()


def _second(module: str, bar: _Bar) -> subprocess.Popen[bytes] | None:
    """Start the second process, if there is a processor for it; what it compiles is counted."""
    if (os.cpu_count() or 1) < 2 or not sys.executable:
        return None
    try:
        process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-m", module],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {QUIET: "1"},
        )
    except OSError:
        return None

    def listen() -> None:
        assert process.stdout is not None
        while more := os.read(process.stdout.fileno(), 64):
            bar.count(len(more))

    threading.Thread(target=listen, daemon=True, name=f"compiling-{process.pid}").start()
    return process


def _wait(process: subprocess.Popen[bytes] | None, mark: Path) -> None:
    """Wait for the second process, and mark that all is compiled."""
    if process is None:
        return
    try:
        if process.wait(timeout=WAIT) == 0:
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.touch()
    except subprocess.TimeoutExpired:
        pass
    except OSError:
        return
    finally:
        _stop(process)


def _stop(process: subprocess.Popen[bytes]) -> None:
    """End a process, if it runs, and close its pipe when all was read."""
    process.kill()
    process.wait()
    for thread in threading.enumerate():
        if thread.name == f"compiling-{process.pid}":
            thread.join()
    if process.stdout is not None:
        process.stdout.close()


class _Reporter(event.Listener):
    """Writes a byte for each function that was compiled, for the first process to count."""

    def on_start(self, event: Any) -> None:
        """A function is about to be compiled."""

    def on_end(self, event: Any) -> None:
        """A function was compiled."""
        os.write(1, b".")


@contextmanager
def reporting() -> Iterator[None]:
    """Report to the first process what is compiled in the block."""
    with event.install_listener("numba:compile", _Reporter()):
        yield
