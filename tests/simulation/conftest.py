"""Fixtures of the tests of the simulation: one step, and what came of it."""

import pytest
from plans import first_steps

from mlivr_gym.motion.clocks import Durations
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.controller import FEEDFORWARD
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.simulator import Simulation


@pytest.fixture(scope="module")
def plan(checked_graph):
    """One step of 0.4 m."""
    whole = Planner(checked_graph).plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()
    return first_steps(whole, 1)


@pytest.fixture(scope="module")
def simulation(jem, plan):
    """Follows trajectories, not guided."""
    return Simulation(jem, plan.world.robot, controller=FEEDFORWARD)


@pytest.fixture(scope="module")
def walked(checked_graph, plan, simulation):
    """The step at the paper's 50 s."""
    return execute(checked_graph, plan, Durations(), simulation=simulation)
