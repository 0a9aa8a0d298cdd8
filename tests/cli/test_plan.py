"""The commands `plan` and `info`."""

import inspect
import json
import math

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

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
    ("line", "code", "words"),
    [
        ("--start D1a:4 D2b:4", 3, "below the threshold"),
        ("--goal 9.5 0 0", 3, "no stance has its base within 0.2 m of goal [9.5, 0.0, 0.0]"),
        ("--limit 1", 3, "limit reached"),
        ("--start D2a:4 D2b:4 --occupied D2a:4", 3, "point 'D2a:4' is occupied"),
        # On a map without a default goal, where one is drawn.
        ("--map LADDER --start R0:0 R0:1 --occupied R0:0", 3, "cannot be held"),
        ("--map LADDER --start R0:0 R9:1", 2, "'R9:1'"),
    ],
)
def test_no_plan_gives_one_sentence_and_code_3_and_bad_input_2(run, ladder_file, line, code, words):
    found, _, err = run("plan " + line.replace("LADDER", str(ladder_file)))
    assert found == code
    assert words in err
    assert err.startswith("mlivr-gym: ")
    assert err.count("\n") == 1


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


def test_the_module_and_its_robots_are_told(run):
    told = json.loads(run("info", "--json")[1])
    counts = told["map"]["points"], told["map"]["segments"], told["map"]["handrails"]
    assert counts == (331, 46, 18)
    assert told["stance_graph"]["pairs_within_span"] == 43540
    text = run("info")[1]
    assert "  pairs within span: 43540\n" in text
    assert "\n  w_m: 0.1" in text  # a symbol, not words


def test_every_count_of_the_stance_graph_is_that_of_its_stances(run, tmp_path, ladder):
    """Steps and connected parts by comparing all pairs of stances, SciPy's components."""
    world = tmp_path / "ladder.json"
    world.write_text(json.dumps(ladder.to_dict()))
    told = json.loads(run("info", "--map", str(world), "--json")[1])["stance_graph"]
    graph = stance_graph(ladder)
    points, bases = graph.points, graph.base_position
    one = (points[:, None] != points[None]).sum(axis=2) == 1
    count, part = connected_components(one, directed=False)
    assert told["steps_before_checks"] == one.sum()
    assert told["connected_parts"] == count
    assert told["stances_of_the_largest_part"] == np.bincount(part).max()
    longest = np.linalg.norm(bases[:, None] - bases[None], axis=2)[one].max()
    assert abs(told["longest_step"] - longest) < 1e-12
    postures = graph.postures_of([graph.state(stance) for stance in points.tolist()])
    np.testing.assert_allclose(told["w_m"], [postures.w_m.min(), postures.w_m.max()], rtol=1e-12)
    left_out = told["stances_left_out"]
    assert told["stances"] == len(points)
    assert sum(left_out.values()) == told["pairs_within_span"] - len(points)
    assert left_out["reach"] == told["pairs_within_span"] - told["stances_reachable"]
