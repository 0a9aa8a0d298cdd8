"""Random steps, and what compiled code says of them."""

import numpy as np

from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.errors import StanceError
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.random_states import random_stance, random_state
from mlivr_gym.transitions.records import StepRecord


def neighbouring_points(graph, count, seed):
    """Return random stances of neighbouring points, any two of which may be held at once."""
    rng, rows = np.random.default_rng(seed), []
    while len(rows) < count:
        chosen = [int(rng.integers(len(graph.grasp_map)))]
        while len(chosen) < graph.limbs:
            able = np.flatnonzero(graph.compatible[chosen].all(axis=0))
            if not len(able):
                break
            chosen.append(int(rng.choice(able)))
        if len(chosen) == graph.limbs:
            rows.append(chosen)
    return np.array(rows)


def random_walk(graph, rng, count, start=None):
    """States of a walk of `count` random steps, fewer where there are none; legal, from a start."""
    states = [random_state(graph, rng) if start is None else start]
    while len(states) <= count and (steps := graph.successors(states[-1])):
        states.append(steps.after(states[-1], int(rng.integers(len(steps.limb)))))
    return states


def two_stances(graph, rng):
    """A limb, and the points of a random stance and of one that this limb alone changes."""
    while True:
        state, limb = random_stance(graph, rng), int(rng.integers(graph.limbs))
        if state is None:
            continue
        before = state.stance
        others = [p for i, p in enumerate(before) if i != limb]
        places = graph.grasp_map.positions
        away = np.linalg.norm(places - places[others].mean(axis=0), axis=1)
        point = int(rng.choice(np.flatnonzero(away < 1.5)))
        after = (*before[:limb], point, *before[limb + 1 :])
        if point != before[limb] and can_be_held(graph, after):
            return limb, before, after


def can_be_held(graph, stance):
    try:
        graph.state(stance)
    except StanceError:
        return False
    return True


def asked(graph, limb, before, after, wanted=None):
    """The stances, what compiled code says of limbs at both, and of the step between them.

    Limbs may be on the bits that are wanted of each, by default on all.
    """
    points = np.array([before, after])
    checks, postures = graph.checks, join(graph.posture(before), graph.posture(after))
    stances, world = checks.stances(points, postures), checks.world(None)
    if wanted is not None:
        stances = stances._replace(branch_sets=stances.branch_sets & wanted)
    todo = np.array([(s, i) for s in (0, 1) for i in range(graph.limbs)])
    checks.release(stances, todo, world)
    steps = StepRecord.rows(1)
    steps["limb"], steps["before"], steps["after"], steps["kept"] = limb, 0, 1, ALL
    able = checks.can_follow(steps, stances, world)
    checks.check(steps, stances, world)
    return stances, steps[0], bool(able[0])
