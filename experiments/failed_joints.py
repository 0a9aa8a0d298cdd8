"""What a robot still reaches when a joint of one limb has failed.

    python experiments/failed_joints.py [--out results] [--starts 3] [--goals 8] [--workers 2]

A joint of limb 0 is locked at its present angle, in drawn states of a robot on the JEM, collisions
checked. Two iiwa then have it locked in place of joint 3 (`RobotSpec.with_failed_joint`): counted
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
from mlivr_gym.errors import RobotError
from mlivr_gym.extensions.failed_joints import reach_without
from mlivr_gym.stances import random_state

NAMES = ("mlivr2", "mlivr2-iiwa")
"""Robots that are compared."""

SETTINGS = Settings(limb_threshold=0.05)
"""Half the default threshold of w_m, which no stance of an iiwa with joint 1 or 2 locked meets.

The wrist point then lies off the plane of the first two axes by at most the forearm L, so that w_m
is at most U L^2 / l_c^3 = 0.102.
"""


def without_joint(task: int, robot: str, starts: int, goals: int) -> dict[str, Any]:
    """Return the shares of stances, or of starts, and of goals that a failed joint leaves."""
    graph, rng = stance_graph(robot=robot, settings=SETTINGS), np.random.default_rng(0)
    states = [random_state(graph, rng) for _ in range(starts)]
    places = graph.postures(graph.points[rng.integers(len(graph), size=goals)]).base_position
    out: dict[str, Any] = {"reason": None, "stances": None, "goals": None}
    try:
        counts = np.array([reach_without(graph, state, 0, task + 1, places) for state in states])
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
