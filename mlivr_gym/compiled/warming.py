"""Compilation on the first use of an installation, in two processes, with a progress bar.

A second process compiles the kernels that check steps while this one compiles those of stances.
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
"""Approximate number of functions that both processes compile, which only scales the bar."""

BAR_DELAY = 0.5
"""Time after which the bar is shown [s]."""

WAIT = 180.0
"""Maximum time to wait for the second process [s]; its kernels are compiled here after that."""

IN_SECOND_PROCESS = "MLIVR_GYM_COMPILING"
"""Environment variable that is set in the second process."""


_checked: set[Path] = set()
"""Marks that this process has checked already, since it compiles nothing a second time."""

_showing: list[object] = []
"""The bar that is on the terminal now, if any."""


def is_showing() -> bool:
    """Return whether a bar is on the terminal now, so that nothing else should be drawn there."""
    return bool(_showing)


def mark_of(source: Path) -> Path:
    """Return the file that marks that all kernels of a source and its imports are compiled.

    There is one for each state of these files.
    """
    return kernel_folder(str(source)) / "compiled"


class _CompilationBar(event.Listener):
    """A line on the terminal, and a bar that counts compiled functions."""

    def __init__(self, why: str) -> None:
        """Start at zero; `why` is the reason for compiling, which is shown with the bar."""
        self.why = why
        self.done, self._began, self._shown = 0, time.perf_counter(), -1
        self._announced = False

    def on_start(self, event: Any) -> None:
        """Do nothing when the compilation of a function starts."""

    def on_end(self, event: Any) -> None:
        """Count a function that was compiled."""
        self.count(1)

    def count(self, more: int) -> None:
        """Count compiled functions, and draw the bar."""
        self.done += more
        if time.perf_counter() - self._began < BAR_DELAY:
            return
        if not self._announced:
            self._announced = True
            print(
                "mlivr-gym: compiling for this machine, once for this version; "
                f"the machine code in the package is not used: {self.why}",
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

    If they are neither compiled nor in the archive of the package, `python -m module` compiles
    others at the same time and is waited for, and a bar shows the progress. The file `mark` marks
    that all is compiled, see `mark_of`.
    """
    if os.environ.get(IN_SECOND_PROCESS) or mark in _checked or mark.exists():
        yield
        return
    _checked.add(mark)
    why = why_compiled(mark.parent.name)
    if not why:
        yield
        return
    bar = _CompilationBar(why)
    with event.install_listener("numba:compile", bar):
        process = _second(module, bar)
        try:
            yield
        except BaseException:
            # On an error or an interruption, do not wait for kernels that nothing will call.
            if process is not None:
                _stop(process)
            raise
        else:
            _wait(process, mark)
        finally:
            bar.close()


def _second(module: str, bar: _CompilationBar) -> subprocess.Popen[bytes] | None:
    """Start the second process if a processor is free for it, and count what it compiles."""
    if (os.cpu_count() or 1) < 2 or not sys.executable:
        return None
    try:
        process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-m", module],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {IN_SECOND_PROCESS: "1"},
        )
    except OSError:
        return None

    def listen() -> None:
        """Count the bytes that the second process writes, one for each function."""
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
    """End a process if it is running, and close its pipe once all is read."""
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
        """Do nothing when the compilation of a function starts."""

    def on_end(self, event: Any) -> None:
        """Write a byte for a function that was compiled."""
        os.write(1, b".")


@contextmanager
def reporting() -> Iterator[None]:
    """Report to the first process each function that is compiled in the block."""
    with event.install_listener("numba:compile", _Reporter()):
        yield
