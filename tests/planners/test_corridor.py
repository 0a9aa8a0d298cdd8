"""Plans in a corridor of points: walks of the whole map, and proofs by the whole map alone."""

import networkx as nx
import numpy as np
import pytest
from scipy.spatial import cKDTree
from walk_steps import count_steps

from mlivr_gym import Box, GraspMap, Settings, robot_spec, stance_graph
from mlivr_gym.errors import GoalError, StanceError, UnknownPointError
from mlivr_gym.motion.plan_parts import World
from mlivr_gym.planners import Plan, Planner, corridor
from mlivr_gym.planners.corridor import around, nearest_distances, plan_in_corridor, route_of

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)


@pytest.fixture(scope="module")
def free():
    """The plan where nothing is in the way."""
    return plan_in_corridor("jem", START, GOAL)


@pytest.mark.parametrize(("many", "most"), [(corridor.MANY, 200), (100, 140)])
def test_the_plan_is_a_walk_of_the_whole_map(monkeypatch, checked_graph, free, many, most):
    """Every step is one of the whole graph, and no plan there is shorter."""
    usual = corridor.MANY
    monkeypatch.setattr(corridor, "MANY", many)
    found = free if many == usual else plan_in_corridor("jem", START, GOAL)
    assert not found.is_whole
    assert len(found.graph.grasp_map) < most
    plan = found.result.unwrap()
    state = checked_graph.state(plan.stances[0])
    for stance in plan.stances[1:]:
        state = checked_graph.step_to(state, checked_graph.indices(stance))
        assert state is not None
    base = checked_graph.posture_of(state).base_position[0]
    np.testing.assert_allclose(plan.motion.base_positions[-1], base, atol=1e-9)
    least = len(Planner(checked_graph).plan(START, GOAL, "steps").plan.steps)
    assert len(plan.steps) >= least >= len(plan.steps) / plan.statistics.bound
    assert plan.statistics.bound < 1.5


def test_a_plan_is_one_of_the_whole_map_among_its_obstacles(jem, free, tmp_path):
    """It is read with the whole map, and is a walk of the whole graph among the obstacles."""
    free = free.result.unwrap()
    taken = free.steps[0].to_point
    box = Box.between("crate", "obstacle", (3.5, -0.35, -0.9), (3.8, 0.35, 0.0))
    found = plan_in_corridor("jem", START, GOAL, obstacles=[box], occupied=[taken, "A6b:7"])
    assert not found.is_whole
    plan = found.result.unwrap()
    assert all(taken not in stance for stance in plan.stances)
    plan.save(tmp_path / "plan.json")
    assert Plan.load(tmp_path / "plan.json", jem).stances == plan.stances
    assert len(plan.steps) > len(free.steps)
    graph = stance_graph(jem)
    graph.add_obstacles([box])
    graph.occupy([taken, "A6b:7"])
    assert plan.world == World.of(graph)
    assert count_steps(graph, plan.stances) == len(plan.steps)


@pytest.mark.parametrize("cost", [("base",), ("weighted", 0.3)])
def test_its_bound_holds_for_the_whole_map(checked_graph, cost):
    name, price = (*cost, None)[:2]
    plan = plan_in_corridor("jem", START, GOAL, name, regrasp_price=price).result.unwrap()
    least = Planner(checked_graph).plan(START, GOAL, name, regrasp_price=price).unwrap().cost
    assert plan.cost / plan.statistics.bound <= least <= plan.cost + 1e-9
    assert 1.0 <= plan.statistics.bound < 1.6


