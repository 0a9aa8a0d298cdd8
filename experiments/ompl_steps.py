"""Single steps of two limbs for RRTConnect of OMPL (`pip install ompl`)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from benchmark_planning import Task
from coal_ruler import Ruler, grasps_of
from reports import timed
from truth_motions import least_manipulability, quaternions

from mlivr_gym.motion import JointPath, StepEnds
from mlivr_gym.motion.step_ends import normal_knots
from mlivr_gym.planners import Planner, plan_of
from mlivr_gym.stances import StanceGraph

COARSE, FINE = 0.05, 0.01
"""Distance of the configurations that OMPL checks, and of those checked afterwards [rad]."""


def some_steps(
    graph: StanceGraph, task: Task, rng: np.random.Generator
) -> Iterator[tuple[StepEnds, dict[str, Any]]]:
    """Yield a step that the package accepts and one that it refuses, from the optimal walk.

    Each is on one of its branches, and comes with the duration of its check and, if accepted, that
    of its plan [s]. Refused ones are between stances that can be held, by a limb that can be
    released from both points.
    """
    stances = Planner(graph).plan(task[0].stance, task[1], "steps").unwrap().stances
    state, known = graph.state(rng.choice(stances[:-1]).tolist()), set[bool]()
    for after in map(tuple, rng.permutation(graph.neighbouring_nodes(state.stance)[0]).tolist()):
        limb, both = (
            int(after[1] != state.stance[1]),
            graph.postures_of([state, graph.state(after)]),
        )
        parts = [both.take(slice(k, k + 1)) for k in range(2)]
        free = [
            graph.releasable_branches(stance, part, limb)
            for stance, part in zip((state.stance, after), parts, strict=True)
        ]
        kept = int(np.bitwise_and(*both.branch_sets[:, 1 - limb]))
        seconds, reached = timed(partial(graph.state_after, state, after, both))
        figures = {"accepted": reached is not None, "check": seconds}
        if figures["accepted"] in known or not (all(free) and kept):
            continue
        known.add(figures["accepted"])
        if reached is not None:
            kept, walk = reached.branch_sets[1 - limb], [state, reached]
            figures["plan"], plan = timed(partial(plan_of, graph, walk, task[1], 0.0, "astar"))
            assert plan is not None
        # The lowest branch of each set.
        bits = np.full((2, 2), (kept & -kept).bit_length() - 1)
        bits[:, limb] = [(one & -one).bit_length() - 1 for one in free]
        joints = graph.joints(np.array([state.stance, after]), both, bits)
        branches = (*(bits[0] % 8).tolist(), int(bits[1, limb]) % 8)
        poses = both.base_position, both.base_rotation
        yield StepEnds(limb, state.stance, after[limb], *poses, branches, joints), figures


def connect(graph: StanceGraph, ruler: Ruler, ends: StepEnds, seconds: float) -> dict[str, Any]:
    """Return what RRTConnect finds in a processor time [s], from above a point to above another.

    The support's gripper stays; the robot keeps its clearance and the floor of manipulability.
    """
    from ompl import base, geometric

    limb, settings, checks, above = ends.limb, graph.settings, 0, ends.joints.copy()
    above[:, limb] = [normal_knots(graph, ends, side)[-1] for side in range(2)]
    start = ends.positions[0], ends.rotations[0]
    path = JointPath(graph.robot, limb, 1 - limb, *start, ends.joints[:1], (0,))
    grasp = grasps_of(graph, [(1 - limb, ends.before[1 - limb])])

    def valid(state: Any) -> bool:
        nonlocal checks
        checks += 1
        joints = np.array([state[j] for j in range(12)]).reshape(1, 2, 6)
        (place,), turns = path.base(joints)
        close = ruler.measured((place, quaternions(turns)[0], joints[0]), grasp, settings.clearance)
        return not close and least_manipulability(path, joints) >= settings.path_floor

    space, bounds = base.RealVectorStateSpace(12), base.RealVectorBounds(12)
    windows = np.concatenate([arm.windows for arm in graph.robot.every_limb])
    states = [space.allocState() for _ in above]
    for j, (low, high) in enumerate(windows.tolist()):
        bounds.setLow(j, low)
        bounds.setHigh(j, high)
        for state, joints in zip(states, above.reshape(2, 12).tolist(), strict=True):
            state[j] = joints[j]
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(valid)
    info = setup.getSpaceInformation()
    info.setStateValidityCheckingResolution(COARSE / space.getMaximumExtent())
    setup.setStartAndGoalStates(*states, 1e-6)
    setup.setPlanner(geometric.RRTConnect(info))
    end = time.process_time() + seconds
    limit = base.PlannerTerminationCondition(lambda: time.process_time() > end)
    spent, _ = timed(partial(setup.solve, limit))
    found = {"seconds": spent, "checks": checks, "solved": setup.haveExactSolutionPath()}
    if found["solved"]:
        solution = setup.getSolutionPath()
        found["length"] = solution.length()
        solution.interpolate(int(solution.length() / FINE) + 2)
        found["clear"] = all(map(valid, solution.getStates()))
    return found | {"ends": all(map(valid, states))}
