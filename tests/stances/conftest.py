"""Fixtures of the tests of tables."""

from collections import OrderedDict

import pytest

from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.stances import table_files


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A cache folder without tables, and none in memory."""
    (tmp_path / "cache").mkdir()
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    return tmp_path / "cache"
