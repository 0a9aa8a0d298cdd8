"""Time as a cost: the fastest of several plans."""

import numpy as np
import pytest

from mlivr_gym.cli.main import main
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import NoPlanError
from mlivr_gym.extensions.reaction.fastest import COSTS, ranked_plans, step_reactions
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import PACES


@pytest.fixture(scope="module")
def planner(checked_graph):
    return Planner(checked_graph)


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


def test_a_goal_that_cannot_be_reached_has_no_ranked_plans(planner):
    with pytest.raises(NoPlanError):
        ranked_plans(planner, ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), goal_tolerance=1e-6)


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
