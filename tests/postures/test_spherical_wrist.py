"""Stances of two iiwa from a URDF of one, joint 3 held, as Pinocchio has the arm."""

import numpy as np
from held_points import assert_held
from wrist_arms import flange_of, iiwa_from_file, pinocchio_wrist_arm

from mlivr_gym import stance_graph
from mlivr_gym.kinematics.manipulability import limb_manipulability

ROBOT = iiwa_from_file(0.8)
MODEL = pinocchio_wrist_arm(ROBOT.limb)


def test_limbs_hold_their_points_in_every_stance_as_pinocchio_has_it(jem):
    """On branches inside the joint limits, with the `w_m` that the posture has."""
    graph = stance_graph(jem, ROBOT)
    assert len(graph) > 1000
    low, high = ROBOT.limb.limits.T
    for k in np.random.default_rng(0).integers(len(graph), size=100).tolist():
        stance = graph.points[k].tolist()
        here = graph.configuration(graph.state(stance))
        assert (here[2] >= low - 1e-5).all()
        assert (here[2] <= high + 1e-5).all()
        assert_held(ROBOT, jem, stance, here, lambda q: flange_of(MODEL, ROBOT.limb, q)[0])
        for joints in here[2]:
            jacobian = flange_of(MODEL, ROBOT.limb, joints)[1]
            w_m = limb_manipulability(jacobian, ROBOT.characteristic_length)
            assert w_m >= graph.limb_threshold - 1e-9
