"""The planner: why there is no plan, what it promises, costs, and plans within a time limit."""

import itertools
import time

import numpy as np
import pytest
from map_data import few_of_a_wall
from paper import NO_COLLISIONS
from small_tables import small_table
from time_limit import AGES

from mlivr_gym import Box, Settings, stance_graph
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import GoalError, PlanError, SettingError
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.motion import Plan
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.planners.costs import Cost
from mlivr_gym.stances.random_states import random_state


def test_no_path_says_why(graph, jem):
    planner = Planner(graph)
    start = ("D1a:4", "D1b:4")
    result = planner.plan(("D1a:4", "D2b:4"), (6.0, 0.0, 0.42))
    assert (result.reason, bool(result)) == ("start infeasible", False)
    assert "limb manipulability" in result.message
    assert (result.expanded, result.generated, len(result.tree)) == (0, 0, 0)
    result = planner.plan(start, (9.5, 0.0, 0.0))
    assert result.reason == "goal outside the reachable set"
    assert "[9.5, 0.0, 0.0]" in result.message
    result = planner.plan(
        start, (6.0, 0.0, 0.42), options=SearchOptions(heuristic="zero", limit=10)
    )
    assert result.reason == "limit reached"
    assert result.expanded == 10
    with pytest.raises(PlanError, match="limit reached"):
        result.unwrap()
    far = {"D1a", "D1b", "D6a", "D6b", "F6a", "F6b"}
    split = jem.subset(np.array([point.split(":")[0] in far for point in jem.ids]), "split")
    result = Planner(stance_graph(split, settings=NO_COLLISIONS)).plan(start, (6.6, 0.0, -0.4))
    assert result.reason == "goal outside the reachable set"


def test_a_search_that_is_cut_short_promises_no_more_than_it_proved(graph):
    rng, bounds, factor, none = np.random.default_rng(3), [], 1.2, 0
    for _ in range(22):
        first, last = rng.integers(len(graph), size=2)
        start, goal = graph.ids(graph.points[first]), graph.base_position[last]
        best = Planner(graph).plan(start, goal).plan
        for limit in (8, 17, 10_000):
            options = SearchOptions(inflation=factor, limit=limit)
            cut = Planner(graph).plan(start, goal, options=options).plan
            none += cut is None
            if cut is not None:
                bounds.append(cut.statistics.bound)
                assert cut.cost <= bounds[-1] * best.cost * (1.0 + 1e-9)
    assert 1.0 < max(bounds) <= factor
    assert none  # the limit came first


def test_bad_arguments_are_named(graph):
    planner, start, goal = Planner(graph), ("D1a:4", "D1b:4"), (6.0, 0.0, 0.42)
    for error, words, change in (
        (SettingError, "regrasp_price", {"cost": "weighted"}),
        (SettingError, "regrasp_price", {"regrasp_price": 0.1}),
        (GoalError, "outside the cabin", {"goal": (60.0, 0.0, 0.0)}),
    ):
        with pytest.raises(error, match=words):
            planner.plan(**({"start": start, "goal": goal} | change))
    for words, options in (
        ("greedy", {"method": "greedy", "heuristic": "zero"}),
        ("now called 'relaxed'", {"heuristic": "cost_to_go"}),
    ):
        with pytest.raises(SettingError, match=words):
            planner.plan(start, goal, options=SearchOptions(**options))
    many = Planner(stance_graph(graph.grasp_map, "mlivr3", NO_COLLISIONS))
    with pytest.raises(SettingError, match="two limbs"):
        many.cost_to_go(goal)


def test_start_inside_the_goal_is_a_plan_without_steps(graph):
    start = graph.state(("D1a:4", "D1b:4"))
    here = graph.posture(start.stance).base_position[0]
    plan = Planner(graph).plan(start.stance, here).unwrap()
    assert plan.steps == ()
    assert plan.statistics.cost == 0.0
    assert plan.base_translation == 0.0


def test_a_time_limit_gives_the_best_plan_so_far(small_map):
    """With time enough it is the least; each plan on the way is better than the last."""
    three = stance_graph(small_map.subset(np.arange(len(small_map)) % 2 == 0, "few"), "mlivr3")
    rng, planner = np.random.default_rng(1), Planner(three)
    start, goal = sample_task(three, rng, 0.8)
    least = planner.plan(start.stance, goal, "base", options=SearchOptions(inflation=1.0)).unwrap()
    found = planner.plan(start.stance, goal, "base", time_limit=AGES)
    plan = found.unwrap()
    assert plan.cost == pytest.approx(least.cost, abs=1e-9)
    assert plan.statistics.bound == 1.0
    costs = [one.cost for one in found.improvements]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] == plan.statistics.cost
    assert planner.plan(start.stance, goal, "base", time_limit=0.0).reason == "limit reached"


