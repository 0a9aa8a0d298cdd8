"""The command `walk` tells what happens in a line each, and writes the record."""

import json
from dataclasses import dataclass

from mlivr_gym.cli.main import main
from mlivr_gym.extensions.closed_loop import depth_camera
from mlivr_gym.extensions.closed_loop.record import (
    LINES,
    STOPPED,
    ClosedLoopRecord,
    Footage,
)
from mlivr_gym.extensions.closed_loop.sensing_robot import NOTICED
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.parameters import PAPER

START = ["walk", "--start", "D2a:4", "D2b:4"]
BAG = ["--unknown", "3.5", "-0.35", "-0.9", "3.8", "0.35", "0.0"]
GOAL, FAR_GOAL = (["--goal", x, "0.0", z] for x, z in (("2.8", "0.0"), ("4.2", "0.42")))


@dataclass(frozen=True)
class CoarseCamera(depth_camera.DepthCamera):
    """Cameras that take less time."""

    pixels: int = 28
    period: float = 1.0


def test_it_tells_and_writes_what_happened(tmp_path, capsys, checked_graph, monkeypatch):
    """The first point that it reaches for refuses the grasp; the bag is not in the way to it."""
    out, picture = tmp_path / "walk.json", tmp_path / "walk.png"
    files = ["--out", str(out), "--picture", str(picture)]
    plan = Planner(checked_graph).plan(("D2a:4", "D2b:4"), (2.8, 0.0, 0.0), "steps").unwrap()
    refusing = plan.actions[0][1]
    monkeypatch.setattr(depth_camera, "DepthCamera", CoarseCamera)
    code = main([*START, *GOAL, *BAG, "--refusing", refusing, *files])
    lines = capsys.readouterr().out.splitlines()
    record = json.loads(out.read_text())
    assert (code, record["outcome"]) == (0, "arrived")
    assert record["refused"] == [refusing]
    assert picture.read_bytes().startswith(b"\x89PNG")
    events, told = record["events"], [line for line in lines if " s  " in line]
    assert {event["kind"] for event in events} == {"sensed", "planned", "refused", "step", "end"}
    for line, event in zip(told, events, strict=True):
        assert float(line.split(" s  ")[0]) == round(event["time"], 1)
        if event["kind"] == "step":
            assert f"limb {event['limb']} takes {event['point']}" in line


def test_a_film_and_a_controller_are_asked_for_before_the_walk(tmp_path, capsys, monkeypatch):
    """No walk begins if the film cannot be written; another controller is that of the setup."""
    asked = []

    def walk(*_, **given):
        asked.append(given)
        return ClosedLoopRecord(STOPPED, "it may not", footage=Footage())

    monkeypatch.setattr("mlivr_gym.extensions.closed_loop.loop.run_closed_loop", walk)
    assert main([*START, *GOAL, "--film", str(tmp_path / "walk.avi")]) == 2
    assert not asked
    film = ["--film", str(tmp_path / "walk.gif")]
    assert main([*START, *GOAL, *film, "--controller", "paper"]) == 3
    assert asked[0]["filmed"]
    assert asked[0]["setup"].controller == PAPER
    assert "no film: the robot did not move" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_each_kind_of_failure_that_is_noticed_has_its_line():
    values = {"limb": 1, "point": "D2a:4", "failure": "missed grasp"}
    for failure, kind in NOTICED.items():
        assert "limb 1" in LINES[kind].format(**values | {"failure": failure})


def test_a_blind_robot_collides_with_what_it_does_not_know(capsys):
    assert main([*START, *FAR_GOAL, *BAG, "--blind"]) == 1
    assert "collision" in capsys.readouterr().out
