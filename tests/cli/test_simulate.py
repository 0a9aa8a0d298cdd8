"""The command `simulate`."""

import json

import pytest

from mlivr_gym.cli.simulate import FILES
from mlivr_gym.errors import RenderError
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
