"""Arms with a spherical wrist or shoulder, some with a joint held, against Pinocchio and EAIK."""

import numpy as np
import pytest
from arms import frames, turned
from branches import arm_of, solutions
from eaik.IK_HP import HPRobot
from wrist_arms import FURTHER, LIMBS, OTHERS, flange_of, pinocchio_wrist_arm

EVERY = LIMBS | OTHERS | FURTHER


@pytest.mark.parametrize("name", EVERY)
def test_eaik_finds_the_same_solutions(name):
    """EAIK knows the arm by its axes and the joint that is held."""
    limb, rng = EVERY[name], np.random.default_rng(0)
    model = pinocchio_wrist_arm(limb)
    axes = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]] * 3 + [[0.0, 0.0, 1.0]])
    between = np.zeros((8, 3))
    between[1], between[2] = (limb.a1, 0.0, limb.d1), (0.0, -limb.d2, 0.0)
    between[3], between[4] = (limb.b2, 0.0, limb.a2), (limb.a3, -limb.d3, limb.d4)
    between[6, 0], between[7, 2] = limb.a6, limb.d6
    held = [(limb.held_joint - 1, limb.held_angle)] if limb.held_joint else None
    if held is None:
        between[3] += between[2]
        axes, between = np.delete(axes, 2, axis=0), np.delete(between, 2, axis=0)
    arm = HPRobot(axes, between, held)
    to_base = np.eye(4)
    if limb.base_in_mount is not None:
        to_base[:3, :3], to_base[:3, 3] = limb.base_in_mount
    for q in rng.uniform(-np.pi, np.pi, (30, 6)):
        pose = flange_of(model, limb, q)[0]
        np.testing.assert_allclose(frames(limb, q)[6], pose, atol=1e-12)
        mask, out = solutions(arm_of(limb), pose[:3, 3], pose[:3, :3])
        found = arm.IK(to_base @ pose)
        exact = [
            limb.moving_angles(a) for a, fit in zip(found.Q, found.is_LS, strict=True) if not fit
        ]
        assert len(exact) == mask.bit_count()
        for one in exact:
            assert min(turned(out[b], one) for b in range(8) if mask >> b & 1) < 1e-6
