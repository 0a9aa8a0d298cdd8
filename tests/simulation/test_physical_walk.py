"""Which steps a simulated robot can take: limbs that hold stay inside their joint limits."""

import numpy as np
import pytest

from mlivr_gym.envs.dynamics import physical_walk
from mlivr_gym.envs.tasks import random_state
from mlivr_gym.errors import PlanError
from mlivr_gym.motion.regrasp import RegraspPath


@pytest.fixture(scope="module")
def walk(small_graph):
    return physical_walk(small_graph, 50.0, None)


def test_no_possible_step_leaves_a_joint_limit_at_either_end(small_graph, walk):
    """A joint starts a turn further, near its upper or its lower limit; paths looked at densely."""
    rng, places = np.random.default_rng(0), np.linspace(0.0, 1.0, 101)
    low, high = small_graph.robot.limb.limits.T
    below = above = possible = 0
    for _ in range(4):
        state = random_state(small_graph, rng)
        walk.start(state)
        start, on_branches = walk.joints.copy(), walk.state
        for limb in range(2):
            for joint in rng.choice(6, 3, replace=False):
                joints = start.copy()
                joints[limb, joint] -= 2.0 * np.pi * np.sign(joints[limb, joint])
                if not (low <= joints[limb]).all() or not (joints[limb] <= high).all():
                    continue
                walk.start(on_branches, joints=joints)
                steps = small_graph.successors(walk.state)
                kept = walk.executable(steps)
                names = set(zip(kept.limb.tolist(), kept.point.tolist(), strict=True))
                for k in range(len(steps.limb)):
                    regrasp, _ = walk._regrasp(steps.after(walk.state, k).stance)
                    try:
                        held = RegraspPath(small_graph, regrasp).supports(places)
                    except PlanError:
                        continue
                    under = np.nanmax(low - held) > 1e-3
                    over = np.nanmax(held - high) > 1e-3
                    name = int(steps.limb[k]), int(steps.point[k])
                    assert not (under or over) or name not in names
                    below, above = below + under, above + over
                    possible += name in names
    assert min(below, above) > 5
    assert possible > 100
