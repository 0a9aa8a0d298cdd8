"""Grasps, controller and steps in MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from mlivr_gym.errors import PlanError, SimulationError
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import (
    CONTROLLERS,
    ControllerParameters,
    Limits,
    Physics,
)
from mlivr_gym.simulation.simulator import PathWatch, Simulation
from mlivr_gym.simulation.timing import step_trajectory


def test_the_grasp_gives_the_robot_its_momentum(checked_graph, plan, jem):
    """Newton: the impulse of the only grasp is the momentum gained.

    Up to an error that goes with the time step.
    """
    errors = []
    for timestep in (0.002, 0.0005):
        simulation = Simulation(
            jem, plan.world.robot, Physics(timestep=timestep), controller=CONTROLLERS["feedforward"]
        )
        recording = execute(
            checked_graph, plan, Limits(step_duration=10.0), simulation=simulation
        ).recording
        limb = 1 - plan.steps[0].limb
        tool = simulation.data.site(f"limb{limb}/anchor").xmat.reshape(3, 3)
        force = recording.grasp_forces[:, limb] @ tool.T
        impulse = cumulative_trapezoid(force, recording.times, axis=0, initial=0.0)
        gained = recording.momenta - recording.momenta[0]
        errors.append(np.abs(impulse - gained).max() / np.linalg.norm(gained, axis=1).max())
    assert errors[1] < 0.03
    assert errors[1] == pytest.approx(0.25 * errors[0], rel=0.1)


def test_a_step_is_carried_out_within_tolerance(walked, plan, jem):
    assert walked.failure is None
    assert walked.simulated_time == pytest.approx(52.0)
    (capture,) = walked.captures
    assert capture.distance < 1e-3
    assert capture.angle < 1e-3
    assert capture.point == plan.steps[0].to_point
    np.testing.assert_allclose(
        walked.recording.base_positions[-1], plan.motion.base_positions[1], atol=1e-3
    )
    assert walked.peaks.base_error < 5e-3
    assert walked.recording.contacts.max() == 0


def test_what_cannot_be_simulated_is_one_clear_error(checked_graph, plan, jem, simulation):
    start = plan.configuration(0)
    with pytest.raises(SimulationError, match="cannot hold it"):
        simulation.reset(*start, [jem.index("D5a:1"), jem.index("D1b:3")])
    simulation.reset(*start, [jem.index(point) for point in plan.stances[0]])
    with pytest.raises(SimulationError, match=r"time step is 0.002"):
        simulation.execute(step_trajectory(checked_graph, plan, 0, period=0.01))
    simulation.reset(*start, [FREE, FREE])
    with pytest.raises(SimulationError, match="the robot holds"):
        simulation.execute(step_trajectory(checked_graph, plan, 0))
    with pytest.raises(PlanError, match="no step"):
        execute(checked_graph, replace(plan, motion=replace(plan.motion, steps=())))


@pytest.mark.parametrize("share", [0.1, 0.8])
def test_a_limb_whose_path_is_blocked_holds_the_point_that_it_left(checked_graph, plan, jem, share):
    simulation = Simulation(jem, plan.world.robot, controller=ControllerParameters())
    points = [jem.index(point) for point in plan.stances[0]]
    simulation.reset(*plan.configuration(0), points)
    trajectory = step_trajectory(checked_graph, plan, 0, Durations(3.0, 9.0, 3.0))
    looks = []

    def is_blocked(followed, sample):
        assert followed is trajectory
        looks.append(sample)
        return sample >= share * len(trajectory.times)

    blocked = simulation.execute(trajectory, 3, PathWatch(0.5, is_blocked))
    assert (blocked.failure.kind, blocked.failure.step) == ("blocked path", 3)
    assert blocked.failure.message.endswith(f"{plan.steps[0].to_point!r}: its path is blocked")
    assert blocked.has_turned_back
    assert simulation.points == points
    assert blocked.peaks.grasp_force.max() < 60.0
    assert np.diff(blocked.recording.times).min() > 0.0
    spacing = round(0.5 / simulation.physics.timestep)
    assert max(np.diff(looks)) == spacing
    assert looks[-1] < share * len(trajectory.times) + spacing
    again = simulation.execute(trajectory)
    assert again.failure is None
    assert not again.has_turned_back
    assert simulation.points != points


def test_a_limb_that_is_nearly_there_does_not_turn_back(checked_graph, plan, jem):
    simulation = Simulation(jem, plan.world.robot, controller=ControllerParameters())
    simulation.reset(*plan.configuration(0), [jem.index(point) for point in plan.stances[0]])
    trajectory = step_trajectory(checked_graph, plan, 0, Durations(3.0, 9.0, 3.0))
    late = len(trajectory.times) - 100
    watch = PathWatch(0.05, lambda _, sample: sample >= late)
    assert simulation.execute(trajectory, watch=watch).failure is None
