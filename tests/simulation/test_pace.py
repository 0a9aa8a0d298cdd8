import numpy as np
import pytest
from plans import first_steps

from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.motion.trajectory import Durations
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.dynamics import Physics, torque_limits
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.pace import MARGIN, longer_step, torque_demand


@pytest.fixture(scope="module")
def plan(checked_graph):
    """The first step of the README's plan."""
    whole = Planner(checked_graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps").unwrap()
    return first_steps(whole, 1)


def test_the_torques_a_plan_needs_are_those_that_its_simulation_measures(checked_graph, plan):
    demand = torque_demand(checked_graph, plan, Durations.of_step(50.0), Physics())
    measured = execute(checked_graph, plan).peaks.joint_torque
    assert demand == pytest.approx(float((measured / torque_limits()).max()), rel=0.02)
    for duration in (20.0, 5.0):
        faster = torque_demand(checked_graph, plan, Durations.of_step(duration), Physics())
        assert faster == pytest.approx(demand * (50.0 / duration) ** 2, rel=1e-2)


@pytest.mark.parametrize(("duration", "kind"), [(8.0, "saturation"), (2.0, "lost hold")])
def test_the_duration_that_is_hinted_at_succeeds_and_is_not_much_too_long(
    checked_graph, plan, duration, kind
):
    failed = execute(checked_graph, plan, Durations.of_step(duration))
    assert failed.failure is not None
    assert failed.failure.kind == kind
    longer = longer_step(checked_graph, failed)
    assert execute(checked_graph, plan, Durations.of_step(longer)).failure is None
    shorter = Durations.of_step(longer / MARGIN**2)
    assert execute(checked_graph, plan, shorter).failure is not None


def test_lag_hints_at_a_longer_step_too(checked_graph):
    """The paper's controller lags behind and misses; the estimate serves."""
    physics, rng = Physics(feedforward=False), np.random.default_rng(0)
    for _ in range(30):
        start, goal = sample_task(checked_graph, rng, 0.3)
        plan = first_steps(Planner(checked_graph).plan(start.stance, goal).unwrap(), 1)
        failed = execute(checked_graph, plan, Durations.of_step(30.0), physics)
        if failed.failure is not None and failed.failure.kind == "missed grasp":
            break
    assert failed.failure.kind == "missed grasp"
    longer = longer_step(checked_graph, failed)
    assert 30.0 < longer < 100.0
    assert execute(checked_graph, plan, Durations.of_step(longer), physics).failure is None


def test_where_time_does_not_help_there_is_no_hint(checked_graph, plan):
    weak = execute(checked_graph, plan, physics=Physics(hold_force=0.1))
    assert weak.failure is not None
    assert weak.failure.kind == "lost hold"
    assert longer_step(checked_graph, weak) is None
    done = execute(checked_graph, plan, Durations.of_step(30.0))
    assert done.failure is None
    assert longer_step(checked_graph, done) is None
    assert np.isfinite(done.peaks.joint_torque).all()
