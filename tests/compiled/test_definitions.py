"""Every kernel has a plain definition, or a truth from elsewhere, and a test that compares the two.

The tables of `docs/kernels.md` name them.
"""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

TESTS = Path(__file__).parent.parent
ROOT = TESTS.parent
PACKAGE = ROOT / "mlivr_gym"
SUPPORT = (TESTS / "support", ROOT / "experiments")
"""Folders of what tests import."""
MARKS = {"kernel", "part", "entry", "late_entry"}
LIBRARIES = {
    "SciPy": "scipy", "Pinocchio": "pinocchio", "Coal": "coal", "MuJoCo": "mujoco",
    "networkx": "networkx", "heapq": "heapq", "NumPy": "numpy", "EAIK": "eaik",
}  # fmt: skip


class Row(NamedTuple):
    """A row of a table."""

    kernels: tuple
    """Modules, as `folder/name`, and names."""
    how: str
    definition: str
    file: str
    test: str

    @property
    def path(self):
        return TESTS / self.file


def rows():
    """The rows of the document, by folder."""
    found, text = [], (ROOT / "docs" / "kernels.md").read_text(encoding="utf-8")
    for folder, body in re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", text, re.M | re.S):
        for line in body.splitlines():
            if line.startswith("| `"):
                module, names, how, definition, test = line.strip("| ").split(" | ")
                named = re.findall(r"`(\w+)`", names)
                place = f"{folder}/{module.strip('`')}"
                file, name = test.strip("`").split("::")
                found.append(Row(tuple((place, one) for one in named), how, definition, file, name))
    return found


ROWS = rows()
each_row = pytest.mark.parametrize("row", ROWS, ids=lambda row: "-".join(row.kernels[0]))


@cache
def functions(path):
    """Functions and classes at the top of a file by name."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    return {node.name: node for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)}


def kernels():
    """Every kernel: its module, as `folder/name`, and its name."""
    found = set()
    for folder in (PACKAGE, ROOT / "planners", ROOT / "agents"):
        root = PACKAGE if folder == PACKAGE else ROOT
        for path in sorted(folder.rglob("*.py")):
            module = path.relative_to(root).with_suffix("").as_posix()
            for name, node in functions(path).items():
                marks = {mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)}
                found |= {(module, name)} if marks & MARKS else set()
    return found


def imported(path):
    """Modules that a test imports, or that what it imports of the support imports."""
    found = set(re.findall(r"^(?:import|from) (\w+)", path.read_text(encoding="utf-8"), re.M))
    support = [folder / f"{module}.py" for folder in SUPPORT for module in found]
    return found.union(*(imported(file) for file in support if file.is_file()))


def test_every_kernel_is_in_one_row_and_nothing_else_is():
    named = Counter(kernel for row in ROWS for kernel in row.kernels)
    missing, surplus = Counter(kernels()) - named, named - Counter(kernels())
    assert not missing, f"add a row to docs/kernels.md for {sorted(missing)}"
    assert not surplus, f"docs/kernels.md has a row too many for {sorted(surplus)}"


@each_row
def test_the_plain_definition_of_a_row_is_there(row):
    """And the test, which uses the libraries that it names, it or its support."""
    assert row.test in functions(row.path)
    assert row.how in ("equal", "bound", "sound")
    quoted = re.findall(r"`([\w.]+)`", row.definition)
    libraries = [name for name in LIBRARIES if name in row.definition]
    assert quoted or libraries or "Python" in row.definition
    fixtures = [file for file in (row.path.parent / "conftest.py",) if file.is_file()]
    modules = set().union(*map(imported, (row.path, *fixtures)))
    assert {LIBRARIES[name] for name in libraries} <= modules
    for named in quoted:
        module, _, name = named.rpartition(".")
        if module:
            places = [*PACKAGE.rglob(f"{module}.py"), *ROOT.glob(f"planners/{module}.py")]
            places += [folder / f"{module}.py" for folder in SUPPORT]
            assert any(place.is_file() and name in functions(place) for place in places)
        else:
            assert name in functions(row.path) or list(PACKAGE.rglob(f"{name}.py"))
