"""The reaction of steps against MuJoCo's grasps and Pinocchio, and plans by time and reaction."""

import json

import numpy as np
import pytest
from pinocchio_loads import loads_of

from mlivr_gym.cli.main import main
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import NoPlanError, PlanError, TimingError
from mlivr_gym.extensions.reaction.fastest import (
    COSTS,
    ranked_plans,
    step_reactions,
    with_least_reaction,
)
from mlivr_gym.extensions.reaction.reaction import reaction_of
from mlivr_gym.extensions.station_load.spectra import station_load
from mlivr_gym.motion.commitment import commitments
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import PACES, Limits
from mlivr_gym.simulation.timing import step_trajectory, timed_path


@pytest.fixture(scope="module")
def planner(checked_graph):
    return Planner(checked_graph)


@pytest.fixture(scope="module")
def walk(planner):
    """Two steps."""
    return planner.plan(("D2a:4", "D2b:4"), (2.8, 0.0, 0.0)).unwrap()


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


def test_the_fastest_is_no_slower_than_the_plans_of_the_paper(planner):
    rng, several = np.random.default_rng(1), 0
    for _ in range(2):
        start, goal = sample_task(planner.graph, rng, 0.2)
        found = ranked_plans(planner, start.stance, goal)
        times = [one.seconds for one in found]
        assert times == sorted(times)
        assert len({one.plan.stances for one in found}) == len(found) <= len(COSTS)
        for cost in ("base", "steps"):
            plan = planner.plan(start.stance, goal, cost).unwrap()
            seconds = sum(one.seconds for one in step_reactions(planner.graph, plan))
            assert times[0] <= seconds + 1e-9
        several += len(found) > 1
    assert several


def test_its_seconds_are_those_that_pass_when_it_is_carried_out(planner):
    goal = (6.0, 0.0, 0.42)
    best = ranked_plans(planner, ("D2a:4", "D2b:4"), goal, PACES["gentle"])[0]
    execution = execute(planner.graph, best.plan, PACES["gentle"])
    assert execution.failure is None
    planned = [one.seconds for one in step_reactions(planner.graph, best.plan, PACES["gentle"])]
    waited = execution.step_times - planned
    # A step takes whole periods, and a gripper may wait before its point.
    assert (waited > -1e-9).all()
    assert (waited < 1.0 + 0.002).all()
    fixed = step_reactions(planner.graph, best.plan, Durations())
    np.testing.assert_allclose([one.seconds for one in fixed], 50.0)
    with pytest.raises(NoPlanError):
        ranked_plans(planner, ("D2a:4", "D2b:4"), goal, goal_tolerance=1e-6)


def test_the_plan_of_least_reaction_is_the_first_one_listed(tmp_path, planner, jem, capsys):
    file = tmp_path / "plan.json"
    query = "rank --start D2a:4 D2b:4 --goal 2.8 0 0 --by reaction --out"
    assert main([*query.split(), str(file)]) == 0
    out = capsys.readouterr().out
    impulses = [float(line.split(" N s")[0].split(",")[-1]) for line in out.splitlines()
                if " N s" in line]  # fmt: skip
    assert impulses == sorted(impulses)
    steps = step_reactions(planner.graph, Plan.load(file, jem))
    assert sum(step.impulse for step in steps) == pytest.approx(impulses[0], rel=0.01)
