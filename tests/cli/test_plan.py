"""The command `plan`."""

import inspect
import math

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.cli.arguments import search_options
from mlivr_gym.cli.main import _parser
from mlivr_gym.paper import default_setup
from mlivr_gym.planners import Plan, Planner


def test_plan_with_defaults(run):
    code, out, _ = run("plan")
    setup = default_setup()
    plan = Planner(stance_graph()).plan(setup["start"], setup["goal"], "base").unwrap()
    assert code == 0
    assert f": {len(plan.steps)} steps, {plan.base_translation:.3f} m" in out


def test_the_command_searches_as_far_as_the_function():
    defaults = inspect.signature(Planner.plan).parameters
    args = _parser(["plan"]).parse_args(["plan"])
    assert search_options(args) == {name: defaults[name].default for name in search_options(args)}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--start", "D1a:4", "D2b:4"], "below the threshold"),
        (
            ["--goal", "9.5", "0", "0"],
            "no stance has its base within 0.2 m of goal [9.5, 0.0, 0.0]",
        ),
        (["--limit", "1"], "limit reached"),
        (["--start", "D2a:4", "D2b:4", "--occupied", "D2a:4"], "point 'D2a:4' is occupied"),
    ],
)
def test_no_plan_gives_one_sentence_and_code_3(run, arguments, words):
    code, _, err = run("plan", *arguments)
    assert code == 3
    assert words in err
    assert err.startswith("mlivr-gym: ")
    assert err.count("\n") == 1


def test_a_start_that_cannot_be_held_is_no_plan_also_where_the_goal_is_drawn(run, ladder_file):
    """On a map without a default goal; but a point that is not there is bad input."""
    code, _, err = run(f"plan --map {ladder_file} --start R0:0 R0:1 --occupied R0:0")
    assert code == 3
    assert "cannot be held" in err
    code, _, err = run(f"plan --map {ladder_file} --start R0:0 R9:1")
    assert code == 2
    assert "'R9:1'" in err


POINTS = "\n".join(
    [
        "id,x,y,z,nx,ny,nz,rx,ry,rz",
        *(f"P{k},{0.9 * (k // 4)},{0.2 * (k % 4) - 0.3},0,0,0,1,0,1,0" for k in range(16)),
    ]
)
"""The table of points of the page on modules of one's own, with a row more."""


@pytest.mark.parametrize(("given", "end"), [("start", min), ("goal", max)])
def test_what_is_drawn_is_far_from_what_is_given(run, tmp_path, given, end):
    """At either end of the map, so that nothing that is drawn alone is far from both."""
    path, file = tmp_path / "points.csv", tmp_path / "plan.json"
    path.write_text(POINTS)
    graph = stance_graph(path)
    k = list(graph.base_position[:, 0]).index(end(graph.base_position[:, 0]))
    told = graph.ids(graph.points[k]) if given == "start" else graph.base_position[k].tolist()
    told_so = f"--{given}", *map(str, told)
    code, _, err = run("plan", "--map", str(path), *told_so, "--out", str(file))
    assert code == 0, err
    plan = Plan.load(file, graph.grasp_map)
    assert {"start": plan.stances[0], "goal": list(plan.query.goal)}[given] == told
    assert len(plan.steps) > 1
    assert math.dist(plan.motion.base_positions[0], plan.query.goal) > 1.5


def test_a_map_of_points_alone_has_nothing_to_collide_with(run, tmp_path, ladder_file):
    path, told = tmp_path / "points.csv", "map 'points' has no boxes: nothing is known to collide"
    path.write_text(POINTS)
    task = f"--map {path} --start P1 P5 --goal 1.3 0 0.65"
    for line in (f"plan {task}", f"info --map {path}"):
        assert told in run(line)[1]
    box = "--box 9 9 9 10 10 10"
    for line in (f"plan {task} --no-collisions", f"plan {task} {box}", f"info --map {ladder_file}"):
        assert "no boxes" not in run(line)[1]


def test_boxes_and_occupied_points_change_the_plan_and_stay_in_its_file(run, tmp_path, jem):
    """A box across the way, and a point that the plan used."""
    ends = ["--start", "D2a:4", "D1b:3", "--goal", "6.3", "0.5", "0.35"]
    plans = []

    def plan(*more):
        file = tmp_path / f"{len(plans)}.json"
        assert run("plan", *ends, *more, "--out", str(file))[0] == 0
        plans.append(Plan.load(file, jem))
        return plans[-1]

    free = plan()
    middle = free.motion.base_positions[len(free.steps) // 2]
    corners = [*(middle - 0.1), *(middle + 0.1)]
    blocked = plan("--box", *(f"{value:.3f}" for value in corners))
    (box,) = blocked.world.obstacles
    np.testing.assert_allclose(np.array(box.bounds).ravel(), corners, atol=1e-3)
    assert blocked.cost > free.cost
    taken = next(p for stance in free.stances[1:] for p in stance if p not in free.stances[0])
    other = next(point for point in jem.ids if not any(point in s for s in free.stances))
    round_it = plan("--occupied", taken, other)
    assert round_it.world.occupied == tuple(sorted([taken, other], key=jem.index))
    assert not any(taken in stance for stance in round_it.stances)
