"""Links, figures and terms of the pages are those of files, results and modules that are there."""

import importlib
import re
import sys
from functools import cache
from urllib.parse import unquote

import pytest
import readme
from page_blocks import ROOT

LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\((?P<to>[^)\s]+)(?:\s+\"[^\"]*\")?\)")
CODE = re.compile(r"^(`{3,}|~{3,})\S*\n.*?^\1$|`[^`\n]+`", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#+ +(.+?) *$", re.MULTILINE)
SKIPPED = {"_build", "build", "node_modules"}

PAGES = sorted(
    path
    for path in ROOT.rglob("*.md")
    if not any(part in SKIPPED or part.startswith(".") for part in path.relative_to(ROOT).parts)
)


@cache
def anchors(page):
    """Anchors of the headings of a page, as GitHub and the site make them.

    A page that shows a docstring gets headings on the site alone, where a warning is an error.
    """
    text = re.sub(r"^(`{3,}).*?^\1$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    included = re.findall(r"^`{3}\{include\} (\S+)", page.read_text(encoding="utf-8"), re.M)
    found = set().union(*(anchors((page.parent / name).resolve()) for name in included))
    for heading in HEADING.findall(text):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        found.add(re.sub(r"[^\w\- ]", "", words).strip().lower().replace(" ", "-"))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_what_a_page_links_to_is_there(page):
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    missing = []
    for link in LINK.finditer(text):
        name, _, anchor = link["to"].partition("#")
        if re.match(r"[a-z]+:", name):
            continue
        target = (page.parent / unquote(name)).resolve() if name else page
        is_there = target.exists() and target.is_relative_to(ROOT)
        if is_there and anchor and target.suffix == ".md":
            is_there = anchor in anchors(target) or "<!-- docstring" in target.read_text("utf-8")
        if not is_there:
            missing.append(link["to"])
    assert not missing


def rows():
    """Term, symbol and module of each row."""
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and len(cells) == 5 and "`" in cells[4]:
            yield cells[0], cells[1], cells[4].strip("`")


ROWS = list(rows())


def test_each_term_stands_once_and_its_symbol_in_the_module_that_is_named():
    terms, missing = [term for term, _, _ in ROWS], []
    assert len(terms) > 100
    assert sorted({term for term in terms if terms.count(term) > 1}) == []
    for term, symbol, module in ROWS:
        source = (ROOT / module).read_text(encoding="utf-8")
        names = [name.split(".")[-1] for name in re.findall(r"`([A-Za-z_][\w.]*)", symbol)]
        missing += [(term, n) for n in names if not re.search(rf"\b{re.escape(n)}\b", source)]
    assert missing == []


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
    monkeypatch.setattr(readme, "parts", lambda _: told | {"paper": "another table\n"})
    assert readme.stale() == ["README.md"]


def test_every_part_is_shown_and_every_mark_is_of_a_part(told):
    """A mark that lost its end, or its part, would never be filled again."""
    texts = [page.read_text(encoding="utf-8") for page in readme.pages()]
    begun = [name for text in texts for name in re.findall(r"<!-- end of (\w+) -->", text)]
    shown = [match[1] for text in texts for match in readme.MARK.finditer(text)]
    assert sorted(begun) == sorted(shown)
    assert set(shown) == set(told)
