import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image

from mlivr_gym import stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.cli.table1 import default_setup
from mlivr_gym.errors import RenderError
from mlivr_gym.pictures.film import film
from mlivr_gym.planners import Plan, Planner


def run(capsys, *arguments):
    code = main(list(arguments))
    out, err = capsys.readouterr()
    return code, out, err


def test_plan_with_defaults(capsys):
    code, out, _ = run(capsys, "plan")
    setup = default_setup()
    plan = Planner(stance_graph()).plan(setup["start"], setup["goal"], "base").unwrap()
    assert code == 0
    assert f": {len(plan.steps)} steps, {plan.base_translation:.3f} m" in out


def test_plan_writes_plan_and_picture(capsys, tmp_path, jem):
    plan, picture = tmp_path / "plan.json", tmp_path / "plan.png"
    code, out, _ = run(
        capsys, "plan", "--start", "D2a:4", "D2b:4", "--goal", "6.0", "0", "0.42", "--cost",
        "steps",
        "--out", str(plan), "--picture", str(picture),
    )  # fmt: skip
    assert code == 0
    assert "plan.json" in out
    loaded = Plan.load(plan, jem)
    assert loaded.stances[0] == ("D2a:4", "D2b:4")
    assert len(loaded.steps) == 4
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "extra", [["--no-manipulability"], ["--no-transitions"], ["--robot", "mlivr3"]]
)
def test_plan_variants(capsys, extra):
    code, out, _ = run(capsys, "plan", *extra)
    assert code == 0
    assert "states explored" in out


def test_own_map_and_robot(capsys, tmp_path):
    rails = [
        {
            "id": f"R{k}",
            "face": "deck",
            "start": [x, -0.4, 0],
            "end": [x, 0.4, 0],
            "normal": [0, 0, 1],
        }
        for k, x in enumerate((0.0, 0.9, 1.8))
    ]
    world, robot = tmp_path / "map.json", tmp_path / "robot.json"
    world.write_text(
        json.dumps({"segments": rails, "cabin": {"min": [-1, -1, 0], "max": [3, 1, 2]}})
    )
    robot.write_text(json.dumps({"name": "own", "tool_length": 0.1}))
    code, out, _ = run(capsys, "plan", "--map", str(world), "--robot", str(robot))
    assert code == 0
    assert "steps" in out
    code, out, _ = run(capsys, "info", "--map", str(world), "--robot", str(robot))
    assert code == 0
    assert "map map" in out
    assert "robot own" in out


def test_info_counts(capsys):
    code, out, _ = run(capsys, "info")
    assert code == 0
    assert "331 points on 46 tracks" in out
    assert "43540" in out
    assert "handrails: 18" in out
    code, out, _ = run(capsys, "info", "--robot", "mlivr4")
    assert code == 0
    assert "4 limbs" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan", "--start", "D1a:4", "Q:1"], "'Q:1'"),
        (["plan", "--start", "D1a:4"], "must name 2 points"),
        (["plan", "--goal", "60", "0", "0"], "outside the cabin"),
        (["plan", "--goal", "nan", "0", "0"], "finite"),
        (["plan", "--cost", "fast"], "'fast'"),
        (["plan", "--cost", "weighted"], "regrasp_price"),
        (["plan", "--limb-threshold", "-1"], "limb_threshold"),
        (["plan", "--robot", "robocop"], "'robocop'"),
        (["plan", "--map", "nowhere.json"], "nowhere.json"),
        (["plan", "--out", "no/such/folder/plan.json"], "cannot write"),
        (["render", "--plan", "nowhere.json"], "nowhere.json"),
        (["render", "--size", "1", "1"], "--size"),
        (["render", "--stance", "2"], "--stance needs --plan"),
        (["plan", "--clearance", "1e300"], "clearance is 1e+300 m"),
        (["plan", "--cost", "weighted", "--regrasp-price", "1e300"], "regrasp_price is 1e+300"),
        (["plan", "--box", "3200", "-1000", "-1000", "3500", "1000", "300"], "millimetres"),
        (["plan", "--limit", "0"], "limit is 0"),
        (["evaluate", "--seed", "-1"], "--seed is -1"),
        (["evaluate", "--policy", "astar", "--episodes", "0"], "--episodes is 0"),
        (["evaluate", "--beam", "0"], "--beam is 0"),
        (["train", "--seed", "9" * 30], "--seed is 999"),
        (["dataset", "--episodes", "-3"], "--episodes is -3"),
    ],
)
def test_bad_input_gives_one_sentence_and_code_2(capsys, arguments, words):
    code, _, err = run(capsys, *arguments)
    assert code == 2
    assert words in err
    assert err.startswith("mlivr-gym: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--start", "D1a:4", "D2b:4"], "below the threshold"),
        (["--goal", "9.5", "0", "0"], "no stance that can be reached"),
        (["--goal", "9.5", "0", "0", "--limit", str(10**30)], "no stance that can be reached"),
        (["--limit", "1"], "limit reached"),
        (["--start", "D2a:4", "D2b:4", "--occupied", "D2a:4"], "point 'D2a:4' is occupied"),
    ],
)
def test_no_plan_gives_one_sentence_and_code_3(capsys, arguments, words):
    code, _, err = run(capsys, "plan", *arguments)
    assert code == 3
    assert words in err
    assert err.startswith("mlivr-gym: ")
    assert err.count("\n") == 1


