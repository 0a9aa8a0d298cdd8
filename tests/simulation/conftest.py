"""Fixtures of the tests of the simulation: one step, and what came of it."""

import pytest
from plans import first_steps

from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.planners.walks import plan_of
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import CONTROLLERS, ControllerParameters
from mlivr_gym.simulation.simulator import Simulation

WALK = (
    ("D2a:4", "D1b:3"), ("D2b:1", "D1b:3"), ("D2b:1", "D3b:7"), ("D4b:8", "D3b:7"),
    ("D4b:8", "A6a:0"), ("A6a:8", "A6a:0"), ("A6a:8", "A6a:4"),
)  # fmt: skip
"""Stances of a walk; which of those a planner takes does not matter here."""


@pytest.fixture(scope="module")
def long_plan(checked_graph):
    """The whole walk."""
    states = [checked_graph.state(WALK[0])]
    for stance in WALK[1:]:
        states.append(checked_graph.step_to(states[-1], checked_graph.indices(stance)))
    return plan_of(checked_graph, states, (6.3, 0.5, 0.35), 0.2, "astar")


@pytest.fixture(scope="module")
def plan(long_plan):
    """One step of 0.4 m, the first of the walk."""
    return first_steps(long_plan, 1)


@pytest.fixture(scope="module")
def simulation(jem, plan):
    """Follows trajectories, not guided."""
    return Simulation(jem, plan.world.robot, controller=CONTROLLERS["feedforward"])


@pytest.fixture(scope="module")
def walked(checked_graph, plan, simulation):
    """The step at the paper's 50 s."""
    return execute(checked_graph, plan, Durations(), simulation=simulation)


@pytest.fixture
def noisy(jem, plan):
    """In the first stance of the plan, with gains of 100 N m/rad and 10 N m s/rad."""
    ranges = DisturbanceRanges(
        encoder_bias=0.02, encoder_noise=0.003, speed_noise=0.05, delay=0.008,
        sensor_position=0.004, sensor_angle=0.03,
    )  # fmt: skip
    drawn, gains = ranges.draw(3, 17, 2, len(jem)), ((100.0,) * 6, (10.0,) * 6) * 2
    simulation = Simulation(
        jem, plan.world.robot, controller=ControllerParameters(*gains), disturbance=drawn
    )
    simulation.reset(*plan.configuration(0), [jem.index(point) for point in plan.stances[0]])
    return simulation