@pytest.fixture(params=[2, 4])
def boxed(request):
    """A graph on a few points with a box, which goes after the test."""
    graph, table = small_table(request.param)
    centre = table.base_position.mean(axis=0) + np.array([0.0, 0.5, 0.0])
    graph.add_obstacles([Box.between("box", "obstacle", centre - 0.1, centre + 0.1)])
    yield graph
    graph.remove_obstacles()


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_what_is_told_is_true_and_does_not_depend_on_the_clock(boxed, cost, monkeypatch):
    rng, told, exact = np.random.default_rng(4), [], 0
    for _ in range(3):
        start, other = random_state(boxed, rng), random_state(boxed, rng)
        goal = boxed.posture_of(other).base_position[0]
        how = {"goal_tolerance": 0.05}
        best = Planner(boxed).plan(start, goal, cost, options=SearchOptions(inflation=1.0), **how)
        for effort in (1, 3000, 10**9):
            how["options"] = SearchOptions(inflation=1.0, effort=effort)
            found = Planner(boxed).plan(start, goal, cost, **how)
            with monkeypatch.context() as patch:  # a machine that takes an hour for each look
                patch.setattr(time, "perf_counter", itertools.count(0.0, 3600.0).__next__)
                again = Planner(boxed).plan(start, goal, cost, **how)
            assert (found.reason, found.expanded) == (again.reason, again.expanded)
            told.append(found.reason)
            if found.plan is None:
                assert found.reason in (best.reason, "limit reached")
                continue
            assert found.plan.actions == again.plan.actions
            assert best.plan.cost - 1e-9 <= found.plan.cost
            bound = found.plan.statistics.bound or np.inf
            assert found.plan.cost <= bound * best.plan.cost + 1e-9
            for one in found.improvements:
                assert one.cost <= one.bound * best.plan.cost + 1e-9
            exact += effort == 10**9 and bound == 1.0
    assert "limit reached" in told
    assert exact


@pytest.mark.parametrize("count", [2, 10_000])
def test_prices_of_another_number_of_points_are_refused(small_graph, count):
    cost, points = Cost.custom(base_weight=1.0, prices=np.ones(count)), len(small_graph.grasp_map)
    planner, goal = Planner(small_graph), (2.5, 0.0, -0.3)
    for ask in (
        lambda: planner.plan((0, 1), goal, cost),
        lambda: planner.cost_to_go(goal, cost),
        lambda: MlivrEnv(map=small_graph.grasp_map, reward=cost),
    ):
        with pytest.raises(SettingError, match=f"{count} numbers; the map has {points} points"):
            ask()


def test_the_plan_of_a_cost_without_a_name_can_be_read_back(small_graph, tmp_path):
    """Whether it is made by `Cost.custom` or by its fields."""
    here = small_graph.points[0].tolist()
    goal = small_graph.base_position[-1]
    assert {cost.name for cost in map(Cost.named, ("base", "steps"))} == {"base", "steps"}
    for cost in (Cost(prices=lambda stances, points: 0.5 * (points % 3)), Cost(base_weight=2.0)):
        plan = Planner(small_graph).plan(here, goal, cost).unwrap()
        assert plan.query.cost_name == cost.name == "custom"
        plan.save(tmp_path / "plan.json")
        assert Plan.load(tmp_path / "plan.json").steps == plan.steps


@pytest.fixture(scope="module", params=[(3, 24), (4, 16)])
def graph_and_stances(request):
    """A graph of three or four limbs on a few points of a wall, and its stances."""
    limbs, count = request.param
    graph = stance_graph(few_of_a_wall(count), f"mlivr{limbs}", NO_COLLISIONS)
    rows = np.array(list(itertools.permutations(range(count), limbs)))
    return graph, rows[graph.is_node(graph.nodes(rows))]


def test_a_goal_to_which_no_moves_lead_is_told(graph_and_stances):
    """At once, with no state expanded."""
    graph, rows = graph_and_stances
    planner, base = Planner(graph), graph.postures(rows).base_position
    start = rows[0].tolist()
    goal = np.clip(base.min(axis=0) - 5.0, *graph.grasp_map.cabin)
    found = planner.plan(start, goal, "steps", goal_tolerance=0.01)
    assert found.reason == "goal outside the reachable set"
    assert found.expanded == 0
    assert planner.plan(start, np.clip(base[0], *graph.grasp_map.cabin), "steps").plan is not None


def test_a_start_in_a_given_pose_may_have_less_manipulability_than_a_node(graph_and_stances):
    """It is at its goal, though its stance is no node."""
    graph, rows = graph_and_stances
    strict = stance_graph(
        graph.grasp_map, graph.robot, Settings(collisions=False, limb_threshold=0.2)
    )
    (weak, *_) = np.flatnonzero(~strict.is_node(strict.nodes(rows)))
    posture = graph.postures(rows[weak : weak + 1])
    pose = [*posture.base_position[0], *quaternion(posture.base_rotation[0])]
    goal = np.clip(posture.base_position[0], *graph.grasp_map.cabin)
    stance, planner = rows[weak].tolist(), Planner(strict)
    assert planner.plan(stance, goal, "steps").reason == "start infeasible"
    found = planner.plan(stance, goal, "steps", start_pose=pose)
    assert found.plan is not None
    assert not found.plan.steps
