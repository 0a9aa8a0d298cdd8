"""What a robot still reaches when a joint of one limb has failed.

    python experiments/failed_joints.py [--out results] [--starts 3] [--goals 8] [--workers 2]

A joint of limb 0 is locked at its present angle, in drawn states of a robot on the JEM, collisions
checked. Two iiwa then hold that joint in place of joint 3 (`RobotSpec.with_failed_joint`): counted
are the stances of the robot that results and the drawn goals to which it has a plan from the state
in which it is. Two UR5e have no such choice: counted are the stances that limb 0 can hold where it
is with the joint at its angle, and the goals at which they are. Writes `failed_joints.json` and
`failed_joints.md`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from reports import CORES, NOTHING, experiment, study_rows, table

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.errors import RobotError, StanceError
from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.transitions.state import State

NAMES = ("mlivr2", "mlivr2-iiwa")
"""Robots that are compared."""

SETTINGS = Settings(limb_threshold=0.05)
"""Half the default threshold of w_m, which no stance of an iiwa with joint 1 or 2 held meets.

The wrist point then lies off the plane of the first two axes by at most the forearm L, so that w_m
is at most U L^2 / l_c^3 = 0.102.
"""

TOLERANCE = 0.2
"""Radius of a goal [m]."""

SAME_ANGLE = 1e-3
"""A joint within this of its angle counts as at it [rad]."""


def joint_angles(graph: StanceGraph, state: State) -> np.ndarray:
    """Return the angles of all joints of limb 0 [rad]."""
    angles: np.ndarray = graph.robot.every_limb[0].all_angles(graph.configuration(state)[2][0])
    return angles


def reached_on_the_spot(
    graph: TwoLimbGraph, state: State, joint: int, goals: np.ndarray
) -> tuple[int, int]:
    """Return the stances that limb 0 holds from where it is, and the goals at which they are."""
    angle = joint_angles(graph, state)[joint - 1]
    sharing = np.flatnonzero(graph.points[:, 0] == state.stance[0])
    bases = []
    for k in sharing.tolist():
        stance = graph.points[k]
        postures = graph.postures(stance[None])
        for branch in range(8):
            bits = np.array([[branch, int(postures.branch_sets[0, 1]).bit_length() - 1]])
            there = graph.joints(stance[None], postures, bits)[0, 0, joint - 1]
            if abs(np.angle(np.exp(1j * (there - angle)))) < SAME_ANGLE:
                bases.append(postures.base_position[0])
                break
    apart = np.linalg.norm(np.array(bases)[:, None] - goals[None], axis=2)
    return len(bases), int((apart <= TOLERANCE).any(axis=0).sum())


def reached_with_the_joint_held(
    graph: TwoLimbGraph, state: State, joint: int, goals: np.ndarray
) -> tuple[int, int]:
    """Return the stances of the robot that holds the joint, and the goals that it can reach."""
    every = joint_angles(graph, state)
    failed = stance_graph(
        robot=graph.robot.with_failed_joint(0, joint, every[joint - 1]), settings=SETTINGS
    )
    position, quaternion, joints = graph.configuration(state)
    joints[0] = failed.robot.every_limb[0].moving_angles(every)
    try:
        start = failed.state(graph.ids(state.stance), (*position, *quaternion), joints)
    except StanceError:
        return len(failed), 0
    planner = Planner(failed)
    return len(failed), sum(bool(planner.plan(start, goal, "steps").plan) for goal in goals)


def without_joint(task: int, robot: str, starts: int, goals: int) -> dict[str, Any]:
    """Return the shares of stances, or of starts, and of goals that a failed joint leaves."""
    graph, rng = stance_graph(robot=robot, settings=SETTINGS), np.random.default_rng(0)
    assert isinstance(graph, TwoLimbGraph)
    states = [random_state(graph, rng) for _ in range(starts)]
    places = graph.postures(graph.points[rng.integers(len(graph), size=goals)]).base_position
    held = graph.robot.every_limb[0].held_joint
    count = reached_on_the_spot if held is None else reached_with_the_joint_held
    out: dict[str, Any] = {"reason": None, "stances": None, "goals": None}
    try:
        counts = np.array([count(graph, state, task + 1, places) for state in states])
    except RobotError as fault:
        return out | {"reason": str(fault)}
    shares = counts.sum(axis=0) / (starts * np.array([len(graph), goals]))
    return out | dict(zip(("stances", "goals"), shares.tolist(), strict=True))


def measured(starts: int, goals: int, workers: int) -> dict[str, Any]:
    """Return what is left of each robot for each joint of limb 0."""
    found: dict[str, Any] = {}
    given = {"starts": [starts], "goals": [goals]}
    for name in NAMES:
        joints = len(robot_spec(name).limb.joint_limits)
        rows = study_rows("failed_joints:without_joint", joints, workers, robot=[name], **given)
        found[name] = {
            "starts": starts,
            "goals": goals,
            "joints": {
                str(row["task"] + 1): {key: row[key] for key in ("stances", "goals", "reason")}
                for row in rows
            },
        }
    return found


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    rows = [
        (name, f"{data[name]['starts']}, {data[name]['goals']}", joint,
         *(NOTHING if row[key] is None else f"{100 * row[key]:.3g} %"
           for key in ("stances", "goals")))
        for name in NAMES
        for joint, row in data[name]["joints"].items()
    ]  # fmt: skip
    head = "robot | starts, goals | failed joint of limb 0 | stances left | goals reached"
    return (
        "# Failed joints\n\nMeans over drawn starts and drawn goals for each, made by "
        "`experiments/failed_joints.py`; collisions checked, w_m >= "
        f"{SETTINGS.limb_threshold:g}. A dash in both columns: the other six joints have no closed "
        "form here, so that the limb cannot move.\n\n" + table(head, rows)
    )


if __name__ == "__main__":
    experiment("failed_joints", __doc__, measured, markdown, starts=3, goals=8, workers=CORES)
