"""Whatever is typed, a command ends with a documented exit code and one line of what is wrong.

Options are those of the parser itself. What is refused leaves no file, and no file is ever half
written. What takes long (training, simulating, collecting) is replaced; all checks before it stay.
`MLIVR_GYM_FUZZ=10000` draws more examples.
"""

import argparse
import contextlib
import importlib.util
import io
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path

import pytest
from fuzz import bounded, few, mutated
from hypothesis import given
from hypothesis import strategies as st
from map_data import LADDER

from mlivr_gym import GraspMap, RobotSpec, Settings, stance_graph
from mlivr_gym.cli.main import _parser, main
from mlivr_gym.errors import SimulationError
from mlivr_gym.planners import Planner

pytest.importorskip("sb3_contrib")

FLOATS = [
    "0", "-1", "0.1", "1", "0.6", "3", "1e-300", "1e308", "-1e308", "1e9", "nan", "inf", "-inf",
    "x", "", "1e400", "0x10", "\uff11", "9" * 5000,
]  # fmt: skip
INTS = ["0", "-1", "1", "2", "64", "2000", "3.5", "x", "", "10" * 20, "9" * 5000, "nan", "1e3"]
POINTS = ["R0:0", "R0:4", "R1:2", "R2:1", "R9:9", "", "\ud800", "x" * 300, "-1", "a\0b"]
FILES = [
    "map.json", "robot.json", "obstacles.json", "plan.json", "hyper.json", "new.json", "new.png",
    "new.gif", "new", "old.json", "torn.json", "torn", "latin.json", "folder", "folder/new.png",
    "no/new.png", "map.json/x", "", ".", "/dev/null/x", "/proc/x", "a\0b", "\ud800", "n" * 300,
    "-", "--", "new\udc80", "mlivr3", "mlivr9", "pretrained",
]  # fmt: skip
WORDS = [
    "astar", "dijkstra", "greedy", "algorithm1", "base", "steps", "weighted", "relaxed", "zero",
    "consistent", "paper", "bc", "ppo", "finetune", "pointer", "mlp", "same", "half", "random",
    "local", "mcts", "mlivr/x-v0", "foo", "", "x" * 300, "\ud800", "a\nb",
]  # fmt: skip
KNOWN = {
    "goal": ["1.0", "0", "0.6", "0.9", "5"],
    "start": POINTS,
    "occupied": POINTS,
    "case": ["3", "5", "x", "-1"],
    "split": ["same", "hard", ""],
}
MAP = ["--map", "map.json"]
COMMANDS = ("plan", "info", "render", "simulate", "train", "evaluate", "dataset", "view")

ROBOT = json.loads(json.dumps(RobotSpec(capsules=RobotSpec().mounted[0].capsules).to_dict()))
OBSTACLES = {"boxes": [{"id": "b", "min": [0, 0, 1], "max": [1, 1, 2]}], "occupied": ["R0:0"]}


@cache
def options(command):
    """The options of a command, from its parser."""
    parser = _parser([command])
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return [action for action in commands.choices[command]._actions if action.option_strings]


def pool(action):
    if action.dest in KNOWN:
        return KNOWN[action.dest]
    if action.type is float:
        return FLOATS
    if action.type is int:
        return INTS
    return FILES + WORDS


@st.composite
def lines(draw, command):
    """A command with some of its options, each with values of all kinds, and too many or few."""
    given = [command, *draw(st.sampled_from([MAP] * 9 + [[], ["x"]]))]
    for action in draw(st.lists(st.sampled_from(options(command)), max_size=4)):
        given.append(action.option_strings[-1])
        count = {None: 1, "+": 2, 0: 0, "?": 0}.get(action.nargs, action.nargs)
        count += draw(st.sampled_from([0] * 8 + [-1, 1]))
        values = st.sampled_from(pool(action))
        given += draw(st.lists(values, min_size=max(count, 0), max_size=max(count, 0)))
    return given


@pytest.fixture(scope="module")
def originals(tmp_path_factory, ladder_plan):
    """Files that commands may read, whole and torn."""
    folder = tmp_path_factory.mktemp("originals")
    hyper = {"bc": {"imitation": {"rounds": 1}}, "networks": {}}
    for name, data in (
        ("map", LADDER), ("robot", ROBOT), ("obstacles", OBSTACLES), ("hyper", hyper),
        ("plan", ladder_plan), ("old", {"old": True}),
    ):  # fmt: skip
        (folder / f"{name}.json").write_text(json.dumps(data))
    (folder / "torn.json").write_text('{"segments": [')
    (folder / "torn.pt").write_bytes(b"PK\3\4")
    (folder / "latin.json").write_bytes('{"é": 1}'.encode("latin-1"))
    (folder / "folder").mkdir()
    return folder


