"""A robot of which joints have failed: its graph, where it is, and what it still reaches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arguments import Validators, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.planners import Planner
from mlivr_gym.robot import MOST_LIMBS, RobotSpec
from mlivr_gym.schema import Integer, ListOf, Numbers
from mlivr_gym.stances import StanceGraph, State, in_same_world

SAME_ANGLE = 1e-3
"""A joint within this of its angle counts as at it [rad]."""

BRANCHES = 8
"""Number of branches of a limb."""


GIVEN: Validators = {
    "failed": ListOf(ListOf(Integer(0, MOST_LIMBS), 2, 2), 0, MOST_LIMBS),
    "limb": Integer(0, 1),
    "joint": Integer(1, 7),
    "goals": Numbers((None, 3), unit="m"),
}
"""Validators of the arguments."""


class Reach(NamedTuple):
    """What a robot reaches."""

    stances: int
    """Number of stances."""
    goals: int
    """Number of goals, of those that are asked about."""


@checked(GIVEN)
def after_failure(
    graph: StanceGraph, state: State, failed: Sequence[tuple[int, int]]
) -> tuple[StanceGraph, State]:
    """Return the graph of a robot whose joints fail in a state, and the state in which it is then.

    Failed joints are given by limb from 0 and joint from 1, and locked at their angles in the
    state. Other joints move in the robot that results; obstacles and occupied points stay. Raises
    a `RobotError` if a limb cannot move without its joints, and a `StanceError` if the new robot
    cannot plan from where it is.
    """
    state = graph.validated_state(state)
    robot, every = _locked(graph, state, failed)
    position, quaternion, _ = graph.configuration(state)
    pairs = zip(robot.every_limb, every, strict=True)
    moving = np.array([limb.moving_angles(angles) for limb, angles in pairs])
    after = in_same_world(graph, robot=robot)
    return after, after.state(graph.ids(state.stance), (*position, *quaternion), moving)


def _locked(
    graph: StanceGraph, state: State, failed: Sequence[tuple[int, int]]
) -> tuple[RobotSpec, list[Array]]:
    """Return the robot that results, and the angles of all joints of each limb in a state [rad]."""
    robot, moving = graph.robot, graph.configuration(state)[2]
    pairs = zip(robot.every_limb, moving, strict=True)
    every = [limb.all_angles(angles) for limb, angles in pairs]
    for limb, joint in failed:
        angles = every[limb] if limb in range(len(every)) else ()
        angle = angles[joint - 1] if joint in range(1, len(angles) + 1) else 0.0
        robot = robot.with_failed_joint(limb, joint, float(angle))  # refuses others
    return robot, every


@checked(GIVEN)
def reach_without(graph: StanceGraph, state: State, limb: int, joint: int, goals: Array) -> Reach:
    """Return what a robot reaches with a joint of a limb locked at its angle in a state.

    Goals have shape (k, 3) [m], with the radius `TOLERANCE`. A limb of seven joints holds the
    failed one in place of that which it held: counted are the stances of this robot, and the goals
    to which it has a plan. A limb of six stays at its point: counted are the stances that it can
    hold there, and the goals at which they are. Raises a `RobotError` if it cannot move at all.
    """
    state, chosen = graph.validated_state(state), graph.robot.every_limb[limb]
    if joint > len(chosen.joint_limits):
        raise SettingError(f"joint is {joint}; limb {limb} has {len(chosen.joint_limits)} joints")
    if chosen.locked_joint is None:
        return _on_the_spot(graph, state, limb, joint, goals)
    robot = _locked(graph, state, [(limb, joint)])[0]
    locked = in_same_world(graph, robot=robot)
    try:
        after, start = after_failure(graph, state, [(limb, joint)])
    except StanceError:
        return Reach(len(locked), 0)
    planner = Planner(after)
    return Reach(len(locked), sum(bool(planner.plan(start, goal, "steps")) for goal in goals))


TOLERANCE = 0.2
"""Radius of a goal [m]."""


def _on_the_spot(graph: StanceGraph, state: State, limb: int, joint: int, goals: Array) -> Reach:
    """Return the stances that a limb holds from where it is, and the goals at which they are."""
    angle = graph.robot.every_limb[limb].all_angles(graph.configuration(state)[2][limb])[joint - 1]
    bases = []
    for k in np.flatnonzero(graph.points[:, limb] == state.stance[limb]).tolist():
        stance = graph.points[k][None]
        postures = graph.postures(stance)
        branches = np.array([[int(held).bit_length() - 1 for held in postures.branch_sets[0]]])
        for branch in range(BRANCHES):
            branches[0, limb] = branch
            there = graph.joints(stance, postures, branches)[0, limb, joint - 1]
            if abs(np.angle(np.exp(1j * (there - angle)))) < SAME_ANGLE:
                bases.append(postures.base_position[0])
                break
    apart = np.linalg.norm(np.array(bases)[:, None] - goals[None], axis=2)
    return Reach(len(bases), int((apart <= TOLERANCE).any(axis=0).sum()))
