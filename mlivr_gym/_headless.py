"""Without a screen only EGL can render.

MuJoCo chooses its GL library when it is imported, so this is set before anything imports it.
"""

from __future__ import annotations

import os
import sys

if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")
