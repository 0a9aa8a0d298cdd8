"""Measure the speed of a robot of two UR5e with the package that Python finds; print it as JSON.

`ur_speed.py` runs it with an older checkout and with this one, so it uses what both have. All times
are processor time, of a second call.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mlivr_gym import robot_spec, stance_graph
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.planners import Planner

POSES, QUERIES = 20_000, 100
"""Numbers of flange poses and of plans."""


def seconds(call: Callable[[], Any]) -> float:
    """Return the time of a call [s]."""
    began = time.process_time()
    call()
    return time.process_time() - began


def inverse_kinematics() -> float:
    """Return the time of all branches of one flange pose within a sphere about the base [s]."""
    rng, count = np.random.default_rng(0), 8 * POSES
    bases, grasps, out = Pose.rows(count), Grasp.rows(count)[:, None], Angles.rows(count)[:, None]
    bases["rotation"][:] = np.eye(3)
    turns = np.linalg.qr(rng.normal(size=(POSES, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    grasps["flange"]["rotation"][:, 0] = np.repeat(turns, 8, axis=0)
    places = rng.uniform(-0.6, 0.6, (POSES, 3))
    grasps["flange"]["position"][:, 0] = np.repeat(places, 8, axis=0)
    given = (LimbShapes(robot_spec("mlivr2")).rows, bases, grasps)
    bits = np.tile(np.arange(8), POSES)[:, None]
    held_angles(*given, bits, out)
    return seconds(lambda: held_angles(*given, bits, out)) / POSES


def stance_set() -> tuple[float, int]:
    """Return the time of a stance set without a stored table [s], and the number of stances.

    Another height of the lift, by next to nothing, is another robot.
    """
    robots = [replace(robot_spec("mlivr2"), lift=0.1 + further) for further in (1e-9, 2e-9)]
    first: Any = stance_graph(robot=robots[0])
    return seconds(lambda: stance_graph(robot=robots[1])), len(first)


def queries() -> tuple[float, float]:
    """Return the median time of a plan with fewest steps to a new goal [s], and the mean cost."""
    graph: Any = stance_graph()
    planner, rng, took, costs = Planner(graph), np.random.default_rng(0), [], []
    for a, b in rng.integers(len(graph), size=(QUERIES, 2)):
        goal = graph.postures(graph.points[b][None]).base_position[0]
        start, begun = graph.points[a].tolist(), time.process_time()
        plan = planner.plan(start, goal, "steps").unwrap()
        took.append(time.process_time() - begun)
        costs.append(len(plan.steps))
    return float(np.median(took)), float(np.mean(costs))


if __name__ == "__main__":
    stances, count = stance_set()
    query, steps = queries()
    print(json.dumps({
        "inverse_kinematics_s": inverse_kinematics(), "stance_set_s": stances, "stances": count,
        "query_s": query, "steps": steps,
    }))  # fmt: skip
