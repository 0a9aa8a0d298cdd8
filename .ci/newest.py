"""Print the path of the newest Python on this machine that is newer than the one that runs this.

Looked for are `python3.*` on the path and the versions of pyenv. Nothing is printed if there is
none.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

TOLD = "import sys; print(*sys.version_info[:3], sys.version_info.releaselevel)"
"""Program that prints the version of a Python."""


def version(python: str) -> tuple[int, ...]:
    """Return the version of a Python, empty if it does not run or is no release."""
    done = subprocess.run([python, "-c", TOLD], capture_output=True, text=True, check=False)
    *numbers, level = done.stdout.split() or [""]
    return tuple(map(int, numbers)) if level == "final" else ()


def newest(after: tuple[int, int]) -> str | None:
    """Return the newest Python whose minor version is later than `after`, or None."""
    versions = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    found = [str(path) for path in versions.glob("3.*/bin/python")]
    found += filter(None, (shutil.which(f"python3.{minor}") for minor in range(after[1] + 1, 30)))
    known = {python: version(python) for python in found}
    later = [python for python, numbers in known.items() if numbers[:2] > after]
    return max(later, key=known.__getitem__, default=None)


if __name__ == "__main__":
    print(newest(sys.version_info[:2]) or "")
