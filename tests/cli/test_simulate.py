"""The commands `simulate` and `render`."""

import json
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from mlivr_gym.cli.render import shots_of
from mlivr_gym.cli.simulate import FILES
from mlivr_gym.errors import RenderError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.films import check_film_format
from mlivr_gym.planners import Planner


def test_simulate_leaves_measurements_plot_and_film(run, tmp_path, checked_graph):
    planner = Planner(checked_graph)
    plan = planner.plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()
    goal = " ".join(f"{x:.6f}" for x in plan.motion.base_positions[1])
    code, out, _ = run(
        f"simulate --start D2a:4 D1b:3 --goal {goal} --cost steps --duration 15 "
        f"--controller feedforward --speed 100 --size 64 32 --out {tmp_path / 'walk'}"
    )
    assert code == 0
    assert "1 of 1 steps executed, 17.0 s simulated" in out
    assert "grasped " in out
    summary = json.loads((tmp_path / "walk" / "simulation.json").read_text())
    assert summary["success"]
    assert summary["captures"][0]["distance"] < 0.01
    assert (tmp_path / "walk" / "simulation.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "walk" / "simulation.svg").read_text().startswith("<?xml")
    assert f"plot: {tmp_path / 'walk' / 'simulation.png'}, " in out
    assert {path.name for path in (tmp_path / "walk").iterdir()} <= {*FILES, "walk.gif"}
    assert (tmp_path / "walk" / "trajectory.csv").read_text().startswith("time_s,step,phase")
    gif = tmp_path / "walk" / "walk.gif"
    assert gif.exists() == ("no film" not in out)
    assert not gif.exists() or gif.read_bytes().startswith(b"GIF8")
    with pytest.raises(RenderError, match="valid endings"):
        check_film_format(tmp_path / "walk.avi")
    plan = tmp_path / "walk" / "plan.json"
    code, _, err = run(f"simulate --plan {plan} --duration 3 --no-film --out {tmp_path / 'fast'}")
    assert code == 2
    assert "a step of 3 s breaks the limit " in err
    assert "the shortest duration that keeps all limits is " in err
    assert not (tmp_path / "fast").exists()
    own = plan.read_text() + "\n"  # the plan of the folder of the results stays as it is
    plan.write_text(own)
    code, out, _ = run(
        f"simulate --plan {plan} --pace paper --controller paper --disturbances all --no-film "
        f"--out {tmp_path / 'walk'}"
    )
    assert code == 1
    assert plan.read_text() == own
    failure = json.loads((tmp_path / "walk" / "simulation.json").read_text())["failure"]
    place = f"in the {failure['phase']} of step {failure['step'] + 1} ({failure['kind']}): "
    assert f"failed at {failure['time']:.2f} s {place}" in out
    assert failure["message"] in out
    assert failure["phase"] in ("departure", "swing", "approach")


def test_render_says_once_that_there_is_no_gl(run, tmp_path, monkeypatch):
    """And draws with matplotlib, which needs none."""

    missing = Mock(side_effect=RenderError("MuJoCo has no GL library here"))
    monkeypatch.setattr("mlivr_gym.cli.render.SceneRenderer", missing)
    out = tmp_path / "scene.png"
    code, told, _ = run("render", "--start", "D2a:4", "D2b:4", "--out", str(out))
    assert code == 0
    assert [line for line in told.splitlines() if "matplotlib" in line] == [
        "no GL library can be used, so matplotlib draws instead: MuJoCo has no GL library here"
    ]
    assert out.read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.png"]


def test_ghosts_stand_in_the_stances_that_follow(plan_file, jem):
    plan = Plan.load(plan_file)
    last = len(plan.stances) - 1
    assert last > 1
    for k, shot in enumerate(shots_of(jem, plan, range(last + 1))):
        bases = [shot.configuration, *shot.ghosts]
        np.testing.assert_array_equal(
            [base for base, *_ in bases], [plan.configuration(n)[0] for n in range(k, last + 1)]
        )
        assert (f"pale: stances {k + 1} to {last}" in shot.captions[0]) == (k < last)
        assert shot.captions[0].startswith(f"stance {k} of {last}")
        assert ("the start" in shot.captions[0]) == (k == 0)
        assert ("the goal" in shot.captions[0]) == (k == last)


def test_render_writes_the_file_that_is_named_and_no_other(run, tmp_path, plan_file):
    """Start and goal side by side, and each of them alone."""
    seen = {}
    for name, extra in (
        ("both.png", []),
        ("start.png", ["--stance", "0"]),
        ("goal.png", ["--stance", "4"]),
    ):
        out = tmp_path / name
        arguments = ["--plan", str(plan_file), "--out", str(out), "--size", "80", "40", *extra]
        code, told, _ = run("render", *arguments)
        assert code == 0
        assert f"picture: {out}" in told
        seen[name] = np.asarray(Image.open(out))
        assert {path.name for path in tmp_path.iterdir()} == set(seen)
    if seen["start.png"].shape == (40, 80, 3):  # rendered, not drawn without a GL library
        np.testing.assert_array_equal(
            seen["both.png"], np.hstack([seen["start.png"], seen["goal.png"]])
        )
    assert (seen["start.png"] != seen["goal.png"]).any()
