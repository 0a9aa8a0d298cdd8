"""What ends a walk, and that it is told with its numbers."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from recordings import resting

from mlivr_gym import Box, Limb
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.robot.specification import MLIVR2
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.instruments import FailureMonitor, Measurements
from mlivr_gym.simulation.parameters import Physics
from mlivr_gym.simulation.simulator import Simulation


@pytest.mark.parametrize("name", ["tool bag", "limbo", "body"])
def test_a_collision_is_a_failure_that_names_what_touches(checked_graph, plan, jem, name):
    step, motion = plan.steps[0], plan.joint_path(0).samples(41)
    swinging = np.flatnonzero(motion.phase == 1)
    k = int(swinging[len(swinging) // 2])
    robot = Simulation(jem, plan.world.robot)
    here = motion.base_positions[k], motion.base_quaternions[k], motion.joint_positions[k]
    robot.reset(*here, [FREE, FREE])
    place = robot.data.site(f"limb{step.limb}/grasp").xpos
    box = Box.between(name, "obstacle", place - 0.05, place + 0.05)
    failure = execute(
        checked_graph, replace(plan, world=replace(plan.world, obstacles=(box,)))
    ).failure
    assert failure is not None
    assert failure.kind == "collision"
    assert failure.limb == step.limb
    assert f"box/{name} " in failure.message
    assert failure.values["depth_m"] > 0.0


def test_divergence_is_a_failure(checked_graph, plan, jem, tmp_path, monkeypatch):
    """The damping of a grasp is too stiff for an explicit integrator."""
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log file
    simulation = Simulation(
        jem, plan.world.robot, Physics(hold_force=1e9, hold_torque=1e9, joint_limit_tolerance=1e11)
    )
    simulation.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    failure = execute(checked_graph, plan, simulation=simulation).failure
    assert failure is not None
    assert failure.kind == "divergence"


def measured(count, finite=None, **changes):
    """What some time steps of a robot of two limbs measure that rests, but for some changes."""
    recording = replace(resting(count), times=0.002 * np.arange(count), **changes)
    finite = np.ones(count, dtype=bool) if finite is None else finite
    return Measurements(recording, recording.joint_torques * 0.0, finite)


def test_the_first_failure_is_found_also_across_chunks():
    monitor = FailureMonitor(Physics(saturation_time=0.02), MLIVR2, 4)
    assert monitor.first_failure(measured(50), "swing", [True, True]) is None
    torques = np.zeros((50, 2, 6))
    torques[43:, 1, 4] = -28.0
    assert monitor.first_failure(measured(50, joint_torques=torques), "swing", [True, True]) is None
    torques = np.zeros((50, 2, 6))
    torques[:20, 1, 4] = -28.0
    index, failure = monitor.first_failure(
        measured(50, joint_torques=torques), "swing", [True, True]
    )
    # Seven time steps at the end of the last chunk and four here make more than 0.02 s.
    assert (index, failure.kind, failure.limb, failure.step) == (3, "saturation", 1, 4)
    joints = np.zeros((50, 2, 6))
    joints[30:, 0, 2] = 2 * np.pi + 0.1
    index, failure = monitor.first_failure(
        measured(50, joint_positions=joints), "approach", [True, True]
    )
    assert (index, failure.kind, failure.limb) == (30, "joint limit", 0)
    assert failure.values["joint"] == 3.0
    finite = np.arange(50) < 10
    index, failure = monitor.first_failure(
        measured(50, finite=finite, joint_positions=joints), "approach", [True, True]
    )
    assert (index, failure.kind) == (10, "divergence")


@pytest.mark.parametrize(("sign", "limb", "joint"), [(1.0, 0, 5), (-1.0, 1, 2)])
def test_both_limits_of_every_joint_are_watched(sign, limb, joint):
    """Beyond the margin of 3 degrees, and not within it."""
    robot = replace(MLIVR2, limb=Limb(joint_limits=((-1.0, 2.0),) * 6))
    edge = 2.0 if sign > 0.0 else -1.0
    for beyond, fails in ((np.deg2rad(2.9), False), (np.deg2rad(3.1), True)):
        joints = np.zeros((20, 2, 6))
        joints[7:, limb, joint] = edge + sign * beyond
        found = FailureMonitor(Physics(), robot, 0).first_failure(
            measured(20, joint_positions=joints), "swing", [True, True]
        )
        assert (found is not None) == fails
    index, failure = found
    assert (index, failure.kind, failure.limb) == (7, "joint limit", limb)
    assert failure.values == {"joint": joint + 1.0, "angle_rad": joints[7, limb, joint]}


@pytest.mark.parametrize("limb", [0, 1])
@pytest.mark.parametrize(
    ("name", "most", "key"),
    [("grasp_forces", 200.0, "force_N"), ("grasp_torques", 100.0, "torque_N_m")],
)
def test_a_hold_is_lost_above_its_force_and_above_its_torque(limb, name, most, key):
    """Of limbs that hold alone, and by the length of the vector."""
    for size in (0.99, 1.01):
        wrench = np.zeros((20, 2, 3))
        wrench[4:, limb] = size * most * np.array([2.0, -1.0, 2.0]) / 3.0
        given = measured(20, **{name: wrench})
        other = [limb != 0, limb == 0]
        assert FailureMonitor(Physics(), MLIVR2, 0).first_failure(given, "swing", other) is None
        found = FailureMonitor(Physics(), MLIVR2, 0).first_failure(given, "swing", [True, True])
        assert (found is not None) == (size > 1.0)
    index, failure = found
    assert (index, failure.kind, failure.limb) == (4, "lost hold", limb)
    assert failure.values[key] == pytest.approx(1.01 * most)
    assert failure.values[f"allowed_{key}"] == most
