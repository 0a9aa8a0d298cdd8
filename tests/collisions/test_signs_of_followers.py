"""Joints of a limb that follows the base against the inverse kinematics at the ends of a way."""

import numpy as np
import pytest
from branches import arm_of, solutions
from compiled import called
from oracle import volume
from robot_texts import KR16, UR10E, frames_of, one_arm, written
from scipy.spatial.transform import Rotation

from mlivr_gym.collisions.following import (
    Following,
    JointAxesSeen,
    bound_changes,
    invert_jacobian,
)
from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.rigid import inverse, rigid

HALF = 0.01
"""Half of the way, of which the base goes a metre and turns by a radian in all."""


@pytest.mark.parametrize("frames", [frames_of(UR10E), KR16], ids=["ur10e", "kr16"])
def test_joints_turn_as_told_whatever_their_signs_and_zeros_are(tmp_path, frames):
    """To first order by the rates, and never farther than bounded."""
    limb = read_robot(written(tmp_path, one_arm(frames=frames, seed=3))).fields["limb"]
    rng, arm, proved = np.random.default_rng(0), arm_of(limb), 0
    assert -1.0 in limb.senses or not np.allclose(limb.steps[0, :3, :3], np.eye(3))
    for _ in range(40):
        q, joints, proof = rng.uniform(-2.0, 2.0, 6), JointAxesSeen.row(), Following.row()
        places, change = link_frames(limb, q), np.zeros(6)
        joints["axis"], joints["point"] = places[1:, :3, 2], places[1:, :3, 3]
        jacobian = np.vstack([np.cross(joints["axis"], places[6, :3, 3] - joints["point"]).T,
                              joints["axis"].T])  # fmt: skip
        found = called(invert_jacobian)(joints, proof)
        assert found == pytest.approx(volume(jacobian), rel=1e-6, abs=1e-9)
        shift, turn = rng.normal(size=(2, 3)) / np.sqrt(3.0)
        if found < 0.02 or not called(bound_changes)(
            HALF, tuple(shift), tuple(turn), joints, proof, change
        ):
            continue
        proved += 1
        for side in (-HALF, HALF):
            base = rigid(Rotation.from_rotvec(side * turn).as_matrix(), side * shift)
            seen = inverse(base) @ places[6]
            mask, branches = solutions(arm, seen[:3, 3], seen[:3, :3])
            turned = np.angle(np.exp(1j * (branches[[mask >> b & 1 == 1 for b in range(8)]] - q)))
            turned = turned[np.abs(turned).max(axis=1).argmin()]
            assert (np.abs(turned) <= change).all()
            np.testing.assert_allclose(turned, side * limb.senses * proof["rate"], atol=0.02)
    assert proved > 10