@pytest.fixture(scope="module")
def ladder_plan():
    graph = stance_graph(GraspMap.from_dict(LADDER), settings=Settings(collisions=False))
    found = Planner(graph).plan(("R0:1", "R1:1"), (1.4, 0.0, 0.6), goal_tolerance=0.4).unwrap()
    return json.loads(json.dumps(found.to_dict()))


@pytest.fixture
def quick(monkeypatch, tmp_path):
    """What takes long is replaced, the JEM by three rails; more points are refused as too many."""

    def stopped(*_, **__):
        raise SimulationError("not carried out here")

    # Where they are used, since a module that is first imported now would keep what replaces them.
    monkeypatch.setattr("mlivr_gym.extensions.cargo.cargo_mission.execute", stopped)
    monkeypatch.setattr("mlivr_gym.simulation.execution.execute", stopped)
    monkeypatch.setattr("mlivr_gym.agents.training.train", stopped)
    monkeypatch.setattr("mlivr_gym.cli.evaluate.evaluate", stopped)
    for module in ("dataset", "lerobot_dataset"):
        monkeypatch.setattr(f"mlivr_gym.agents.{module}.expert_env", stopped)
    monkeypatch.setattr("mlivr_gym.cli.render.SceneRenderer", stopped)
    monkeypatch.setattr("mlivr_gym.cli.render.configuration_figure", stopped)
    monkeypatch.setattr("mlivr_gym.extensions.viewer.view._serve", stopped)
    if importlib.util.find_spec("viser") is not None:
        monkeypatch.setattr("mlivr_gym.extensions.viewer.viewer.write_html", stopped)
    monkeypatch.setattr("mlivr_gym.stances.point_pairs.MOST_PAIRS", 2000)
    for module in ("world.grasp_map", "paper"):
        monkeypatch.setattr(f"mlivr_gym.{module}.jem_map", lambda: GraspMap.from_dict(LADDER))
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def whole(path, content):
    """Whether a file that a command wrote is complete."""
    if content.startswith(b"{"):
        return bool(json.loads(content))
    if content.startswith(b"<?xml"):
        return content.endswith(b"</svg>\n")
    return content.startswith((b"\x89PNG", b"<mujoco")) or path.endswith(".csv")


def check(given, folder):
    """Run a command in a folder; nothing but a documented end is accepted."""
    before = contents(folder)
    out, err = io.TextIOWrapper(io.BytesIO(), encoding="utf-8"), io.StringIO()
    streams = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with contextlib.chdir(folder), bounded(), streams[0], streams[1]:
        try:
            code = main(given)
        except SystemExit as ended:
            code = ended.code
    assert code in (0, 1, 2, 3), given
    out.flush()
    told, after = err.getvalue(), contents(folder)
    if told.startswith("mlivr-gym: existing files to be replaced"):  # said before the work begins
        told = told.split("\n", 1)[1]
    if code > 1:
        assert told.startswith("mlivr-gym: "), told
        assert told.count("\n") == 1, told
        assert len(told) < 12_000
        assert after == before, given
    for path, content in after.items():
        assert Path(path).name[0] != "."
        assert before.get(path) == content or whole(path, content)
    return code


@pytest.mark.parametrize("command", COMMANDS)
@given(st.data())
@few(0.04)
def test_whatever_is_typed_ends_as_documented(quick, originals, command, data):
    given = data.draw(lines(command))
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(originals, folder, dirs_exist_ok=True)
        check(given, Path(folder))


@given(mutated(LADDER), mutated(ROBOT), mutated(OBSTACLES), st.sampled_from(["plan", "info"]))
@few(0.07)
def test_whatever_is_in_the_files_ends_as_documented(
    quick, originals, world, robot, boxes, command
):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, data in (("map", world), ("robot", robot), ("obstacles", boxes)):
            (folder / f"{file}.json").write_text(json.dumps(data))
        for extra in (["--robot", "robot.json"], ["--obstacles", "obstacles.json"]):
            check([command, *MAP, *extra], folder)


@pytest.mark.parametrize(
    ("given", "code"),
    [
        (["info", "a\nb"], 2),
        (["info", "--robot", "a\nb"], 2),
        (["plan", *MAP, "--out", "new\udc80.json"], 0),
        (["plan", *MAP, "--out", "a\0b"], 2),
        (["evaluate", "--policy", ""], 2),
        (["evaluate", "--policy", "n" * 300], 2),
        (["train", "--method", "bc", "--out", ""], 2),
        (["plan", *MAP, "--goal", "2.9", "0.9", "1.9"], 3),
        (["plan", *MAP, "--start", "R9:0", "R0:1"], 2),
        (["info", "--help"], 0),
        (["simulate", *MAP, "--plan", "plan.json", "--no-film"], 2),
    ],
)
def test_what_was_found_once_and_every_end_are_as_documented(
    quick, originals, tmp_path, given, code
):
    shutil.copytree(originals, tmp_path, dirs_exist_ok=True)
    assert check(given, tmp_path) == code
