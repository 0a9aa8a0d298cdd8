"""The links of all pages lead to files that are there, and to headings that these have."""

import re
from functools import cache
from urllib.parse import unquote

import pytest
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


def test_pages_are_found():
    names = {path.relative_to(ROOT).as_posix() for path in PAGES}
    assert {"README.md", "docs/how-to/plan.md", "results/reaction.md"} <= names


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
