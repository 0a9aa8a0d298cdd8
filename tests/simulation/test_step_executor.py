"""Steps of a robot that is on one branch a limb: each one that leaves its state is executable."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.motion.trajectory import trajectory
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.step_executor import StepExecutor
from mlivr_gym.simulation.timing import timed_path
from mlivr_gym.stances.random_states import random_state


@pytest.fixture(scope="module")
def executor(small_checked_graph):
    return StepExecutor(small_checked_graph, Setup())


def test_every_step_that_leaves_a_state_has_a_swing_inside_the_joint_limits(
    small_checked_graph, executor
):
    graph, rng = small_checked_graph, np.random.default_rng(0)
    low, high = graph.robot.limb.windows.T
    steps = 0
    for _ in range(6):
        executor.start(random_state(graph, rng))
        left = graph.successors(executor.state)
        for k in rng.choice(len(left.limb), 15):
            after = left.after(executor.state, int(k))
            found = executor._committed(after)
            assert found is not None
            for joints in (found[0].knots, found[0].samples(41).joint_positions):
                assert (joints >= low - 1e-6).all()
                assert (joints <= high + 1e-6).all()
            steps += 1
    assert steps > 50


def test_a_plan_begins_on_the_branches_and_half_turns_of_its_joint_angles(
    small_checked_graph, executor
):
    """The angles of the state, found from its branches, are the plan's but for whole turns.

    The plan's have six digits, as a file may have.
    """
    graph, rng, turned = small_checked_graph, np.random.default_rng(2), set()
    for _ in range(30):
        start, goal = sample_task(graph, rng, 0.2)
        plan = Planner(graph).plan(start.stance, goal, "steps").unwrap()
        motion = replace(plan.motion, joint_positions=plan.motion.joint_positions.round(6))
        state = executor.start(graph.state(plan.stances[0]), replace(plan, motion=motion))
        off = np.exp(1j * graph.configuration(state)[2]) - np.exp(
            1j * plan.motion.joint_positions[0]
        )
        assert np.abs(off).max() < 1e-5
        turned |= {branch_set >= 1 << 8 for branch_set in state.branch_sets}
    assert turned == {False, True}


@pytest.mark.parametrize("begun", ["start", "follow"])
def test_the_path_of_a_plan_is_taken_as_long_as_the_steps_are_its_own(
    small_checked_graph, executor, begun
):
    graph, rng = small_checked_graph, np.random.default_rng(3)
    plans = (
        Planner(graph).plan(start.stance, goal, "steps").unwrap()
        for start, goal in (sample_task(graph, rng, 0.2) for _ in range(30))
    )
    plan = next(one for one in plans if len(one.steps) >= 3)

    states = graph.states_along(
        graph.state(plan.stances[0]), [graph.indices(stance) for stance in plan.stances[1:]]
    )

    def prepared(k):
        limb, after = plan.steps[k].limb, states[k + 1]
        made = executor.prepared(limb, after.stance[limb], after.branch_sets)
        own = timed_path(plan.joint_path(k), executor.setup.timing)
        own = trajectory(graph.grasp_map, plan.stances[k : k + 2], own, 0.002).joint_positions
        taken = made.trajectory.joint_positions
        np.testing.assert_allclose(taken[0], executor.joints, atol=1e-12)
        executor.state, executor.joints = made.after, taken[-1]  # as if it had been simulated
        return taken.shape == own.shape and np.allclose(taken, own, atol=1e-12)

    executor.start(graph.state(plan.stances[0]), plan if begun == "start" else None)
    if begun == "follow":
        executor.joints = plan.joint_path(0).knots[0]
        executor.follow(plan)
    assert all(prepared(k) for k in range(len(plan.steps)))
    executor.start(graph.state(plan.stances[0]), plan)
    assert prepared(0)
    executor.joints = executor.joints + 2e-5
    executor.follow(plan)  # which begins elsewhere
    assert not prepared(1)


def test_captures_and_failures_carry_the_step_of_the_walk(small_checked_graph, executor):
    """A step that is refused and the way back have the index of the step that is taken next."""
    graph = small_checked_graph
    state = executor.start(random_state(graph, np.random.default_rng(0)))
    for step in range(2):
        steps = graph.successors(state)
        limb, point = int(steps.limb[0]), int(steps.point[0])
        branch_sets = steps.after(state, 0).branch_sets
        if step == 1:
            executor.simulation.refusing = frozenset([point])
            _, executed = executor.step(limb, point, branch_sets)
            assert (executed.failure.kind, executed.failure.step) == ("refused grasp", 1)
            assert executor.measures["failure"]["step"] == 1
            assert executor.retreat().captures[0].step == 1
            executor.simulation.refusing = frozenset()
        state, executed = executor.step(limb, point, branch_sets)
        assert executed.captures[0].step == step
        assert set(executed.recording.step.tolist()) == {step}
        assert executor.steps_done == step + 1
    assert executor._not_begun(0, 0, "no reason").step == 2
    executor.start(state)
    assert executor.steps_done == 0
