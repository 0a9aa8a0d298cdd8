"""A limb that lets go and folds because a joint of it has failed and it has none to spare.

With a locked joint a limb of six can neither follow the base nor place its gripper. But it can stay
as it is while the others lift the body off its point, along the normal. There RRT-Connect finds a
path of its five joints to where it stands folded; its lines are certified as those of a swing, the
lift is checked at samples. Folded, the limb is a part of the body, which the others carry on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.carrying import carrying_robot, folds
from mlivr_gym.collisions.contacts import Configuration, contacts
from mlivr_gym.compiled.bit_sets import bits_of
from mlivr_gym.errors import RobotError, StanceError
from mlivr_gym.kinematics.base_path import STRAIGHT, base_path
from mlivr_gym.kinematics.holding import joints_along
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import pose, poses
from mlivr_gym.motion.swings import SupportLimb, SwingFinder
from mlivr_gym.planners.rrt_connect import connected
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

NOTHING = Cargo(mass=0.001, size=0.01)
"""What a folded limb carries; a bag that weighs next to nothing, inside its gripper."""

LIFT_SAMPLES = 12
"""Number of configurations at which the lift off a point is checked."""

MAX_JUMP = 0.3
"""Largest change of a joint between two of these [rad]."""

MOST_FOLDS = 3
"""Number of folds to which a path is sought."""


class FoldedLimb(NamedTuple):
    """A limb with a failed joint that has let go."""

    robot: RobotSpec
    """The robot of the other limbs, whose body has the folded limb."""
    positions: Array
    """Base positions while the others lift the body off its point, shape (k, 3) [m]."""
    joints: Array
    """Joint angles of all limbs there, shape (k, N, 6) [rad]."""
    knots: Array
    """Its joint angles from there to its fold, the base at rest, shape (m, 6) [rad]."""


def robot_with_folded_limb(robot: RobotSpec, limb: int, locked: tuple[int, float]) -> RobotSpec:
    """Return the robot of the other limbs of which one stands folded, with a locked joint.

    `locked` is the joint, from 1, and its angle [rad]; the fold is the one nearest to the body.
    Raises a `RobotError` if the limb can fold nowhere.
    """
    reason = "no posture with its gripper beside or above the body lies inside its joint limits"
    for fold in folds(robot, limb, NOTHING, locked):
        try:
            return _carrying(robot, limb, locked[0], fold)
        except RobotError as fault:
            reason = str(fault)
    raise RobotError(f"limb {limb} cannot fold with joint {locked[0]} failed: {reason}")


def folded_limb(
    graph: StanceGraph, state: State, joints: Array, limb: int, locked: tuple[int, float]
) -> FoldedLimb:
    """Return how a limb lets go of its point and folds, where the others hold theirs.

    Joint angles at the state have shape (N, 6) [rad]. Raises a `StanceError` if it cannot let go,
    or no fold can be reached from there.
    """
    robot, settings = graph.robot, graph.settings
    position, quaternion, _ = graph.configuration(state)
    positions, angles = _lift(graph, state, (position, quaternion, joints), limb)
    start = angles[-1, limb]
    here = pose(positions[-1], graph.posture_of(state).base_rotation[0])
    supports = [
        SupportLimb(i, point, bits_of(state.branch_sets[i])[0] & 7)
        for i, point in enumerate(state.stance)
        if i != limb
    ]
    path = base_path(here, here, STRAIGHT, np.zeros(3))
    finder, limits = SwingFinder(graph, limb, path, supports), robot.every_limb[limb].windows.copy()
    limits[locked[0] - 1] = locked[1]

    def is_clear(first: Array, last: Array) -> bool:
        knots = np.stack([first, last])
        return not settings.collisions or finder.is_clear(np.insert(knots, 0, 0.0, axis=1))

    paths = 0
    for fold in folds(robot, limb, NOTHING, locked):
        if not is_clear(fold, fold):
            continue
        try:
            others = _carrying(robot, limb, locked[0], fold)
        except RobotError:
            continue
        knots = connected(start, fold, limits, is_clear)
        if knots is not None:
            return FoldedLimb(others, positions, angles, knots)
        paths += 1
        if paths == MOST_FOLDS:
            break
    raise StanceError(
        f"limb {limb}, of which joint {locked[0]} has failed, can let go of "
        f"{graph.ids(state.stance)[limb]!r} but reaches no fold from there ({paths} tried)"
    )


def _carrying(robot: RobotSpec, limb: int, joint: int, fold: Array) -> RobotSpec:
    carrier = carrying_robot(robot, limb, NOTHING, joints=tuple(fold.tolist()))
    return replace(carrier, name=f"{robot.name}-limb{limb}-joint{joint}")


def _lift(
    graph: StanceGraph, state: State, configuration: Configuration, limb: int
) -> tuple[Array, Array]:
    """Return base positions (k, 3) [m] and joint angles (k, N, 6) [rad] while a gripper is lifted.

    The limb does not move; the others follow the body. Raises a `StanceError` if they cannot.
    """
    robot, (position, quaternion, joints) = graph.robot, configuration
    name, normal = graph.ids(state.stance)[limb], graph.solver.grasps[state.stance[limb]]["normal"]
    fault = f"limb {limb} cannot let go of {name!r}: "
    rotation = graph.posture_of(state).base_rotation[0]
    places = position + np.linspace(0.0, robot.lift, LIFT_SAMPLES)[:, None] * normal
    bases = poses(places, np.tile(rotation, (LIFT_SAMPLES, 1, 1)))
    out = np.stack([joints] * LIFT_SAMPLES)
    for i, point in enumerate(state.stance):
        if i == limb:
            continue
        flange, branch = graph.solver.grasps[point]["flange"], bits_of(state.branch_sets[i])[0] & 7
        flanges = poses(flange["position"][None], flange["rotation"][None])
        rows, reference = Angles.rows(LIFT_SAMPLES), Angles.row()
        reference["q"] = joints[i]
        followed = joints_along(graph.checks.robots, i, bases, flanges, branch, reference, rows)
        out[1:, i], (low, high) = rows["q"][1:], robot.every_limb[i].windows.T
        inside = (out[1:, i] >= low).all() and (out[1:, i] <= high).all()
        smooth = np.abs(np.diff(out[:, i], axis=0)).max() <= MAX_JUMP
        if followed < LIFT_SAMPLES or not (inside and smooth):
            raise StanceError(f"{fault}limb {i} does not follow the body {robot.lift:g} m off it")
    if graph.settings.collisions:
        for place, angles in zip(places[1:], out[1:], strict=True):
            _check(graph, state, (place, quaternion, angles), fault)
    return places, out


def _check(graph: StanceGraph, state: State, here: Configuration, fault: str) -> None:
    """Refuse a configuration in which a limb touches something but what lies behind its point."""
    rows, clearance = graph.solver.grasps, graph.settings.clearance
    grasps = [(i, rows[p]["point"], rows[p]["normal"]) for i, p in enumerate(state.stance)]
    boxes = (*graph.grasp_map.boxes, *graph.obstacles)
    for close in contacts(graph.robot, boxes, here, clearance, grasps):
        raise StanceError(
            f"{fault}{close.first} would come to {close.distance:.3f} m from {close.second}"
        )
