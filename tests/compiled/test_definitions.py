"""Every module of kernels has a plain definition, and a test that compares the two.

The table of `docs/inside.md` names them.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
PACKAGE, TESTS = ROOT / "mlivr_gym", ROOT / "tests"
ROW = re.compile(r"\| `([a-z_0-9/]+)`[^|]*\| ([^|]+) \| ([^|]+) \| `([a-z_0-9/]+\.py)::(\w+)` \|")
MARKS = {"kernel", "part", "entry"}


def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def functions(path):
    return [node for node in tree(path).body if isinstance(node, ast.FunctionDef)]


def modules_of_kernels():
    """Kernels by module, as `folder/name`."""
    found = {}
    for folder in (PACKAGE, ROOT / "planners", ROOT / "agents"):
        root = PACKAGE if folder == PACKAGE else ROOT
        for path in sorted(folder.rglob("*.py")):
            marked = [
                node.name
                for node in functions(path)
                if MARKS & {mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)}
            ]
            if marked:
                found[path.relative_to(root).with_suffix("").as_posix()] = marked
    return found


def words_of(path):
    """Names in a test and in the tests' support that it imports."""
    text = path.read_text(encoding="utf-8")
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ImportFrom):
            other = TESTS / "support" / f"{node.module}.py"
            text += other.read_text(encoding="utf-8") if other.exists() else ""
    return set(re.findall(r"\w+", text))


ROWS = ROW.findall((ROOT / "docs" / "inside.md").read_text(encoding="utf-8"))


def test_every_module_of_kernels_is_in_the_table_and_no_other():
    assert sorted({module for module, *_ in ROWS}) == sorted(modules_of_kernels())


@pytest.mark.parametrize(("module", "asked", "file", "test"), [(*r[:2], *r[3:]) for r in ROWS])
def test_the_test_of_a_row_is_there_and_asks_the_kernels(module, asked, file, test):
    """Kernels that a test can call it calls; others are asked through what is made of them."""
    assert test in {node.name for node in functions(TESTS / file)}
    names = set(re.findall(r"\w+", asked))
    assert names
    assert names <= words_of(TESTS / file)


def test_the_plain_definitions_that_are_named_are_there():
    """`module.function` and `folder/file.py` of the middle column."""
    for _, _, definition, *_ in ROWS:
        for named in re.findall(r"`([\w./]+)`", definition):
            if named.endswith(".py"):
                assert (PACKAGE / named).exists()
            elif "." in named:
                module, function = named.split(".")
                (path,) = PACKAGE.rglob(f"{module}.py")
                assert function in {node.name for node in functions(path)}
