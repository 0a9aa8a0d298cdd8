"""Two iiwa from a URDF of one, joint 3 held: their stances, plans, and a walk in MuJoCo."""

import numpy as np
import pytest
from coal_ruler import Ruler, grasps_of
from held_points import assert_held
from wrist_arms import flange_of, iiwa_from_file, pinocchio_wrist_arm

from mlivr_gym import stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.kinematics.manipulability import limb_manipulability
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.planners import Planner

CLEARANCE = 0.02
ROBOT = iiwa_from_file(0.8)
MODEL = pinocchio_wrist_arm(ROBOT.limb)


@pytest.fixture(scope="module")
def graph(jem):
    return stance_graph(jem, ROBOT)


@pytest.fixture(scope="module")
def plans(graph):
    rng, planner, found = np.random.default_rng(0), Planner(graph), []
    for n in range(3):
        start, goal = sample_task(graph, rng, 1.0)
        found.append(planner.plan(start.stance, goal, ("base", "steps")[n % 2]).unwrap())
    return found


def test_limbs_hold_their_points_in_every_stance_as_pinocchio_has_it(graph, jem):
    """On branches inside the joint limits, with the `w_m` that the posture has."""
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


def test_along_plans_coal_finds_the_clearance(graph, plans, jem):
    ruler, found = Ruler(graph.robot, jem.boxes), []
    for plan in plans:
        for k, step in enumerate(plan.steps):
            motion = step_motion(graph, plan, k, 12)
            before, after = (graph.indices(plan.stances[n]) for n in (k, k + 1))
            for n, phase in enumerate(motion.phase):
                points = [(i, p) for i, p in enumerate(before) if i != step.limb]
                points += {0: [(step.limb, before[step.limb])], 1: [],
                           2: [(step.limb, after[step.limb])]}[int(phase)]  # fmt: skip
                here = (
                    motion.base_positions[n], motion.base_quaternions[n], motion.joint_positions[n]
                )  # fmt: skip
                found += ruler.measured(here, grasps_of(graph, points), 2.0 * CLEARANCE)
    assert min(found)[0] >= CLEARANCE - 1e-9
