"""Walks of the baselines against the steps of the graph."""

import math

import numpy as np
import pytest
from scipy.stats import chisquare

from mlivr_gym.planners.baselines import (
    BASELINES,
    CORRIDORS,
    find_walk,
)
from mlivr_gym.stances.random_states import random_state


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
