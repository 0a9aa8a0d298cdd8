"""Machine code and tables of tests stay out of the user's cache; import this before the package."""

import os
import tempfile
from pathlib import Path

KEPT = Path(tempfile.gettempdir()) / f"mlivr-gym-tests-{getattr(os, 'getuid', int)()}"
"""One place for all runs, since compiling takes most of a minute."""

os.environ.setdefault("MLIVR_GYM_CACHE", str(KEPT / "cache"))
os.environ["XDG_CACHE_HOME"] = str(KEPT / "user")
