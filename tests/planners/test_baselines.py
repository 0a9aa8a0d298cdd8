"""Walks of the baselines, and cost-to-go over step tables."""

import math

import numpy as np
import pytest
from scipy.stats import chisquare

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.planners import Planner
from mlivr_gym.planners.baselines import (
    BASELINES,
    CORRIDORS,
    find_walk,
)
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.table_values import TableValues, in_goal_region
from mlivr_gym.stances.random_states import random_state


@pytest.fixture(scope="module")
def env(small_map):
    """The small map without collisions, its steps from tables."""
    return MlivrEnv(map=small_map, collisions=False)


@pytest.mark.parametrize("method", BASELINES)
def test_baselines_walk_possible_steps(env, method):
    """Each step is one the graph allows, and a walk that says so ends at the goal."""
    reached = 0
    for seed in range(6):
        env.reset(seed=seed)
        walk = find_walk(method, env.moves, env.state, env.goal, budget=20, seed=seed, max_steps=30)
        assert walk.states[0] == env.state
        for before, (limb, point), after in zip(
            walk.states, walk.actions, walk.states[1:], strict=False
        ):
            steps = env.graph.successors(before)
            k = int(np.flatnonzero((steps.limb == limb) & (steps.point == point))[0])
            assert tuple(steps.branch_sets[k].tolist()) == after.branch_sets
        last = env.graph.posture(walk.states[-1].stance).base_position[0]
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
            "random", env.moves, env.state, env.goal, seed=seed, max_steps=1
        ).actions
        counts[limb * len(env.graph.grasp_map) + point] += 1
    assert len(possible) > 5
    assert chisquare(list(counts.values())).pvalue > 1e-3


def test_local_choice_does_not_go_back(env):
    """Between stances far apart, where the nearest step leads back to where it came from."""
    rng, longest = np.random.default_rng(0), 0
    for _ in range(20):
        first, last = random_state(env.graph, rng), random_state(env.graph, rng)
        goal = env.graph.posture(last.stance).base_position[0]
        walk = find_walk("local", env.moves, first, goal, max_steps=40)
        stances = [state.stance for state in walk.states]
        assert len(set(stances)) == len(stances)
        longest = max(longest, len(stances))
    assert longest > 8


def test_two_levels_look_at_all_that_lies_in_their_corridors_and_at_nothing_else(env):
    """Where the goal is out of reach each corridor is searched to its end.

    It is what lies within its half width of the line from start to goal, by many places on it; at
    the ends it is round.
    """
    rng, behind = np.random.default_rng(0), 0
    start = random_state(env.graph, rng)
    origin = env.graph.posture(start.stance).base_position[0]
    direction = rng.normal(size=3)
    goal = origin + 0.5 * direction / np.linalg.norm(direction)
    line, expanded = origin + np.linspace(0.0, 1.0, 501)[:, None] * (goal - origin), 0
    for width in CORRIDORS:
        todo, seen = [start], {start.stance}
        while todo:
            here, expanded = todo.pop(), expanded + 1
            steps = env.graph.successors(here)
            for k, base in enumerate(steps.base_position):
                near = np.linalg.norm(line - base, axis=1).min() <= width
                after = steps.after(here, k)
                if near and after.stance not in seen:
                    seen.add(after.stance)
                    todo.append(after)
                    behind += (base - origin) @ direction < 0.0
    walk = find_walk("two_level", env.moves, start, goal, 1e-9, max_steps=10**6)
    assert not walk.reached
    assert walk.expanded == expanded
    assert behind > 100


def values_to(env, cost, risk=None, most=np.inf):
    tables = env.table_moves().tables
    goals = in_goal_region(tables, env.goal[None], 0.2)
    return TableValues(tables, goals, Cost.named(cost), risk, most)


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_table_values_are_the_planners_cost_to_go(env, cost):
    planner = Planner(env.graph)
    for seed in range(3):
        env.reset(seed=seed)
        table = planner.cost_to_go(env.goal.tolist(), cost)
        ours = values_to(env, cost)
        held = (env.graph.branch_sets > 0).all(axis=1)
        np.testing.assert_allclose(ours.of_stances(0)[held], table.values[held], atol=1e-9)
        rng = np.random.default_rng(seed)
        for _ in range(10):
            steps = env.successors()
            s = np.array([env.moves.stance_at[env.state.stance]], dtype=np.int64)
            got = ours.of_actions(
                s, np.array([env.state.branch_sets]), np.zeros(1, np.int64), len(env._mask)
            )[0]
            actions = steps.limb * len(env.graph.grasp_map) + steps.point
            np.testing.assert_allclose(
                got[actions], table.action_values(env.state, steps), atol=1e-9
            )
            best = actions[table.best(env.state, steps)]
            assert got[best] == pytest.approx(got.min(), abs=1e-9)
            assert np.isfinite(got).sum() <= len(actions)
            env.step(int(rng.choice(actions)))


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_expected_costs_solve_the_bellman_equation(env, cost):
    """Each stance's expected cost against one sweep of the equation with failures written out.

    A failed grasp costs a step, or the displacement there and back, and the stance stays.
    """
    risk = np.random.default_rng(0).uniform(0.0, 0.6, len(env.graph.grasp_map))
    env.reset(seed=3)
    tables = env.table_moves().tables
    values = values_to(env, cost, risk)
    checked = 0
    for s in np.random.default_rng(1).permutation(len(tables.points))[:40]:
        for held in range(2):
            for b in range(16):
                mine = values.values[0, s, held, b]
                if values.is_goal[0, s] or not np.isfinite(mine):
                    continue
                best = np.inf
                for e in range(tables.start[2 * s + 1 - held], tables.start[2 * s + 2 - held]):
                    if tables.kept[e] >> b & 1:
                        after = tables.after[e]
                        rest = values.values[0, after, held, b]
                        if tables.releasable[after, held] >> b & 1:
                            rest = min(rest, values.grasped[0, after, 1 - held])
                        p = risk[tables.points[after, 1 - held]]
                        d = np.linalg.norm(tables.base_position[after] - tables.base_position[s])
                        one, two = (1.0, 1.0) if cost == "steps" else (d, 2.0 * d)
                        # V = p (two + V) + (1 - p) (one + rest)
                        best = min(best, (p * two + (1.0 - p) * (one + rest)) / (1.0 - p))
                assert mine == pytest.approx(best, abs=1e-6)
                checked += 1
    assert checked > 100


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_costs_up_to_a_limit_are_all_costs_below_it(env, cost):
    env.reset(seed=0)
    every = values_to(env, cost).values
    known = every[np.isfinite(every) & (every > 0.0)]
    for most in (0.0, np.quantile(known, 0.3) + 1e-6, known.max()):
        some = values_to(env, cost, most=float(most)).values
        found = np.isfinite(some)
        np.testing.assert_allclose(some[found], every[found], atol=1e-7)
        assert found[every <= most - 1e-7].all()
        assert not found[every > most + 1e-7].any()
