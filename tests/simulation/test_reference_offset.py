"""The offset of the references, of which only a part decays while several limbs hold."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robots import pinocchio_robot
from scipy.linalg import null_space, orth

from mlivr_gym import stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.inverse_dynamics import compatible_motions
from mlivr_gym.simulation.joint_controller import Reference
from mlivr_gym.simulation.parameters import CONTROLLERS
from mlivr_gym.simulation.simulator import Simulation


@pytest.mark.parametrize("holding", [[1], [0, 2], [0, 1, 2]])
def test_compatible_motions_are_those_that_leave_the_grippers_where_they_are(holding):
    """The null space of Pinocchio's Jacobians of all grippers that hold, without its base."""
    robot, joints = robot_spec("mlivr3"), np.random.default_rng(3).uniform(-2.0, 2.0, 18)
    other = pinocchio_robot(robot)
    data, place = other.createData(), np.concatenate([[0, 0, 0, 0, 0, 0, 1.0], joints])
    jacobians = [
        pin.computeFrameJacobian(other, data, place, other.getFrameId(f"grasp{i}"), pin.LOCAL)
        for i in holding
    ]
    motions = orth(null_space(np.concatenate(jacobians))[6:])
    found = compatible_motions(robot, holding, joints)
    np.testing.assert_allclose(found, motions @ motions.T, atol=1e-9)


def test_limbs_with_biased_encoders_do_not_work_against_each_other(jem):
    """Two limbs hold and one is free: no force comes up in the grasps within five seconds."""
    graph = stance_graph(jem, "mlivr3")
    start, goal = sample_task(graph, np.random.default_rng(0), 0.5)
    plan = Planner(graph).plan(start.stance, goal, "steps").unwrap()
    bias = DisturbanceRanges(encoder_bias=0.01).draw(2, 25, 3, len(jem))
    controller = CONTROLLERS["delayed"]
    simulation = Simulation(jem, graph.robot, controller=controller, disturbance=bias)
    points = [jem.index(point) for point in plan.stances[0]]
    simulation.reset(*plan.configuration(0), points)
    free = plan.steps[0].limb
    simulation._grippers.detach(free)
    simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    control, joints = simulation._joint_controller, plan.configuration(0)[2].ravel()
    control.align_references(joints)
    still = np.zeros((250, 18))
    for _ in range(10):
        reference = Reference(np.tile(joints, (250, 1)), still, still)
        control.run(reference, [limb != free for limb in range(3)], recovering=True)
    mujoco.mj_forward(simulation.model, simulation.data)
    forces = [
        [simulation.data.sensor(f"limb{limb}/grasp/{axis}").data[0] for axis in "xyz"]
        for limb in range(3)
        if limb != free
    ]
    assert np.linalg.norm(forces, axis=1).max() < 2.0
