"""Single steps of two limbs for RRTConnect of OMPL (`pip install ompl`)."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np
from benchmark_planning import Task
from coal_ruler import Ruler, grasps_of
from reports import timed
from truth_motions import least_manipulability, quaternions

from mlivr_gym.compiled.bit_sets import bits_of
from mlivr_gym.motion import JointPath
from mlivr_gym.motion.step_ends import StepEnds, normal_knots
from mlivr_gym.planners import Planner
from mlivr_gym.stances import StanceGraph
from mlivr_gym.stances.checked_steps import join

COARSE, FINE = 0.05, 0.01
"""Distance of the configurations that OMPL checks, and of those checked afterwards [rad]."""


def some_steps(graph: StanceGraph, task: Task, rng: np.random.Generator) -> dict[bool, Any]:
    """Return a step that the package accepts and one that it refuses, from the optimal walk.

    Each is on one of its branches, and comes with the duration of its check [s]. Refused ones lead
    to a stance that can be held, by a limb that can be released from both points.
    """
    walk = Planner(graph).plan(task[0].stance, task[1], "steps").unwrap().stances
    state, found = graph.state(rng.choice(walk[:-1]).tolist()), dict[bool, Any]()
    here, (stances, postures) = graph.posture_of(state), graph.neighbouring_nodes(state.stance)
    for k in rng.permutation(len(stances)):
        there, after = postures.take(slice(k, k + 1)), tuple(stances[k].tolist())
        limb, both = int(np.argmax(stances[k] != state.stance)), join(here, there)
        free = [graph.releasable_branches(state.stance, here, limb) & state.branch_sets[limb]]
        free.append(graph.releasable_branches(after, there, limb))
        common = state.branch_sets[1 - limb] & int(there.branch_sets[0, 1 - limb])
        if all(free) and common:
            seconds, kept = timed(partial(graph.kept_on_step, state, after, both))
            bits = np.full((2, 2), bits_of(kept.get(1 - limb, common))[0])
            bits[:, limb] = [bits_of(one)[0] for one in free]
            joints = graph.joints(np.array([state.stance, after]), both, bits)
            branches, poses = bits % 8, (both.base_position, both.base_rotation)
            branch = (*branches[0].tolist(), int(branches[1, limb]))
            ends = StepEnds(limb, state.stance, after[limb], *poses, branch, joints)
            found.setdefault(bool(kept), (ends, seconds))
    return found


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
