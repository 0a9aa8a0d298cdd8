"""Every example in a docstring runs and prints what it shows: `make test-docs`."""

import doctest
import importlib

import pytest
from page_blocks import ROOT

FOLDERS = ("mlivr_gym", "planners", "agents")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def runs(text):
    """Whether a source has an example that is not marked to be skipped."""
    return any(">>> " in line and "+SKIP" not in line for line in text.splitlines())


def modules():
    """Names of the modules with an example that runs."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            inside = path.relative_to(ROOT).with_suffix("").parts
            linked = inside[:2] in {("mlivr_gym", name) for name in FOLDERS}
            if not linked and runs(path.read_text(encoding="utf-8")):
                package = () if folder == "mlivr_gym" else ("mlivr_gym",)
                yield ".".join((*package, *inside))


@pytest.mark.docs
@pytest.mark.parametrize("name", list(modules()))
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failed, count = doctest.testmod(importlib.import_module(name), optionflags=FLAGS)
    assert count
    assert not failed
