"""Which functions of the package a test can reach, told from parsed sources.

A name stands for the function, class or constant that it is bound to in its file, followed through
imports; a class stands for all of its methods, and what asks for a fixture uses it. Methods are
reached with their class alone, so a test reaches no more than what is named on the way.
"""

import ast
from functools import cache
from pathlib import Path

TESTS = Path(__file__).parent.parent
ROOT = TESTS.parent
PACKAGE = ROOT / "mlivr_gym"
MARKS = {"kernel", "part", "entry"}


@cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def file_of(module):
    """The file of a module of the package, also of those that lie at the top, or of the support."""
    if module.partition(".")[0] != "mlivr_gym":
        paths = [TESTS / "support" / f"{module}.py"]
    else:
        path = ROOT.joinpath(*module.split("."))
        paths = [path.with_suffix(".py"), path / "__init__.py"]
    return next((path.resolve() for path in paths if path.is_file()), None)


@cache
def defined(path):
    """Statements at the top of a file by the names that they bind."""
    found = {}
    for node in tree(path).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = node
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for name in (n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)):
                found[name] = node
    return found


@cache
def imported(path):
    """Modules and names in them, None for a module itself, by the names they are imported as."""
    found = {}
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                place = (inner, None) if file_of(inner) else (node.module, alias.name)
                found[alias.asname or alias.name] = place
        elif isinstance(node, ast.Import):
            found |= {alias.asname or alias.name: (alias.name, None) for alias in node.names}
    return found


@cache
def place_of(path, name):
    """File and name where what a name means in a file is defined; None outside of the project."""
    if name in defined(path):
        return path, name
    module, inner = imported(path).get(name, (None, None))
    there = file_of(module) if module and inner else None
    return place_of(there, inner) if there else None


def fixture_of(path, name):
    """Where a fixture of a test file is defined: there, or beside or above it."""
    folders = [folder for folder in path.parents if folder.is_relative_to(TESTS)]
    for file in (path, *(folder / "conftest.py" for folder in folders)):
        if file.is_file() and name in defined(file):
            return file, name
    return None


@cache
def uses(path, name):
    """What the definition of a name uses."""
    node, found = defined(path)[name], set()
    for inner in ast.walk(node):
        if isinstance(inner, ast.Name):
            found.add(place_of(path, inner.id))
        elif isinstance(inner, ast.Attribute) and isinstance(inner.value, ast.Name):
            module, of = imported(path).get(inner.value.id, (None, ""))
            there = file_of(module) if module and of is None else None
            found.add(place_of(there, inner.attr) if there else None)
        elif isinstance(inner, ast.arg) and path.is_relative_to(TESTS):
            found.add(fixture_of(path, inner.arg))
        elif isinstance(inner, ast.Constant) and isinstance(inner.value, str):
            # An annotation, or a name that is looked up in a module.
            modules = [file_of(module) for module, of in imported(path).values() if of is None]
            if inner.value.isidentifier():
                found |= {place_of(file, inner.value) for file in (path, *modules) if file}
    return found - {None}


@cache
def reached(path, name):
    """All that can be reached from a function of a file, as files and names."""
    found, todo = set(), [(path.resolve(), name)]
    while todo:
        here = todo.pop()
        if here not in found:
            found.add(here)
            todo += uses(*here)
    return found


def is_marked(node):
    """Whether a statement is a function that is marked as a kernel."""
    marks = node.decorator_list if isinstance(node, ast.FunctionDef) else []
    return bool(MARKS & {mark.id for mark in marks if isinstance(mark, ast.Name)})


@cache
def kernels():
    """File of each kernel, by module, as `folder/name`, and name."""
    found = {}
    for folder in (PACKAGE, ROOT / "planners", ROOT / "agents"):
        root = PACKAGE if folder == PACKAGE else ROOT
        for path in sorted(folder.rglob("*.py")):
            module = path.relative_to(root).with_suffix("").as_posix()
            marked = [name for name, node in defined(path).items() if is_marked(node)]
            found |= {(module, name): path.resolve() for name in marked}
    return found
