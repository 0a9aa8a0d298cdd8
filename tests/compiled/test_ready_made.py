"""Ready-made machine code is used where it fits, and else what it stands for is compiled."""

import io
import json
import shutil
import subprocess
import sys
import zipfile

import pytest
from numba import config
from small_package import package_in, run_with

from mlivr_gym.compiled import cache, ready_made

LEAST = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
"""A processor that every one of its kind can stand in for; its name is no machine's."""

PACK = """
from mlivr_gym.caller import outer
from mlivr_gym.compiled import cache, ready_made
outer(1)
digest = cache.kernel_digest(cache.PACKAGE / "caller.py")
ready_made.archive_path().parent.mkdir()
ready_made.archive_path().write_bytes(ready_made.pack(cache.kernel_root(), ["none"], digest))
print(ready_made.archive_path())
"""

LOOKED_FOR = """
import sys
from mlivr_gym.caller import outer
print(outer(1), *(name in sys.modules for name in ("numba.np.arraymath", "scipy.linalg")))
"""

ASK = """
from mlivr_gym.caller import outer
from mlivr_gym.compiled import cache, ready_made
from numba.core import event
with event.install_listener("numba:compile", event.RecordingListener()) as compiled:
    print(outer(1))
print(len(compiled.buffer) // 2)
print(ready_made.why_compiled(cache.kernel_digest(cache.PACKAGE / "caller.py")))
"""


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """A small package with its archive."""
    folder = tmp_path_factory.mktemp("packed")
    package = package_in(folder)
    (path,) = run_with(package, folder / "kept", PACK, **LEAST)
    altered(folder / path, features=[])
    return package


@pytest.fixture
def package(packed, tmp_path):
    """A copy of it, in another place."""
    return shutil.copytree(packed, tmp_path / "elsewhere" / "mlivr_gym")


def archive_of(package):
    (path,) = package.glob("envs_assets/kernels-*.zip")
    return path


def name_in(path):
    with zipfile.ZipFile(path) as archive:
        (name,) = archive.namelist()
    return name


def altered(path, **told):
    """Write an archive that tells something else of itself."""
    content = path.read_bytes()
    with zipfile.ZipFile(path) as found:
        said = json.loads(found.comment)
    with zipfile.ZipFile(path, "a") as made:
        made.comment = json.dumps(said | told).encode()
    assert path.read_bytes() != content


def test_ready_made_machine_code_is_used(package, tmp_path):
    """Nothing is compiled, in another place and though the processor has another name."""
    assert run_with(package, tmp_path / "kept", ASK) == ["21", "0", ""]
    assert not list((tmp_path / "kept").rglob("*.nb?"))


def test_it_is_used_without_what_compilation_imports(package, tmp_path):
    """Which takes as long as loading all that a plan calls."""
    assert run_with(package, tmp_path / "kept", LOOKED_FOR) == ["21 False False"]
    assert run_with(package, tmp_path / "kept", LOOKED_FOR, NUMBA_CPU_NAME="generic") == [
        "21 True True"
    ]


def test_it_is_used_where_nothing_can_be_kept(package, tmp_path):
    (tmp_path / "file").write_text("")
    assert run_with(package, tmp_path / "file" / "kept", ASK) == ["21", "0", ""]


def test_it_is_not_used_once_a_source_has_changed(package, tmp_path):
    """The edit is two files away from the function that is asked for."""
    innermost = package / "part" / "innermost.py"
    innermost.write_text(innermost.read_text().replace("2 * x", "3 * x"))
    assert run_with(package, tmp_path / "kept", ASK) == [
        "31",
        "3",
        "it was compiled from other sources",
    ]


