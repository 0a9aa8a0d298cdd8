"""Every command and every piece of code of README and site runs: `make test-docs`.

The blocks of a page run in their order in one empty folder. One that is not run says why in the
page, in a comment above it, and is counted as skipped.
"""

import json

import pytest
from page_blocks import OTHERS, blocks, pages, run

RUN = ("bash", "python", "json")
PAGES = {page: list(blocks(page)) for page in pages()}
BLOCKS = [block for found in PAGES.values() for block in found if block.language in RUN]


def test_each_block_says_what_it_is():
    """A block without a language would never be run."""
    unknown = [
        (block.page, block.line, block.language)
        for found in PAGES.values()
        for block in found
        if block.language not in RUN
        and block.language not in OTHERS - {""}
        and not block.language.startswith("{")
    ]
    assert not unknown
    assert len(BLOCKS) > 20


def test_what_is_not_run_has_its_reason_above_a_block():
    """A comment that belongs to no block would skip nothing, or hide a slip."""
    for page, found in PAGES.items():
        comments = page.read_text(encoding="utf-8").count("<!-- not run:")
        assert comments == sum(bool(block.not_run) for block in found), page


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A folder for each page."""
    return {block.page: tmp_path_factory.mktemp("page") for block in BLOCKS}


def marked(block):
    marks = [pytest.mark.docs, pytest.mark.xdist_group(block.page)]
    if block.not_run:
        marks.append(pytest.mark.skip(reason=f"{block.page}:{block.line}: {block.not_run}"))
    return pytest.param(block, id=f"{block.page}:{block.line}", marks=marks)


@pytest.mark.parametrize("block", [marked(block) for block in BLOCKS])
def test_a_block_runs(block, folders):
    if block.language == "json":
        json.loads(block.text)
    assert not run(block, folders[block.page])