def test_boxes_that_are_left_out_touch_no_stance_of_the_corridor(jem, checked_graph):
    """The stances of some points are those that the graph of the whole map has on them."""
    keep = (jem.positions[:, 0] > 2.5) & (jem.positions[:, 0] < 4.0)
    part = around(jem, keep, robot_spec("mlivr2"))
    graph, chosen = stance_graph(part), np.flatnonzero(keep)
    whole = checked_graph.points[keep[checked_graph.points].all(axis=1)]
    np.testing.assert_array_equal(chosen[graph.points], whole)
    long = np.linspace([0.0, 0.0, 0.0], [40.0, 0.0, 0.0], 9)
    boxes = [
        {"id": f"B{k}", "min": (at - 0.1).tolist(), "max": (at + 0.1).tolist()}
        for k, at in enumerate(long)
    ]
    point = {"face": "deck", "normal": [0, 0, 1], "rail": [1, 0, 0]}
    points = [{"id": f"P{k}", "position": [0.3 * k, 0, -1.0], **point} for k in range(3)]
    few = GraspMap.from_dict({"points": points, "boxes": boxes})
    near = around(few, np.ones(3, dtype=bool), robot_spec("mlivr2"))
    assert 1 <= len(near.boxes) < 9


def test_a_route_goes_round_a_wall_by_many_short_hops():
    """A U of points: the hop across its mouth is within the span, and dearer than the way round."""
    legs = [np.array([0.5 * k + 0.25, y, 0.5]) for k in range(12) for y in (0.5, 2.6)]
    bend = [np.array([5.75, y, 0.5]) for y in (1.0, 1.5, 2.0)]
    route = route_of(np.array(legs + bend), 0, np.array([0.25, 2.6, 0.5]), 2.4)
    assert np.linalg.norm(np.diff(route, axis=0), axis=1).max() <= 0.5 + 1e-9
    assert np.linalg.norm(route[-1] - legs[0]) < 1e-9
    net = nx.Graph()
    cells = {}
    for place in legs + bend:
        cells.setdefault(tuple(np.floor(place)), []).append(place)
    means = [np.mean(one, axis=0) for one in cells.values()]
    for i, a in enumerate(means):
        for j, b in enumerate(means[:i]):
            if np.linalg.norm(a - b) <= 2.4:
                net.add_edge(i, j, weight=np.linalg.norm(a - b) ** 2)
    first = next(i for i, m in enumerate(means) if (np.floor(m) == np.floor(legs[0])).all())
    last = int(np.argmin(np.linalg.norm(np.array(means) - [0.25, 2.6, 0.5], axis=1)))
    for k in nx.dijkstra_path(net, first, last):
        assert np.linalg.norm(route - means[k], axis=1).min() < 1e-9


@pytest.mark.parametrize("count", [0, 1, 700])
def test_distances_are_those_of_scipy(count):
    rng = np.random.default_rng(0)
    points, others = rng.normal(size=(count, 3)), rng.normal(size=(40, 3))
    np.testing.assert_allclose(
        nearest_distances(points, others), cKDTree(others).query(points)[0], rtol=1e-12
    )


@pytest.mark.parametrize("many", [corridor.MANY, 10])
def test_only_the_whole_map_proves_that_there_is_no_plan(monkeypatch, jem, many):
    """Points on two islands, farther apart than the span."""
    monkeypatch.setattr(corridor, "MANY", many)
    keep = (jem.positions[:, 0] < 2.9) | (jem.positions[:, 0] > 6.0)
    apart = jem.subset(keep, "apart")
    settings = Settings(collisions=False)
    found = plan_in_corridor(apart, START, (6.8, 0.0, 0.42), settings=settings)
    assert found.result.plan is None
    assert found.is_whole
    assert len(found.graph.grasp_map) == len(apart)


@pytest.mark.parametrize("limit", [{"time_limit": 0.0}, {"limit": 1}])
def test_where_a_limit_is_reached_no_wider_corridor_is_searched(jem, limit):
    """In a wider one the search would only take longer."""
    found = plan_in_corridor("jem", START, GOAL, **limit)
    assert found.result.reason == "limit reached"
    used = len(found.graph.grasp_map)
    assert used < len(jem)
    assert found.result.message.endswith(f", on {used} of {len(jem)} points: there may be a plan")


@pytest.mark.parametrize(
    ("start", "goal", "error"),
    [
        (("D2a:4", "nowhere"), GOAL, UnknownPointError),
        (7, GOAL, StanceError),
        (START, (0.0, 0.0, 99.0), GoalError),
        (START, "here", GoalError),
    ],
)
def test_faulty_queries_are_refused(start, goal, error):
    with pytest.raises(error):
        plan_in_corridor("jem", start, goal)