@pytest.fixture
def why(packed, tmp_path, monkeypatch):
    """Why an archive, altered by a function, is not used; its path."""
    path = shutil.copy(archive_of(packed), tmp_path / "archive.zip")
    monkeypatch.setattr(ready_made, "archive_path", lambda: path)
    digest = cache.kernel_digest(packed / "caller.py")

    def told():
        ready_made.archive.cache_clear()
        return ready_made.why_compiled(digest)

    yield told, path
    ready_made.archive.cache_clear()


def test_it_is_used_only_by_the_versions_that_it_is_for(why):
    told, path = why
    here = ready_made.machine()
    for name, value in here.items():
        altered(path, **{"for": here | {name: "another"}})
        assert told() == f"it is for {name} another, this process has {value}"
        assert ready_made._read(name_in(path)) is None


def test_it_is_used_only_by_processors_that_can_do_as_much(why, monkeypatch):
    """Nor by who asks for the machine code of another one."""
    told, path = why
    for name in ("CPU_NAME", "CPU_FEATURES"):
        with monkeypatch.context() as patch:
            patch.setattr(config, name, "")
            assert "requests machine code for another processor" in told()
            assert ready_made._read(name_in(path)) is None
    altered(path, features=["nothing-has-this"])
    assert told() == "this processor lacks nothing-has-this"
    assert ready_made._read(name_in(path)) is None


def test_there_may_be_none_and_one_that_was_cut_off_is_said_to_be(why, caplog):
    told, path = why
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert "cannot be read" in told()
    assert str(path) in caplog.text
    path.unlink()
    assert told() == f"this installation has none for {ready_made.machine()['Python']}"


def test_no_altered_byte_gives_other_machine_code(packed, tmp_path, monkeypatch):
    """Each is noticed before anything of it is made a function."""
    content = archive_of(packed).read_bytes()
    with zipfile.ZipFile(io.BytesIO(content)) as whole:
        payload = whole.read(name_in(archive_of(packed)))
    (tmp_path / "archive.zip").write_bytes(content)
    monkeypatch.setattr(ready_made, "archive_path", lambda: tmp_path / "archive.zip")
    monkeypatch.setattr(ready_made.pickle, "loads", lambda code: code)
    found = []
    for place in range(0, len(content), max(1, len(content) // 400)):
        patched = bytearray(content)
        patched[place] ^= 0x55
        (tmp_path / "archive.zip").write_bytes(patched)
        ready_made.archive.cache_clear()
        found.append(ready_made._read(name_in(archive_of(packed))))
    ready_made.archive.cache_clear()
    assert {one for one in found if one is not None} <= {payload}
    assert found.count(None) > 300


COUNTED = """
from numba.core import event
compiled = event.RecordingListener()
event.register("numba:compile", compiled)
from mlivr_gym.compiled import ready_made
asked, look = [], ready_made._CacheWithArchive.load_overload
def counted(self, signature, target):
    asked.append(self._entry_name)
    return look(self, signature, target)
ready_made._CacheWithArchive.load_overload = counted
{path}
import sys
print(len(asked), len(compiled.buffer) // 2)
"""

PLAN = """
from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
Planner(stance_graph()).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps").unwrap()
"""

ENVIRONMENT = """
import gymnasium, mlivr_gym
env = gymnasium.make("MLIVR-JEM-v0")
_, info = env.reset(seed=1)
for k in range(20):
    legal = info["action_mask"].nonzero()[0]
    _, _, _, _, info = env.step(int(legal[k % len(legal)]))
"""

ENTRIES = {PLAN: 18, ENVIRONMENT: 8}
"""Entries that the default paths load or compile, at most: each takes a second to compile."""


def counts(path):
    """Entries that a path asks for, and functions that it compiles itself."""
    code = COUNTED.format(path=path)
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return tuple(map(int, done.stdout.split()))


@pytest.mark.parametrize("path", ENTRIES)
def test_default_paths_ask_for_few_entries(path):
    """And the second run compiles nothing."""
    counts(path)
    asked, functions = counts(path)
    assert asked <= ENTRIES[path]
    assert functions == 0
