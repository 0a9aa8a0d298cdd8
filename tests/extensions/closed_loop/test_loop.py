"""The closed loop arrives among things that its map lacks, or stops where it is."""

import json
from dataclasses import dataclass

import pytest
from loop_walks import BAG, CAMERA, GOAL, START, kinds

from mlivr_gym import Box, MlivrError, stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.extensions.closed_loop import depth_camera, loop
from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.loop import run_closed_loop
from mlivr_gym.extensions.closed_loop.record import (
    ARRIVED,
    FAILED,
    LINES,
    STOPPED,
    ClosedLoopRecord,
    Footage,
)
from mlivr_gym.extensions.closed_loop.sensing_robot import NOTICED
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.simulation.parameters import PAPER
from mlivr_gym.simulation.recording import Failure
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.step_executor import StepExecutor


@pytest.fixture(scope="module")
def plan(graph):
    return Planner(graph).plan(START, GOAL, "steps").unwrap()


def test_without_surprises_it_takes_the_steps_of_the_plan(graph, plan):
    record = run_closed_loop(graph, START, GOAL, camera=CAMERA, max_steps=len(plan.steps))
    assert record.outcome == ARRIVED
    assert record.steps == len(plan.steps)
    assert record.state.stance == tuple(graph.indices(plan.stances[-1]))
    assert not record.sensed
    assert not record.refused
    assert record.plans == [(record.plans[0][0], len(plan.steps))]  # it never changes its mind
    assert 0.0 < record.peak_force < 100.0


def test_a_point_to_which_no_swing_leads_is_avoided(graph, plan, monkeypatch):
    limb, point = plan.actions[0]
    prepared = StepExecutor.prepared

    def without(executor, moving, to, *rest):
        if to == graph.grasp_map.index(point):
            return Failure("no swing", 0.0, 0, "departure", moving, "no swing was found", {})
        return prepared(executor, moving, to, *rest)

    monkeypatch.setattr(StepExecutor, "prepared", without)
    record = run_closed_loop(graph, START, GOAL, max_steps=2)
    assert record.steps > 0
    assert record.refused == (point,)
    blocked = [event.values for event in record.events if event.kind == "blocked"]
    assert blocked == [{"limb": limb, "point": point, "failure": "no swing"}]


def test_the_same_seed_gives_the_same_walk(graph):
    walks = [
        run_closed_loop(graph, START, GOAL, unknown=[BAG], camera=CAMERA, seed=seed, max_steps=1)
        for seed in (3, 3, 4)
    ]
    one, again, other = walks
    assert one.sensed
    assert kinds(again) == kinds(one)
    assert again.duration == one.duration
    assert again.sensed == one.sensed
    assert other.sensed != one.sensed


class LateCamera(DepthCamera):
    """Cameras that see nothing before the first step has begun."""

    def measure(self, model, data, robot, rng):
        hits = super().measure(model, data, robot, rng)
        return hits if data.time > 0.0 else hits[:0]


def test_what_it_sees_during_a_step_turns_it_back(graph, plan):
    """A small box above the first point that the plan grasps."""
    point = graph.grasp_map.index(plan.steps[0].to_point)
    middle = graph.grasp_map.positions[point] + 0.25 * graph.grasp_map.normals[point]
    box = Box.between("small", "obstacle", middle - 0.05, middle + 0.05)
    blind = run_closed_loop(graph, START, GOAL, unknown=[box])
    assert (blind.outcome, blind.steps) == (FAILED, 0)
    camera = LateCamera(pixels=28, period=0.5)
    record = run_closed_loop(graph, START, GOAL, unknown=[box], camera=camera, max_steps=3)
    assert record.steps > 0
    first = next(event for event in record.events if event.kind in ("blocked", "step"))
    assert first.kind == "blocked"
    assert first.values["point"] == plan.steps[0].to_point
    assert record.peak_force < 60.0


def test_it_stops_where_no_way_is_left(graph, plan):
    graph.occupy([point for point in graph.grasp_map.ids if point not in _points(plan)])
    record = run_closed_loop(graph, START, GOAL, refusing=sorted(_points(plan) - set(START)))
    graph.vacate()
    assert record.outcome == STOPPED
    assert record.reason
    assert record.proved
    assert record.refused  # it tried what the plan offers
    assert record.steps == 0
    assert kinds(record)[-1] == "end"


def test_a_planner_without_effort_to_plan_proves_nothing(jem, monkeypatch):
    for name in ("GOOD", "ANY"):
        monkeypatch.setattr(loop, name, SearchOptions(effort=1))
    graph = stance_graph(jem, robot_spec("mlivr3"))
    record = run_closed_loop(graph, ("D3a:8", "D3a:1", "D3a:4"), (4.2, 0.0, 0.42))
    assert (record.outcome, record.proved, record.steps) == (STOPPED, False, 0)
    assert "limit reached" in record.reason


