"""Walks of the baselines, and cost-to-go over tables, against brute force and the planner's own search."""

import math

import numpy as np
import pytest
from scipy.stats import chisquare

from mlivr_gym import Settings, stance_graph
from mlivr_gym.agents import baseline_policy, evaluate, planner_policy
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.tasks import random_state
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import Planner
from mlivr_gym.planners.baselines import FINDERS, _Node, _simulate, _Task, find_walk
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.table_values import TableValues
from mlivr_gym.planners.walks import executable_steps, plan_of


@pytest.fixture(scope="module")
def env(small_map):
    return MlivrEnv(map=small_map, collisions=False, precompute=True)


@pytest.mark.parametrize("method", FINDERS)
def test_baselines_walk_possible_steps(env, method):
    """Each step is one the graph allows, and a walk that says so ends at the goal."""
    reached = 0
    for seed in range(6):
        env.reset(seed=seed)
        walk = find_walk(method, env.moves, env.state, env.goal, budget=20, seed=seed, longest=30)
        assert walk.states[0] == env.state
        for before, (limb, point), after in zip(
            walk.states, walk.actions, walk.states[1:], strict=False
        ):
            steps = env.graph.successors(before)
            k = int(np.flatnonzero((steps.limb == limb) & (steps.point == point))[0])
            assert tuple(steps.masks[k].tolist()) == after.masks
        last = env.graph.posture(walk.states[-1].stance).position[0]
        assert walk.reached == (math.dist(last, env.goal) <= 0.2)
        stuck = not len(env.graph.successors(walk.states[-1]).limb)
        assert walk.reached or method != "random" or stuck or len(walk.actions) == 30
        reached += walk.reached
    assert reached >= 5 or method == "random"


def test_random_steps_are_as_likely_as_the_others(env):
    """First steps of 3000 walks against even shares, by a chi-square test."""
    env.reset(seed=0)
    possible = np.flatnonzero(env.action_masks()).tolist()
    counts = dict.fromkeys(possible, 0)
    for seed in range(3000):
        (limb, point), *_ = find_walk(
            "random", env.moves, env.state, env.goal, seed=seed, longest=1
        ).actions
        counts[limb * len(env.graph.grasp_map) + point] += 1
    assert len(possible) > 5
    assert chisquare(list(counts.values())).pvalue > 1e-3


def test_tree_search_looks_most_where_the_value_is_best(env):
    """That is what its bound is for: visits of the first steps go up with their mean value."""
    for seed in range(4):
        env.reset(seed=seed)
        task = _Task(env.moves, env.state, env.goal, 0.2, 40)
        root, rng = _Node(task, env.state), np.random.default_rng(0)
        for _ in range(300):
            _simulate(task, root, rng, 0.5)
        visits = np.array([child.visits for child in root.children])
        values = np.array([child.total / child.visits for child in root.children])
        assert visits.sum() == 300
        assert values[visits.argmax()] == values.max()
        assert np.corrcoef(visits, values)[0, 1] > 0.5


def test_local_choice_does_not_go_back(env):
    """Between stances far apart, where the nearest step leads back to where it came from."""
    rng, longest = np.random.default_rng(0), 0
    for _ in range(20):
        first, last = random_state(env.graph, rng), random_state(env.graph, rng)
        goal = env.graph.posture(last.stance).position[0]
        walk = find_walk("local", env.moves, first, goal, longest=40)
        stances = [state.stance for state in walk.states]
        assert len(set(stances)) == len(stances)
        longest = max(longest, len(stances))
    assert longest > 8


def test_baselines_serve_more_limbs():
    env = MlivrEnv(robot="mlivr3", collisions=False)
    env.reset(seed=1)
    walk = find_walk("local", env.moves, env.state, env.goal)
    assert walk.reached
    assert executable_steps(env.graph, [state.stance for state in walk.states]) == len(walk.actions)


def test_policies_follow_walks_to_their_end(env):
    for policy in (
        baseline_policy("two_level"),
        baseline_policy("mcts", budget=10),
        planner_policy("base"),
    ):
        assert evaluate(env, policy, 3, seed=1).success.all()
    with pytest.raises(SettingError, match="method is 'magic'"):
        find_walk("magic", env.moves, env.state, env.goal)


