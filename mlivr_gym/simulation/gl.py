"""MuJoCo, which loads the GL library that `MUJOCO_GL` names when it is imported.

Whatever needs it imports it from here: a `SettingError` where that variable has none of its values,
a `RenderError` where the library cannot be loaded.
"""

from __future__ import annotations

import gc
import os
import sys

from mlivr_gym.errors import RenderError, SettingError
from mlivr_gym.schema import Choice, FieldPath

__all__ = ["mujoco", "no_gl"]

BACKENDS = ("egl", "osmesa", "glfw", "disable")
"""Values of `MUJOCO_GL`: without a screen, in software, with one, and for simulations alone."""

ALIASES = {"", "glx", "wgl", "cgl", "enable", "enabled", "on", "true", "1"} | {
    "disabled", "off", "false", "0",
}  # fmt: skip
"""Further ones that MuJoCo knows."""


def no_gl(error: Exception) -> RenderError:
    """What to say where no picture can be rendered, from the loader's error."""
    backend = os.environ.get("MUJOCO_GL", "default")
    message = (
        f"MuJoCo cannot render with MUJOCO_GL={backend!r} ({type(error).__name__}: {error}); "
        f"install an EGL library (Debian: libegl1) or set MUJOCO_GL to 'egl', 'osmesa' or 'glfw' "
        f"before MuJoCo is imported, or to 'disable' for simulations without pictures"
    )
    _forget(error)
    return RenderError(message)


def _forget(error: BaseException) -> None:
    """Release what remains of a failed GL context; its clean-up would print a traceback later."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    while error.__context__ is not None:
        error.__traceback__, error = None, error.__context__
    error.__traceback__ = None
    gc.collect()
    sys.unraisablehook = hook


_backend = os.environ.get("MUJOCO_GL", "").lower().strip()
if _backend not in ALIASES:
    Choice(BACKENDS).read(_backend, FieldPath("MUJOCO_GL", SettingError))
try:
    import mujoco
except Exception as error:  # GL loaders raise errors of many kinds
    raise no_gl(error) from None
