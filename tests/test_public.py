"""What a package shows: few names, each with its place; others import from packages alone."""

import ast
import re
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import pytest
from page_blocks import blocks, pages

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "mlivr_gym"

FACES = (
    "kinematics", "robot", "world", "collisions", "stances", "motion", "planners", "simulation",
    "envs", "pictures", "agents",
)  # fmt: skip
"""Packages of the core that show names."""

MOST_NAMES = 15

HIDDEN = {"compiled", "postures", "transitions"}
"""Packages of the core that show nothing."""

EXTENSIONS = sorted(path.parent.name for path in PACKAGE.glob("extensions/*/__init__.py"))

SHOWN = [f"mlivr_gym.{name}" for name in FACES]
SHOWN += ["mlivr_gym", *(f"mlivr_gym.extensions.{name}" for name in EXTENSIONS)]
"""The packages that show names."""


def is_public(module, name):
    """Whether a name is shown by a package, or a module of the top is a package of one file.

    Commands of extensions are made of the parts of `cli`.
    """
    if module in SHOWN:
        return name in import_module(module).__all__
    _, first, *rest = module.split(".")
    return first == "cli" or (not rest and (PACKAGE / f"{first}.py").exists())


def imported(tree):
    """Modules of the package with the names that a syntax tree imports from them."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "mlivr_gym":
            yield from ((node.module, alias.name) for alias in node.names)


def private_imports(text, home=""):
    """Names that are taken from elsewhere than a package, apart from a home of their own."""
    return sorted(
        f"{module}.{name}"
        for module, name in imported(ast.parse(text))
        if not is_public(module, name) and (not home or not f"{module}.".startswith(f"{home}."))
    )


@pytest.mark.parametrize("package", SHOWN)
def test_a_package_shows_few_names_and_each_is_there(package):
    module = import_module(package)
    assert len(module.__doc__.strip().split("\n\n")) <= 2
    assert len(set(module.__all__)) == len(module.__all__)
    assert len(module.__all__) <= MOST_NAMES, f"{package} is full: what is needed least is private"
    for name in module.__all__:
        with suppress(ImportError):  # of an extra that is not installed
            assert getattr(module, name) is not None
    files = {path.stem for folder in module.__path__ for path in Path(folder).iterdir()}
    assert not files & set(module.__all__), "the module would hide the name"


def test_every_package_shows_names_or_is_hidden():
    found = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert found == {*FACES, *HIDDEN, "cli", "envs_assets", "extensions"}


def test_code_with_kernels_imports_no_package():
    """The digest of its sources follows imports of modules, see `compiled.cache`."""
    for path in [*PACKAGE.rglob("*.py"), *(ROOT / "planners").glob("*.py")]:
        text = path.read_text(encoding="utf-8")
        if re.search(r"^@(kernel|part|entry)\b", text, re.MULTILINE):
            for module, name in imported(ast.parse(text)):
                assert module not in SHOWN or name not in import_module(module).__all__, path


def test_pages_and_examples_import_from_packages():
    for page in pages():
        for block in blocks(page):
            if block.language == "python":
                text = block.text.replace(">>> ", "").replace("... ", "    ")
                assert not private_imports(text), page
    for path in (ROOT / "examples").glob("*.py"):
        assert not private_imports(path.read_text(encoding="utf-8")), path


MOST_PRIVATE = {"experiments": 71, "mlivr_gym/extensions": 55}
"""How many names a folder takes from elsewhere than packages."""


@pytest.mark.parametrize("folder", MOST_PRIVATE)
def test_few_names_are_taken_from_elsewhere(folder):
    found = {}
    for path in sorted((ROOT / folder).rglob("*.py")):
        inside = path.relative_to(ROOT)
        home = ".".join(inside.parts[:3]) if "extensions" in inside.parts else ""
        if names := private_imports(path.read_text(encoding="utf-8"), home):
            found[inside.as_posix()] = names
    assert sum(map(len, found.values())) <= MOST_PRIVATE[folder], found
