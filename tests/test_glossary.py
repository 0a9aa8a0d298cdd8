"""Each term of the glossary stands once, and its symbol in the module that it names."""

import re
from pathlib import Path

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


def test_each_symbol_is_defined_in_the_module_that_is_named():
    missing = []
    for term, symbol, module in ROWS:
        source = (ROOT / module).read_text(encoding="utf-8")
        names = [name.split(".")[-1] for name in re.findall(r"`([A-Za-z_][\w.]*)", symbol)]
        missing += [(term, n) for n in names if not re.search(rf"\b{re.escape(n)}\b", source)]
    assert missing == []
