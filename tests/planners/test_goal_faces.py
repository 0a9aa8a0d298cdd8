"""Goals that name a face: all limbs hold points of it when the walk ends."""

import numpy as np
import pytest
from state_graph import least_cost, reachable, within

from mlivr_gym import Settings, stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Planner, SearchOptions


@pytest.fixture(scope="module")
def corner(jem):
    """Points of the deck and the forward wall that lie near each other."""
    keep = (jem.positions[:, 0] < 2.6) & np.isin(jem.faces, ["deck", "forward"])
    return jem.subset(keep & (np.arange(len(jem)) % 3 == 0), "corner")


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_walks_end_on_the_face_with_the_fewest_steps(corner, robot):
    settings = Settings(collisions=False)
    if robot == "mlivr3":
        settings = Settings(manipulability=False, transitions=False, collisions=False)
        corner = corner.subset(np.arange(len(corner)) % 2 == 0, "fewer points")
    graph, rng = stance_graph(corner, robot, settings), np.random.default_rng(2)
    planner, limbs, faces = Planner(graph), graph.limbs, np.array(corner.faces)
    drawn = rng.permuted(np.tile(np.arange(len(corner)), (600, 1)), axis=1)[:, :limbs]
    stances = [s for s in drawn.tolist() if graph.is_node(graph.posture(s))[0]]
    net, fewest, longer, ended = reachable(graph), {}, 0, 0
    for stance, other in zip(stances[:8], stances[8:16], strict=True):
        start, goal = graph.state(stance), graph.posture(other).base_position[0]
        goal = np.clip(goal, *corner.cabin)
        near = within(reachable(graph, start, known=net), goal, 0.4)
        for face in (None, "deck", "forward"):
            ends = [s for s in near if face is None or (faces[[*s.stance]] == face).all()]
            fewest[face] = least_cost(net, start, ends)
            for method in ("astar", "algorithm1"):
                options = SearchOptions(method=method, inflation=1.0)
                found = planner.plan(
                    stance, goal, "steps", goal_tolerance=0.4, goal_face=face, options=options
                )
                assert bool(found) == np.isfinite(fewest[face])
                if found and face is not None:
                    assert len(found.plan.steps) == fewest[face]
                    held = {corner.faces[corner.index(point)] for point in found.plan.stances[-1]}
                    assert held == {face}
                    longer, ended = longer + (fewest[face] > fewest[None]), ended + 1
    assert ended > 6
    assert longer


def test_the_exact_cost_counts_goals_on_the_face_alone(corner):
    graph = stance_graph(corner, settings=Settings(collisions=False))
    planner, goal = Planner(graph), corner.cabin.mean(axis=0)
    goal[0] = 2.0
    how = {"cost": "steps", "goal_tolerance": 0.6, "goal_face": "deck"}
    exact = planner.cost_to_go(goal, **how)
    faces = np.array(corner.faces)[graph.points]
    near = np.linalg.norm(graph.base_position - goal, axis=1) <= 0.6
    np.testing.assert_array_equal(exact.values == 0.0, near & (faces == "deck").all(axis=1))
    assert 0 < exact.is_goal.sum() < near.sum()
    for s in np.random.default_rng(0).choice(len(graph), 20):
        found = planner.plan(graph.points[s].tolist(), goal, **how)
        assert (found.plan.cost if found else np.inf) == exact.values[s]


def test_the_command_takes_a_face_and_the_file_keeps_it(tmp_path):
    file = tmp_path / "plan.json"
    task = ["--start", "D2a:4", "D2b:4", "--goal", "5.9", "0", "0.4", "--cost", "steps"]
    assert main(["plan", *task, "--goal-face", "overhead", "--out", str(file)]) == 0
    plan = Plan.load(file)
    assert plan.query.goal_face == "overhead"
    assert all(point.startswith("O") for point in plan.stances[-1])
