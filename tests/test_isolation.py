"""Tests keep out of the user's cache."""

import sys
from pathlib import Path

from cache_of_tests import KEPT

from mlivr_gym.compiled import cache


def test_caches_lie_outside_the_home_of_the_user():
    """The folder that would be the user's is a temporary one; that stays empty too."""
    folder, theirs = cache.cache_folder(), Path.home() / ".cache" / "mlivr-gym"
    assert folder is None or theirs.resolve() not in (folder.resolve(), *folder.resolve().parents)
    if sys.platform.startswith("linux"):
        assert cache._default_folder().is_relative_to(KEPT)