def test_a_start_that_cannot_be_held_is_no_plan_also_where_the_goal_is_drawn(capsys, tmp_path):
    """On an own map, where the goal has no default; but a point that is not there is bad input."""
    rails = [
        {
            "id": f"R{k}",
            "face": "deck",
            "start": [x, -0.4, 0],
            "end": [x, 0.4, 0],
            "normal": [0, 0, 1],
        }
        for k, x in enumerate((0.0, 0.9, 1.8))
    ]
    world = tmp_path / "map.json"
    world.write_text(
        json.dumps({"segments": rails, "cabin": {"min": [-1, -1, 0], "max": [3, 1, 2]}})
    )
    code, _, err = run(
        capsys, "plan", "--map", str(world), "--start", "R0:0", "R0:1", "--occupied", "R0:0"
    )
    assert code == 3
    assert "cannot be held" in err
    code, _, err = run(capsys, "plan", "--map", str(world), "--start", "R0:0", "R9:1")
    assert code == 2
    assert "'R9:1'" in err


def test_the_help_tells_the_exit_codes(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capsys.readouterr().out
    assert all(f"\n  {code:<3}  " in out for code in (0, 1, 2, 3, 130))
    assert "no plan" in out


@pytest.mark.parametrize(
    "arguments", [[], ["fly"], ["plan", "--goal", "a", "b", "c"], ["plan", "--wings"]]
)
def test_bad_usage_gives_one_sentence_and_code_2(capsys, arguments):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("command", [[], ["plan"], ["table1"], ["info"], ["render"]])
def test_help(capsys, command):
    with pytest.raises(SystemExit) as stop:
        main([*command, "--help"])
    assert stop.value.code == 0
    out = capsys.readouterr().out
    assert "usage: mlivr-gym" in out
    if command != ["table1"]:
        assert "mlivr-gym plan --start D2a:4 D2b:4" in out


def test_render_falls_back_without_gl(tmp_path):
    """With a GL library that is not there a matplotlib picture is drawn, and one line says so."""
    environment = os.environ | {"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "osmesa"}
    out = tmp_path / "scene.png"
    command = [
        sys.executable,
        "-m",
        "mlivr_gym.cli.main",
        "render",
        "--start",
        "D2a:4",
        "D2b:4",
        "--out",
        str(out),
    ]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    lines = [line for line in done.stdout.splitlines() if "no GL" in line]
    assert len(lines) <= 1


@pytest.fixture(scope="module")
def plan_file(checked_graph, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plan.json"
    Planner(checked_graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps").unwrap().save(path)
    return path


def test_render_writes_the_file_that_is_named_and_no_other(capsys, tmp_path, plan_file):
    """Start and goal side by side, and each of them alone."""
    seen = {}
    for name, extra in (
        ("both.png", []),
        ("start.png", ["--stance", "0"]),
        ("goal.png", ["--stance", "4"]),
    ):
        out = tmp_path / name
        arguments = ["--plan", str(plan_file), "--out", str(out), "--size", "80", "40", *extra]
        code, told, _ = run(capsys, "render", *arguments)
        assert code == 0
        assert f"picture: {out}" in told
        seen[name] = np.asarray(Image.open(out))
        assert {path.name for path in tmp_path.iterdir()} == set(seen)
    if seen["start.png"].shape == (40, 80, 3):  # rendered, not drawn without a GL library
        np.testing.assert_array_equal(
            seen["both.png"], np.hstack([seen["start.png"], seen["goal.png"]])
        )
    assert (seen["start.png"] != seen["goal.png"]).any()
    code, _, err = run(
        capsys,
        "render",
        "--plan",
        str(plan_file),
        "--stance",
        "5",
        "--out",
        str(tmp_path / "x.png"),
    )
    assert code == 2
    assert "--stance is 5; this plan has stances 0 (start) to 4 (goal)" in err


def test_a_plan_of_another_map_or_with_a_branch_too_many_is_refused(capsys, tmp_path, plan_file):
    data = json.loads(plan_file.read_text())
    data["branches"][1][0] = 1_000_000
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(data))
    for command in ("simulate", "render"):
        code, _, err = run(capsys, command, "--plan", str(path), "--out", str(tmp_path / "out"))
        assert code == 2
        assert "branches" in err
        assert "from 0 to 7" in err
        assert err.count("\n") == 1


def test_ctrl_c_ends_a_search_with_one_line_and_130(tmp_path):
    """Also in the middle of the compiled search, which would go on for a minute."""
    code = """
import signal
from mlivr_gym import stance_graph
from mlivr_gym.cli.main import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores the signal
print("ready", flush=True)
exit(main(["plan", "--method", "dijkstra"]))
"""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(2.5)
        process.send_signal(signal.SIGINT)
        began = time.perf_counter()
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert (out, err) == ("", "mlivr-gym: interrupted\n")
    assert time.perf_counter() - began < 10.0


@pytest.mark.parametrize("error", [KeyboardInterrupt(), KeyboardInterrupt("two of three done")])
def test_an_interruption_is_told_in_one_line(capsys, monkeypatch, error):
    def stop(_):
        raise error

    monkeypatch.setattr("mlivr_gym.cli.main._info", stop)
    code, out, err = run(capsys, "info")
    assert code == 130
    assert out == ""
    assert err == f"mlivr-gym: {str(error) or 'interrupted'}\n"


def test_table1_holds_every_relation(capsys, tmp_path):
    code, _, _ = run(capsys, "table1", "--out", str(tmp_path / "results"))
    assert code == 0
    made = {path.name for path in (tmp_path / "results").iterdir()}
    assert made == {
        "table1.md",
        "table1.json",
        "scene_start.png",
        "scene_goal.png",
        *(f"case{k}{kind}.png" for k in (1, 2, 3, 4) for kind in ("", "_collisions")),
    }
    data = json.loads((tmp_path / "results" / "table1.json").read_text())
    assert len(data["relations"]) == 16
    assert all(data["relations"].values())


def test_simulate_leaves_measurements_plot_and_film(capsys, tmp_path, checked_graph):
    goal = (
        Planner(checked_graph)
        .plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps")
        .unwrap()
        .base_positions[1]
    )
    code, out, _ = run(
        capsys, "simulate", "--start", "D2a:4", "D1b:3", "--goal", *(f"{x:.6f}" for x in goal),
        "--cost", "steps",
        "--duration", "20", "--frames", "2", "--size", "64", "32", "--out", str(tmp_path / "walk"),
    )  # fmt: skip
    assert code == 0
    assert "1 of 1 steps carried out, 22 s simulated" in out
    assert "took hold of" in out
    summary = json.loads((tmp_path / "walk" / "simulation.json").read_text())
    assert summary["success"]
    assert summary["captures"][0]["distance"] < 0.01
    assert (tmp_path / "walk" / "simulation.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "walk" / "trajectory.csv").read_text().startswith("time_s,step,phase")
    assert "no film" in out or (tmp_path / "walk" / "walk.gif").read_bytes().startswith(b"GIF8")
    with pytest.raises(RenderError, match="valid endings"):
        film(checked_graph.grasp_map, checked_graph.robot, None, tmp_path / "walk.avi")
    plan = str(tmp_path / "walk" / "plan.json")
    code, out, _ = run(
        capsys,
        "simulate",
        "--plan",
        plan,
        "--duration",
        "3",
        "--no-film",
        "--out",
        str(tmp_path / "fast"),
    )
    assert code == 1
    assert "failed at" in out
    assert "hint: slower steps may succeed, try --duration " in out
    failure = json.loads((tmp_path / "fast" / "simulation.json").read_text())["failure"]
    assert failure["message"] in out
    assert failure["phase"] in ("departure", "swing", "approach")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--plan", "no.json"], "cannot read plan"),
        (["--plan", "x.json", "--case", "3"], "give either"),
        (["--case", "3", "--duration", "0"], "must be finite and above 0"),
        (["--case", "3", "--frames", "1"], "--frames 1"),
        (["--case", "3", "--film", "walk.avi"], "valid endings"),
    ],
)  # fmt: skip
def test_simulate_says_what_is_wrong(capsys, tmp_path, arguments, message):
    code, _, err = run(capsys, "simulate", *arguments, "--out", str(tmp_path))
    assert code == 2
    assert message in err
