"""Selection of EGL, the only GL library that renders on Linux without a screen.

MuJoCo chooses its GL library when it is imported, so this module is imported before it.
"""

from __future__ import annotations

import os
import sys

if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")
