"""Tests that render, on machines that cannot."""

from contextlib import contextmanager

import pytest

from mlivr_gym.errors import RenderError


@contextmanager
def gl_or_skip():
    """Skip a test where there is no GL library; another fault in rendering is one."""
    try:
        yield
    except RenderError as error:
        if "MUJOCO_GL" not in str(error):
            raise
        pytest.skip("no GL library")
