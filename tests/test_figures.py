"""Pages that carry figures say what the results say."""

import importlib
import re
import sys
from pathlib import Path

import pytest

EXPERIMENTS = Path(__file__).parent.parent / "experiments"


@pytest.fixture(scope="module")
def pages():
    sys.path.insert(0, str(EXPERIMENTS))
    try:
        import readme

        yield readme
    finally:
        sys.path.remove(str(EXPERIMENTS))


@pytest.fixture(scope="module")
def told(pages):
    """What the results say, by part."""
    return pages.parts(pages.ROOT / "results")


@pytest.mark.parametrize("script", sorted(path.stem for path in EXPERIMENTS.glob("*.py")))
def test_every_experiment_is_of_this_version_of_the_package(pages, script, monkeypatch):
    """What it imports is there; `import` runs no experiment."""
    monkeypatch.setattr(sys, "argv", [script])
    importlib.import_module(script)


def test_readme_and_reports_say_what_the_results_say(pages, told, monkeypatch):
    """If this fails, run `python experiments/readme.py`."""
    monkeypatch.setattr(pages, "parts", lambda _: told)
    assert pages.stale() == []


def test_a_figure_that_was_typed_is_noticed(pages, told):
    for page, mark in (
        ("README.md", "<!-- paper -->\n"),
        ("docs/results.md", "<!-- table1 -->\n"),
        ("docs/formats.md", "<!-- fields_map -->\n"),
    ):
        text = (pages.ROOT / page).read_text(encoding="utf-8")
        assert pages.filled(text, told) == text
        typed = text.replace(mark, f"{mark}| 1 | typed | 42 |\n")
        assert typed != text
        assert pages.filled(typed, told) == text


def test_every_part_is_shown_and_every_mark_is_of_a_part(pages, told):
    """A mark that lost its end, or its part, would never be filled again."""
    texts = [page.read_text(encoding="utf-8") for page in pages.pages()]
    begun = [name for text in texts for name in re.findall(r"<!-- end of (\w+) -->", text)]
    shown = [match[1] for text in texts for match in pages.MARK.finditer(text)]
    assert sorted(begun) == sorted(shown) == sorted(told)