def test_planners_go_on_after_grasps_that_fail(small_map):
    """A failed attempt leaves the limb that held fewer branches than a plan from that stance may count on."""
    env = MlivrEnv(map=small_map, grasp_failure=0.45)
    result = evaluate(env, planner_policy("steps"), 5, seed=26)
    assert result.success.all()
    assert result.failed_grasps.sum() > 5


def test_a_walk_makes_a_plan(small_map):
    """The plan of a walk is that of the planner with the same stances."""
    graph = stance_graph(small_map)
    env = MlivrEnv(map=small_map)
    env.reset(seed=2)
    plan = Planner(graph).plan(env.state.stance, env.goal, "steps").unwrap()
    states = [env.state]
    for limb, point in plan.actions:
        env.step(limb * len(small_map) + small_map.index(point))
        states.append(env.state)
    ours = plan_of(env.graph, states, env.goal, 0.2, "astar")
    assert ours is not None
    assert ours.stances == plan.stances
    assert ours.cost == plan.cost
    np.testing.assert_allclose(ours.joint_positions, plan.joint_positions)


def test_steps_that_thresholds_forbid_are_found(small_map):
    """Plans without manipulability, checked with the thresholds on the planner's own graph."""
    free = stance_graph(small_map, settings=Settings(manipulability=False, collisions=False))
    strict = stance_graph(small_map, settings=Settings(collisions=False))
    env, world = (
        MlivrEnv(map=small_map, collisions=False),
        MlivrEnv(map=small_map, collisions=False),
    )
    counted = 0
    for seed in range(10):
        env.reset(seed=seed)
        plan = Planner(free).plan(env.state.stance, env.goal, "steps").unwrap()
        done = executable_steps(strict, plan.stances)
        assert executable_steps(free, plan.stances) == len(plan.steps)
        taken = 0  # by the environment, until it calls a step invalid
        world.reset(options={"start": plan.stances[0], "goal": plan.goal})
        for limb, point in plan.actions:
            taken += not world.step(limb * len(small_map) + small_map.index(point))[4][
                "invalid_action"
            ]
            if taken < world.steps:
                break
        assert done == taken
        counted += done < len(plan.steps)
    assert counted > 0


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_table_values_are_the_planners_cost_to_go(env, cost):
    planner = Planner(env.graph)
    for seed in range(3):
        env.reset(seed=seed)
        table = planner.cost_to_go(env.goal.tolist(), cost)
        ours = TableValues(env.table_moves().tables, env.goal[None], 0.2, Cost.named(cost))
        held = (env.graph.mask > 0).all(axis=1)
        np.testing.assert_allclose(ours.of_stances(0)[held], table.values[held], atol=1e-9)
        rng = np.random.default_rng(seed)
        for _ in range(10):
            steps = env.successors()
            s = np.array([env.moves.stance_at[env.state.stance]], dtype=np.int64)
            got = ours.of_actions(
                s, np.array([env.state.masks]), np.zeros(1, np.int64), len(env._mask)
            )[0]
            actions = steps.limb * len(env.graph.grasp_map) + steps.point
            np.testing.assert_allclose(
                got[actions], table.action_values(env.state, steps), atol=1e-9
            )
            assert np.isfinite(got).sum() <= len(actions)
            env.step(int(rng.choice(actions)))


def test_expected_costs_solve_the_bellman_equation(env):
    """Each stance's expected steps against one sweep of the equation with failures written out."""
    risk = np.random.default_rng(0).uniform(0.0, 0.6, len(env.graph.grasp_map))
    env.reset(seed=3)
    tables = env.table_moves().tables
    values = TableValues(tables, env.goal[None], 0.2, Cost.named("steps"), risk)
    checked = 0
    for s in np.random.default_rng(1).permutation(len(tables.points))[:40]:
        for held in range(2):
            for b in range(16):
                mine = values.values[0, s, held, b]
                if values.goals[0, s] or not np.isfinite(mine):
                    continue
                best = np.inf
                for e in range(tables.start[2 * s + 1 - held], tables.start[2 * s + 2 - held]):
                    if tables.kept[e] >> b & 1:
                        after = tables.after[e]
                        rest = values.values[0, after, held, b]
                        if tables.releasable[after, held] >> b & 1:
                            rest = min(rest, values.landed[0, after, 1 - held])
                        p = risk[tables.points[after, 1 - held]]
                        # V = 1 + p V + (1 - p) rest
                        best = min(best, (1.0 + (1.0 - p) * rest) / (1.0 - p))
                assert mine == pytest.approx(best, abs=1e-6)
                checked += 1
    assert checked > 100
