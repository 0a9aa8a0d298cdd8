"""Machine code and tables are kept by the contents of the sources that they depend on."""

import pytest
from small_package import package_in, run_with

from mlivr_gym.compiled import cache


@pytest.fixture
def digest(monkeypatch):
    """Digest of the caller of a package, worked out anew."""

    def fresh(package):
        monkeypatch.setattr(cache, "PACKAGE", package)
        cache.source_digest.cache_clear()
        cache._imported.cache_clear()
        cache._content.cache_clear()
        return cache.source_digest(package / "caller.py")

    yield fresh
    cache.source_digest.cache_clear()
    cache._imported.cache_clear()
    cache._content.cache_clear()


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
