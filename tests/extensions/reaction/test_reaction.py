"""The reaction of a step against the forces of MuJoCo's grasps, and against Pinocchio."""

import json

import numpy as np
import pytest
from pinocchio_loads import loads_of

from mlivr_gym.errors import PlanError, TimingError
from mlivr_gym.extensions.reaction.fastest import step_reactions, with_least_reaction
from mlivr_gym.extensions.reaction.reaction import reaction_of
from mlivr_gym.extensions.station_load.spectra import station_load
from mlivr_gym.motion.commitment import commitments
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import Limits
from mlivr_gym.simulation.timing import step_trajectory, timed_path


@pytest.fixture(scope="module")
def walk(checked_graph):
    """Two steps."""
    return Planner(checked_graph).plan(("D2a:4", "D2b:4"), (2.8, 0.0, 0.0)).unwrap()


@pytest.fixture(scope="module")
def chosen(checked_graph, walk):
    return with_least_reaction(checked_graph, walk)


def test_the_grasps_of_the_simulation_feel_the_planned_reaction(checked_graph, chosen):
    execution = execute(checked_graph, chosen)
    assert execution.failure is None
    load = station_load(execution.recording)
    sizes = np.linalg.norm(load.forces, axis=1)
    for k, reaction in enumerate(step_reactions(checked_graph, chosen)):
        during = execution.recording.step == k
        felt = np.trapezoid(sizes[during], load.times[during])
        assert reaction.impulse == pytest.approx(felt, rel=0.03)
        assert reaction.peak_force == pytest.approx(load.peak_forces[k], rel=0.1)


@pytest.mark.parametrize("limits", [Limits(), Limits(grasp_force=1.0)])
def test_impulse_and_peak_are_those_of_pinocchios_momentum(checked_graph, walk, limits):
    """Its momentum along the sampled trajectory, differentiated numerically.

    With the second limits the force of the grasp decides; that is the reaction.
    """
    way = step_trajectory(checked_graph, walk, 0, limits)
    momenta = loads_of(checked_graph.robot, way, [1 - walk.steps[0].limb]).momenta
    forces = np.linalg.norm(np.diff(momenta, axis=0), axis=1) / way.period
    reaction = step_reactions(checked_graph, walk, limits)[0]
    assert reaction.seconds == pytest.approx(way.times[-1], abs=way.period)
    assert reaction.peak_force == pytest.approx(forces.max(), rel=2e-3)
    assert reaction.impulse == pytest.approx(forces.sum() * way.period, rel=1e-3)


def least_impulses(graph, plan):
    """The least total impulse of each step of a plan with its base poses, over all clear swings."""
    least = []
    for k in range(len(plan.steps)):
        swings = commitments(graph, StepEnds.of(graph, plan.motion, k))
        least.append(min(reaction_of(timed_path(one.path)).impulse for one in swings))
    return np.array(least)


def test_no_other_clear_swing_has_less_reaction_and_no_swing_at_the_given_base_poses(
    checked_graph, walk, chosen
):
    impulses = np.array([one.impulse for one in step_reactions(checked_graph, chosen)])
    np.testing.assert_allclose(impulses, least_impulses(checked_graph, chosen), rtol=1e-9)
    assert impulses.sum() < 0.99 * least_impulses(checked_graph, walk).sum()
    assert chosen.stances == walk.stances


def test_durations_that_the_plan_can_keep_stay_possible(checked_graph, walk):
    """They are hardly longer than it needs, so that many other base poses are too slow."""
    graph, plan, shortest = checked_graph, walk, []
    for k in range(2):
        with pytest.raises(TimingError) as refused:
            step_trajectory(graph, plan, k, Durations.of_step(1.0))
        shortest.append(refused.value.shortest)
    with pytest.raises(TimingError):
        with_least_reaction(graph, plan, Durations.of_step(0.99 * max(shortest)))
    pace = Durations.of_step(1.01 * max(shortest))
    new = with_least_reaction(graph, plan, pace)
    after, before = (step_reactions(graph, one, pace) for one in (new, plan))
    assert sum(one.impulse for one in after) < sum(one.impulse for one in before)


def test_a_file_keeps_the_chosen_swings_and_no_others(checked_graph, jem, chosen):
    data = json.loads(json.dumps(chosen.to_dict()))
    assert Plan.from_dict(data, jem).motion.steps == chosen.motion.steps
    data["motion"]["steps"][0]["knots"][8][0][1] += 1e-3
    with pytest.raises(PlanError, match=r"motion\.steps\[0\]"):
        Plan.from_dict(data, jem)
