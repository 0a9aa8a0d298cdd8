"""Every kernel has a plain definition, or a truth from elsewhere, and a test that compares the two.

The tables of `docs/kernels.md` name them.
"""

import re
from collections import Counter
from typing import NamedTuple

import pytest
from call_graph import PACKAGE, ROOT, TESTS, defined, file_of, imported, kernels, reached

LIBRARIES = {
    "SciPy": "scipy", "Pinocchio": "pinocchio", "Coal": "coal", "MuJoCo": "mujoco",
    "networkx": "networkx", "heapq": "heapq", "NumPy": "numpy",
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


def used_by(path):
    """A test file, what it imports of the support, and what its fixtures are in."""
    beside = [folder / "conftest.py" for folder in path.parents if folder.is_relative_to(TESTS)]
    files, todo = set(), [path.resolve(), *(file for file in beside if file.is_file())]
    while todo:
        here = todo.pop()
        files.add(here)
        inner = {file_of(module) for module, _ in imported(here).values()}
        todo += [p for p in inner - files if p and p.is_relative_to(TESTS)]
    return files


def test_every_kernel_is_in_one_row_and_nothing_else_is():
    named = Counter(kernel for row in ROWS for kernel in row.kernels)
    assert named == Counter(kernels().keys())


@each_row
def test_the_test_of_a_row_reaches_its_kernels(row):
    """By the names that it uses, and that these use."""
    assert row.test in defined(row.path)
    there = reached(row.path, row.test)
    assert not [name for name in row.kernels if (kernels()[name], name[1]) not in there]


@each_row
def test_the_plain_definition_of_a_row_is_there(row):
    """And the libraries that it names are used by the test or its support."""
    assert row.how in ("equal", "bound", "sound")
    quoted = re.findall(r"`([\w.]+)`", row.definition)
    libraries = [name for name in LIBRARIES if name in row.definition]
    assert quoted or libraries or "Python" in row.definition
    files = used_by(row.path)
    modules = {module.split(".")[0] for file in files for module, _ in imported(file).values()}
    assert {LIBRARIES[name] for name in libraries} <= modules
    for named in quoted:
        module, _, name = named.rpartition(".")
        if module:
            places = [*PACKAGE.rglob(f"{module}.py"), *ROOT.glob(f"planners/{module}.py")]
            places += [TESTS / "support" / f"{module}.py"]
            assert any(place.is_file() and name in defined(place.resolve()) for place in places)
        else:
            assert name in defined(row.path) or list(PACKAGE.rglob(f"{name}.py"))