def test_a_point_that_refuses_on_the_way_back_from_a_blocked_path_ends_the_walk(
    graph, plan, monkeypatch
):
    """It is no try of the point to which the limb was on its way, and there is no other way back.

    A limb that went back as from that point would begin with a jump, and touch something.
    """
    limb = plan.actions[0][0]
    origin, looks = plan.stances[0][limb], []

    def is_blocked(belief, path, sample):
        looks.append(sample)
        return len(looks) == 2

    def refuses(simulation, point):
        return point == graph.grasp_map.index(origin)

    monkeypatch.setattr(Belief, "is_blocked", is_blocked)
    monkeypatch.setattr(Simulation, "refuses", refuses)
    record = run_closed_loop(graph, START, GOAL, camera=CAMERA)
    assert (record.outcome, record.steps) == (FAILED, 0)
    assert record.reason.startswith("on the way back, refused grasp: ")
    assert repr(origin) in record.reason
    assert not record.refused
    assert kinds(record) == ["planned", "end"]


def test_it_takes_no_more_steps_than_it_may_or_needs(graph):
    record = run_closed_loop(graph, START, GOAL, max_steps=1)
    assert (record.outcome, record.steps) == (STOPPED, 1)
    here = graph.posture_of(graph.state(START)).base_position[0]
    record = run_closed_loop(graph, START, here.tolist())
    assert (record.outcome, record.steps, record.footage) == (ARRIVED, 0, None)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"refusing": [START[0]]}, "holds at the start"),
        ({"unknown": [BAG, BAG]}, "bag"),
        (
            {"unknown": [Box.between("here", "obstacle", (2, 0, -0.6), (3, 1, 0))]},
            r"here.* touch at the start",
        ),
    ],
)
def test_wrong_arguments_are_named(graph, given, named):
    task = {"start": START, "goal": GOAL} | given
    with pytest.raises(MlivrError, match=named):
        run_closed_loop(graph, **task)


def _points(plan):
    """Return the ids of all points of a plan."""
    return {point for stance in plan.stances for point in stance}


def test_an_error_of_the_cameras_is_raised_and_the_graph_is_as_it_was(graph, monkeypatch):
    def fails(*_):
        raise RuntimeError("no picture")

    monkeypatch.setattr(DepthCamera, "measure", fails)
    with pytest.raises(RuntimeError, match="no picture"):
        run_closed_loop(graph, START, GOAL, unknown=[BAG], camera=CAMERA)
    assert graph.obstacles == ()


UNKNOWN = ["--unknown", *map(str, BAG.bounds.ravel())]
WALK = ["walk", "--start", *START, "--goal", "2.8", "0.0", "0.0"]


@dataclass(frozen=True)
class CoarseCamera(depth_camera.DepthCamera):
    """Cameras that take less time."""

    pixels: int = 28
    period: float = 1.0


def test_it_tells_and_writes_what_happened(tmp_path, capsys, graph, monkeypatch):
    """The first point that it reaches for refuses the grasp; the bag is not in the way to it."""
    out, picture = tmp_path / "walk.json", tmp_path / "walk.png"
    files = ["--out", str(out), "--picture", str(picture)]
    plan = Planner(graph).plan(START, (2.8, 0.0, 0.0), "steps").unwrap()
    refusing = plan.actions[0][1]
    monkeypatch.setattr(depth_camera, "DepthCamera", CoarseCamera)
    code = main([*WALK, *UNKNOWN, "--refusing", refusing, *files])
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
    assert main([*WALK, "--film", str(tmp_path / "walk.avi")]) == 2
    assert not asked
    film = ["--film", str(tmp_path / "walk.gif")]
    assert main([*WALK, *film, "--controller", "paper"]) == 3
    assert asked[0]["filmed"]
    assert asked[0]["setup"].controller == PAPER
    assert "no film: the robot did not move" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_each_kind_of_failure_that_is_noticed_has_its_line():
    values = {"limb": 1, "point": "D2a:4", "failure": "missed grasp"}
    for failure, kind in NOTICED.items():
        assert "limb 1" in LINES[kind].format(**values | {"failure": failure})


def test_a_blind_robot_collides_with_what_it_does_not_know(capsys):
    assert main(["walk", "--start", *START, "--goal", *map(str, GOAL), *UNKNOWN, "--blind"]) == 1
    assert "collision" in capsys.readouterr().out
