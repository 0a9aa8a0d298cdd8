"""The import of MuJoCo, which loads the GL library that the variable `MUJOCO_GL` names.

All modules import MuJoCo from here. Without a library that can be loaded, or with an invalid value
of the variable, scenes are compiled and simulated, and renderers raise `render_error`.
"""

from __future__ import annotations

import gc
import os
import sys

from mlivr_gym.errors import RenderError

__all__ = ["forget_context", "mujoco", "render_error"]


def render_error(error: Exception) -> RenderError:
    """Return the error for a GL library that cannot be loaded, from the loader's own error.

    `error` is that of a renderer; if MuJoCo was imported without the library, its reason counts.
    """
    error = _fault or error
    backend = os.environ.get("MUJOCO_GL", "default")
    message = (
        f"MuJoCo cannot render with MUJOCO_GL={backend!r} ({type(error).__name__}: {error}); "
        f"install an EGL library (Debian: libegl1) or set MUJOCO_GL to 'egl', 'osmesa' or 'glfw' "
        f"before MuJoCo is imported, or to 'disable' for simulations without pictures"
    )
    forget_context(error)
    return RenderError(message)


def forget_context(error: BaseException) -> None:
    """Release the GL context that was being opened when an error or an interruption occurred.

    Its traceback keeps the context until the interpreter exits, when EGL is closed already and the
    clean-up prints another traceback.
    """
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    while error.__context__ is not None:
        error.__traceback__, error = None, error.__context__
    error.__traceback__ = None
    gc.collect()
    sys.unraisablehook = hook


_fault: Exception | None = None
try:
    import mujoco
except Exception as error:  # GL loaders raise errors of many kinds
    _fault, given = error, os.environ.get("MUJOCO_GL", "")
    os.environ["MUJOCO_GL"] = "disable"
    import mujoco

    os.environ["MUJOCO_GL"] = given
