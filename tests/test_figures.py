"""Pages that carry figures say what the results say."""

import importlib
import re
import sys

import pytest
import readme

EXPERIMENTS = sorted(path.stem for path in (readme.ROOT / "experiments").glob("*.py"))


@pytest.fixture(scope="module")
def told():
    """What the results say, by part."""
    return readme.parts(readme.ROOT / "results")


@pytest.mark.parametrize("script", EXPERIMENTS)
def test_every_experiment_is_of_this_version_of_the_package(script, monkeypatch):
    """What it imports is there; `import` runs no experiment."""
    monkeypatch.setattr(sys, "argv", [script])
    importlib.import_module(script)


def test_readme_and_reports_say_what_the_results_say(told, monkeypatch):
    """If this fails, run `python experiments/readme.py`."""
    monkeypatch.setattr(readme, "parts", lambda _: told)
    assert readme.stale() == []


def test_a_figure_that_was_typed_is_noticed(told):
    for page, mark in (
        ("README.md", "<!-- paper -->\n"),
        ("docs/results.md", "<!-- table1 -->\n"),
        ("docs/formats.md", "<!-- fields_map -->\n"),
    ):
        text = (readme.ROOT / page).read_text(encoding="utf-8")
        assert readme.filled(text, told) == text
        typed = text.replace(mark, f"{mark}| 1 | typed | 42 |\n")
        assert typed != text
        assert readme.filled(typed, told) == text


def test_every_part_is_shown_and_every_mark_is_of_a_part(told):
    """A mark that lost its end, or its part, would never be filled again."""
    texts = [page.read_text(encoding="utf-8") for page in readme.pages()]
    begun = [name for text in texts for name in re.findall(r"<!-- end of (\w+) -->", text)]
    shown = [match[1] for text in texts for match in readme.MARK.finditer(text)]
    assert sorted(begun) == sorted(shown)
    assert set(shown) == set(told)
