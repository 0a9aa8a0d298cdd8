"""What is compiled at this moment, told on the terminal and to lines of progress."""

from __future__ import annotations

import sys
import time
from typing import Any

from numba.core import event

TOLD_AFTER = 0.5
"""Time of compilation after which it is told [s]."""

displays: list[object] = []
"""Lines of progress on the terminal, which tell what is compiled themselves."""


class Compilation(event.Listener):
    """The functions that Numba compiles now, the outermost first.

    Attributes
    ----------
    seconds
        Time in which functions of this package were compiled so far [s].
    """

    def __init__(self) -> None:
        """Start with nothing compiled."""
        self.names: list[str] = []
        self._began = self.seconds = 0.0
        self._is_announced = self._has_line = False

    @property
    def text(self) -> str:
        """What is compiled now, empty if nothing of this package is."""
        names = self.names[:1]  # another thread may change them
        return f"compiling {names[0]}" if names and names[0] else ""

    def on_start(self, event: Any) -> None:
        """Note a function whose compilation starts."""
        function = event.data["dispatcher"].py_func
        if not self.names:
            self._began = time.perf_counter()
        is_ours = function.__module__.startswith("mlivr_gym.")
        self.names.append(function.__qualname__ if is_ours else "")
        self._tell()

    def on_end(self, event: Any) -> None:
        """Note a function that was compiled."""
        self._tell()
        if len(self.names) == 1 and self.text:
            self.seconds += time.perf_counter() - self._began
        self.names.pop()
        if self._has_line and not self.names:
            self._has_line = False
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def _tell(self) -> None:
        """Tell once that the package is compiled, and on a terminal what."""
        now = time.perf_counter() - self._began
        if not self.text or self.seconds + now < TOLD_AFTER:
            return
        is_terminal = sys.stderr.isatty()
        clear = "\r\033[K" if is_terminal else ""
        if not self._is_announced:
            self._is_announced = True
            print(
                f"{clear}mlivr-gym: compiling for this machine, once for this version, which may "
                "take a minute",
                file=sys.stderr,
                flush=True,
            )
        if is_terminal and not displays:
            self._has_line = True
            print(f"{clear}{self.text}, {now:.0f} s", end="", file=sys.stderr, flush=True)


compilation = Compilation()
"""What this process compiles; `kernels` registers it."""
