"""Compilation is told of, is stored function by function, and happens once."""

import io
import os
import stat
import threading
import time
from contextlib import suppress
from types import SimpleNamespace

import pytest
from processes import printed
from small_package import package_in, run_with

from mlivr_gym.compiled import cache, compiling, machine_code

CLEAR = "\r\x1b[K"

ASK = """
import os
from numba.core import event
with event.install_listener("numba:compile", event.RecordingListener()) as compiled:
    from mlivr_gym.caller import outer, second
    print(outer(1), len(compiled.buffer) // 2, flush=True)
    if "KILLED" in os.environ:
        os._exit(0)  # at once, as one that is killed
    print(second(1), len(compiled.buffer) // 2)
"""


@pytest.fixture
def package(tmp_path):
    """A small package with two entries."""
    made = package_in(tmp_path)
    caller = made / "caller.py"
    text = caller.read_text() + "\n\n@entry\ndef second(x):\n    return middle(x) + 2\n"
    caller.write_text(text)
    return made


def test_what_a_killed_process_compiled_is_not_compiled_again(package, tmp_path):
    """Each function is stored when it is compiled, and the second run compiles the rest alone."""
    kept = tmp_path / "kept"
    assert run_with(package, kept, ASK, KILLED="1") == ["21 3"]
    assert run_with(package, kept, ASK) == ["21 0", "22 3"]
    assert run_with(package, kept, ASK) == ["21 0", "22 0"]


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_damaged_machine_code_is_told_and_compiled_again(package, tmp_path, kind):
    """Where a file was cut off, as its list and its content may be when a disk is full."""
    kept = tmp_path / "kept"
    told = f"import logging; logging.basicConfig(stream=__import__('sys').stdout){ASK}"
    run_with(package, kept, told)
    (path,) = kept.rglob(f"caller.outer-*.{kind}")
    path.write_bytes(path.read_bytes()[:60])
    line, *found = run_with(package, kept, told)
    assert f"machine code in {path.parent} cannot be read" in line
    assert found == ["21 3", "22 3"]
    assert run_with(package, kept, told) == ["21 0", "22 0"]


@pytest.mark.filterwarnings("ignore:.*fork")
def test_threads_and_processes_that_store_at_once_lose_nothing(tmp_path):
    """Numba reads the list of what is stored, adds to it and writes it back."""
    (tmp_path / "count").write_text("0")

    class Inner:
        cache_path = str(tmp_path / "made")

        def save_overload(self, signature, compiled):
            before = int((tmp_path / "count").read_text())
            time.sleep(0.02)
            (tmp_path / "count").write_text(str(before + 1))

    def store():
        machine_code._GuardedCache(Inner()).save_overload("signature", "compiled")

    threads = [threading.Thread(target=store) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    children = []
    for _ in range(8):
        children.append(os.fork())
        if children[-1] == 0:
            with suppress(Exception):
                store()
            os._exit(0)
    for child in children:
        os.waitpid(child, 0)
    assert (tmp_path / "count").read_text() == "16"


LOOK = """
from mlivr_gym.caller import outer
print(outer(1), outer.stats.cache_path, sum(outer.stats.cache_hits.values()))
"""


@pytest.mark.parametrize(("place", "mode"), [("kept", 0o757), ("kept/kernels/DIGEST", 0o775)])
def test_machine_code_that_others_may_change_is_not_used(package, tmp_path, place, mode):
    """Whoever may write there could have any code executed; one line says that it is not used."""
    kept = tmp_path / "kept"
    assert run_with(package, kept, LOOK)[0].split()[2] == "0"
    (digest,) = (kept / "kernels").iterdir()
    opened = tmp_path / place.replace("DIGEST", digest.name)
    opened.chmod(mode)
    told = f"import logging; logging.basicConfig(stream=__import__('sys').stdout){LOOK}"
    warned, found = run_with(package, kept, told)
    assert found == "21 None 0"
    assert str(opened) in warned
    assert "other users" in warned
    opened.chmod(0o755)
    assert run_with(package, kept, LOOK)[0].split()[2] == "1"


def test_the_default_cache_folder_is_private(tmp_path, package):
    """Whatever `umask` would allow."""
    code = "import os; os.umask(0); from mlivr_gym.compiled.cache import CACHE_VARIABLE\n"
    code += f"os.environ.pop(CACHE_VARIABLE); import mlivr_gym.caller{LOOK}"
    out = run_with(package, tmp_path / "no", code, XDG_CACHE_HOME=str(tmp_path / "user"))
    assert "mlivr-gym" in out[0]
    made = [tmp_path / "user", *(tmp_path / "user").glob("mlivr-gym/**/")]
    assert len(made) >= 4
    for folder in made[:4]:
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700, folder


class Terminal(io.StringIO):
    """Standard error that is a terminal."""

    def isatty(self):
        return True


@pytest.fixture
def compilation(monkeypatch):
    """A listener, the clock that it reads, and what it prints to a terminal."""
    clock, stream = [100.0], Terminal()
    monkeypatch.setattr(compiling, "time", SimpleNamespace(perf_counter=lambda: clock[0]))
    monkeypatch.setattr(compiling, "sys", SimpleNamespace(stderr=stream))
    return compiling.Compilation(), clock, stream


def of(name, module="mlivr_gym.transitions.steps"):
    """An event of Numba about a function."""
    function = SimpleNamespace(__qualname__=name, __module__=module)
    return SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=function)})


def test_a_line_tells_what_is_compiled_and_why(compilation):
    found, clock, stream = compilation
    found.on_start(of("check_all"))
    assert (found.text, stream.getvalue()) == ("compiling check_all", "")
    clock[0] += 3.0
    found.on_start(of("min", "numba.cpython.builtins"))
    assert found.text == "compiling check_all"
    announced, line = stream.getvalue().removeprefix(CLEAR).split("\n")
    assert announced.startswith("mlivr-gym: compiling for this machine, once for this version")
    assert line == f"{CLEAR}compiling check_all, 3 s"
    found.on_end(of("min", "numba.cpython.builtins"))
    found.on_end(of("check_all"))
    assert found.text == ""
    assert stream.getvalue().endswith(CLEAR)
    found.on_start(of("release_all"))
    clock[0] += 3.0
    found.on_end(of("release_all"))
    assert stream.getvalue().count("mlivr-gym:") == 1


COMMANDS = """
import os, sys
from numba.core import event
compiled = event.RecordingListener()
event.register("numba:compile", compiled)
from mlivr_gym.cli.main import main
for command in {commands}:
    assert main(command.split()) == 0, command
print(len(compiled.buffer) // 2)
"""

QUERY = "--start D2a:4 D2b:4 --goal 6.0 0 0.42"


@pytest.mark.slow
def test_after_warmup_a_plan_compiles_nothing_and_no_command_compiles_twice(tmp_path):
    """With an empty cache."""
    plans = [f"plan {QUERY} --cost {cost}" for cost in ("base", "steps")]
    drawn = f"plan {QUERY} --picture {tmp_path / 'plan.png'}"
    small = f"plan --map columbus --picture {tmp_path / 'plan.png'}"

    def compiled(*commands):
        code, kept = COMMANDS.format(commands=commands), tmp_path / "kept"
        return int(printed("-c", code, **{cache.CACHE_VARIABLE: kept})[-1])

    assert compiled("warmup") > 200
    assert compiled(*plans) == 0
    compiled(drawn, small)
    assert compiled("warmup", *plans, drawn, small) == 0
