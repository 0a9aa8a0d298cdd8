"""Machine code and tables are kept by the contents of the sources that they depend on."""

import ast

import pytest
from small_package import package_in, run_with

from mlivr_gym.compiled import cache

ROOT = cache.PACKAGE.resolve().parent
KERNEL_FILES = [
    path
    for folder in (ROOT / "mlivr_gym", ROOT / "planners")
    for path in sorted(folder.rglob("*.py"))
    if cache.KERNEL.search(path.read_text(encoding="utf-8"))
]


@pytest.fixture
def digest(monkeypatch):
    """Digest of the caller of a package, worked out anew."""

    def fresh(package):
        monkeypatch.setattr(cache, "PACKAGE", package)
        cache._digest.cache_clear()
        cache._imported.cache_clear()
        cache._text.cache_clear()
        return cache.source_digest(package / "caller.py")

    yield fresh
    cache._digest.cache_clear()
    cache._imported.cache_clear()
    cache._text.cache_clear()


@pytest.mark.parametrize(
    "name", ["caller.py", "callee.py", "part/__init__.py", "part/innermost.py", "compiled/cache.py"]
)
def test_an_edit_of_any_source_that_is_called_changes_the_digest(tmp_path, digest, name):
    package = package_in(tmp_path)
    before = digest(package)
    (package / name).write_text((package / name).read_text() + "\n# edited\n")
    assert digest(package) != before


def test_an_unrelated_edit_and_another_place_change_nothing(tmp_path, digest):
    package = package_in(tmp_path / "here")
    before = digest(package)
    (package / "bystander.py").write_text("# edited\n")
    (package / "compiled" / "bit_sets.py").write_text("# edited\n")
    assert digest(package) == before
    assert digest(package_in(tmp_path / "elsewhere")) == before


def test_another_version_number_changes_no_digest():
    """Machine code and tables are made for the same sources in every release of them."""

    def digests():
        cache._digest.cache_clear()
        cache._imported.cache_clear()
        return [(cache.kernel_digest(one), cache.source_digest(one)) for one in KERNEL_FILES]

    before, text = digests(), cache._text
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cache, "_text", lambda one: "" if one.name == "_version.py" else text(one))
        after = digests()
    assert after == before == digests()


CODE = """
from mlivr_gym.caller import outer
print(outer(1), sum(outer.stats.cache_hits.values()) > 0)
"""


def test_a_cached_caller_sees_an_edited_callee(tmp_path):
    """The edit is two files away. Numba's key alone is the caller's file: the answer would stay."""
    package = package_in(tmp_path / "tree")

    def answer():
        return run_with(package, tmp_path / "kept", CODE)[0].split()

    assert answer() == ["21", "False"]
    assert answer() == ["21", "True"]
    innermost = package / "part" / "innermost.py"
    innermost.write_text(innermost.read_text().replace("2 * x", "3 * x"))
    assert answer() == ["31", "False"]


@pytest.mark.parametrize("path", KERNEL_FILES, ids=lambda path: path.stem)
def test_classes_of_files_without_kernels_are_in_annotations_alone(path):
    """The machine code does not depend on them, so that `kernel_digest` need not either."""
    tree = ast.parse(path.read_text())
    kept = cache._imported(path, of_kernels=True)
    for line in tree.body:
        if isinstance(line, ast.ImportFrom) and (line.module or "").startswith("mlivr_gym."):
            file = cache.PACKAGE.joinpath(*line.module.split(".")[1:]).with_suffix(".py")
            if file.is_file() and file not in kept:
                ignored = {name.asname or name.name for name in line.names}
                assert not ignored & names_in_kernels(tree), line.module


def names_in_kernels(tree):
    """All names in the statements of compiled functions, but not in their signatures."""
    functions = (f for f in tree.body if isinstance(f, ast.FunctionDef) and f.decorator_list)
    kernels = [
        f
        for f in functions
        if {"entry", "late_entry", "kernel", "part"} & {ast.unparse(d) for d in f.decorator_list}
    ]
    statements = [statement for f in kernels for statement in f.body]
    for statement in [node for s in statements for node in ast.walk(s)]:
        if isinstance(statement, ast.AnnAssign):
            statement.annotation = ast.Constant(None)
    nodes = (node for statement in statements for node in ast.walk(statement))
    return {node.id for node in nodes if isinstance(node, ast.Name)}


def test_a_class_imported_for_annotations_changes_tables_but_no_machine_code(tmp_path, digest):
    package = package_in(tmp_path)
    (package / "records.py").write_text("class Given:\n    pass\n")
    caller = package / "caller.py"
    caller.write_text(f"from mlivr_gym.records import Given\n{caller.read_text()}")
    before = digest(package), cache.kernel_digest(caller)
    (package / "records.py").write_text("class Given:\n    field = 1\n")
    after = digest(package), cache.kernel_digest(caller)
    assert (after[0] != before[0], after[1] == before[1]) == (True, True)
    (package / "records.py").write_text("@entry\ndef f():\n    pass\nclass Given:\n    pass\n")
    assert (digest(package), cache.kernel_digest(caller))[1] != before[1]
