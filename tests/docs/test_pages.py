"""Every command and every piece of code of README and site runs: `make test-docs`.

The blocks of a page run in their order in one empty folder. One that is not run says why in the
page, in a comment above it, and is counted as skipped.
"""

import json
import tomllib

import pytest
from page_blocks import OTHERS, ROOT, blocks, pages, run

RUN = ("bash", "python", "json", "toml")
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


PAGES_RUN = [
    pytest.param(found, id=page.relative_to(ROOT).as_posix())
    for page, found in PAGES.items()
    if any(block.language in RUN for block in found)
]
NOT_RUN = [block for block in BLOCKS if block.not_run]


@pytest.mark.docs
@pytest.mark.parametrize("found", PAGES_RUN)
def test_a_page_runs(found, tmp_path):
    """One test for a page, since its blocks need what those above them wrote."""
    for block in found:
        if block.language not in RUN or block.not_run:
            continue
        if block.language == "json":
            json.loads(block.text)
        if block.language == "toml":
            tomllib.loads(block.text)
        printed = run(block, tmp_path)
        assert not printed, f"{block.page}:{block.line}: {printed}"


@pytest.mark.docs
@pytest.mark.parametrize("block", NOT_RUN, ids=lambda block: f"{block.page}:{block.line}")
def test_a_block_is_not_run(block):
    pytest.skip(f"{block.page}:{block.line}: {block.not_run}")
