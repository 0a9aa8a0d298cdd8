"""Each term of the glossary stands once, and its symbol in the module that it names."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def rows():
    """Term, symbol and module of each row."""
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and len(cells) == 5 and "`" in cells[4]:
            yield cells[0], cells[1], cells[4].strip("`")


ROWS = list(rows())


def test_each_term_stands_once():
    terms = [term for term, _, _ in ROWS]
    assert len(terms) > 100
    assert sorted({term for term in terms if terms.count(term) > 1}) == []


@pytest.mark.parametrize(("term", "symbol", "module"), ROWS, ids=[term for term, _, _ in ROWS])
def test_a_symbol_is_defined_in_the_module_that_is_named(term, symbol, module):
    source = (ROOT / module).read_text(encoding="utf-8")
    for name in re.findall(r"`([A-Za-z_][\w.]*)", symbol):
        assert re.search(rf"\b{re.escape(name.split('.')[-1])}\b", source), name
