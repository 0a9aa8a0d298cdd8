"""Check the motions of single steps of five robots with MuJoCo and coal; a part of `truth.py`.

Random steps from random states are committed, and their joint paths sampled: on the lines between
knots, which are what a controller is given. There MuJoCo counts penetrating shapes, coal measures
the least distance, and forward kinematics the slip of supports. As a control, a box is put around a
limb in the middle of each motion: the check of the same swing must find it.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from coal_ruler import Ruler, grasps_of
from reports import study_rows
from scipy.spatial.transform import Rotation
from truth_collisions import Scene
from truth_walks import random_walk

from mlivr_gym import Box, Settings, stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError
from mlivr_gym.motion import JointPath
from mlivr_gym.planners import plan_of
from mlivr_gym.robot import Limb, RobotSpec, frames_of_dh
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.stances import StanceGraph

RIGHT = 0.5 * np.pi
XARM6 = (
    (0.267, 0.0, -RIGHT), (0.0, 0.28949, 0.0), (0.0, 0.0775, -RIGHT), (0.3425, 0.0, RIGHT),
    (0.0, 0.076, -RIGHT), (0.097, 0.0, 0.0),
)  # fmt: skip
"""Rows d, a [m], alpha [rad] in the standard convention, of the UFACTORY xArm 6 by its maker's user
manual; it has no closed form."""

ROBOTS = ("mlivr2", "mlivr3", "mlivr4", "mlivr2-iiwa", "numeric")
"""Two, three and four UR5e, two iiwa, and two xArm 6."""

MOST_TURN = 0.02
"""Largest turn of a joint from one sample to the next [rad]."""

BELOW = 0.1
"""Distance up to which coal measures [m]."""

TOLERANCE = 2e-4
"""Largest slip of supports that the package promises [m]."""

HALF = 0.02
"""Half edge of the box of the control [m]."""


@cache
def graph_of(robot: str) -> StanceGraph:
    """Return the stance graph of a robot on the JEM, once per process."""
    if robot == "numeric":
        arm = RobotSpec(name="xarm6", limb=Limb(*frames_of_dh(XARM6)))
        return stance_graph(robot=arm, settings=Settings(limb_threshold=0.05))
    return stance_graph(robot=robot)


def quaternions(rotations: Array) -> Array:
    """Return rotations (k, 3, 3) as quaternions w, x, y, z, (k, 4)."""
    turns: Array = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    return turns


def on_lines(knots: Array) -> tuple[Array, Array]:
    """Return joint angles on the lines between knots (k, N, n) [rad], and the number of a line."""
    joints, lines = [], list[int]()
    for k, (a, b) in enumerate(pairwise(knots)):
        count = max(1, int(np.ceil(np.abs(b - a).max() / MOST_TURN)))
        joints.append(a + np.arange(count)[:, None, None] / count * (b - a))
        lines += count * [k]
    return np.concatenate([*joints, knots[-1:]]), np.array([*lines, len(knots) - 1])


def motion(task: int, robot: str) -> dict[str, Any]:
    """Return what is measured along a random step of a robot, from a random state."""
    graph, rng = graph_of(robot), np.random.default_rng([9, task])
    states = random_walk(graph, rng, 1)
    plan = plan_of(graph, states, np.zeros(3), 0.0, "astar")
    if plan is None:
        return {"made": False}
    path = plan.joint_path(0)
    joints, line = on_lines(path.knots)
    positions, rotations = path.base(joints)
    turns = quaternions(rotations)
    before, after = (graph.indices(stance) for stance in plan.stances)
    still = [(i, point) for i, point in enumerate(before) if i != path.limb]
    first, last = path.rests[1], path.rests[-2]
    scene, ruler = Scene(graph), Ruler(graph.robot, graph.grasp_map.boxes)
    penetrating, least = 0, np.inf
    for k, q in enumerate(joints):
        # It departs from one point and approaches the other; between them it is free.
        held = [(path.limb, before[path.limb])] if line[k] < first else []
        held += [(path.limb, after[path.limb])] if line[k] >= last else []
        here = positions[k], turns[k], q
        penetrating += scene.penetrates(here, still + held)
        found = ruler.measured(here, grasps_of(graph, still + held), BELOW)
        least = min([least, *(one[0] for one in found)])
    low, high = np.stack([limb.windows for limb in graph.robot.every_limb]).transpose(2, 0, 1)
    return {
        "made": True, "configurations": len(joints), "penetrating": penetrating,
        "least": least, "slip": float(path.slips(joints).max()),
        "outside": float(np.maximum(low - joints, joints - high).max()),
        "w_m": least_manipulability(path, joints),
        "control": found_by_the_check(graph, states, path),
    }  # fmt: skip


def least_manipulability(path: JointPath, joints: Array) -> float:
    """Return the least limb manipulability of supports at joint angles (k, N, n) [rad]."""
    least = np.inf
    for i in path.supports:
        frames = link_frames(path.robot.every_limb[i], joints[:, i])
        axes, away = frames[:, 1:, :3, 2], frames[:, 6:, :3, 3] - frames[:, 1:, :3, 3]
        jacobians = np.concatenate([np.cross(axes, away), axes], axis=2)
        sizes = np.abs(np.linalg.det(jacobians)) / path.robot.characteristic_length**3
        least = min(least, float(sizes.min()))
    return least


def found_by_the_check(graph: StanceGraph, states: list[Any], path: JointPath) -> bool:
    """Return whether a motion through a box is not committed any more."""
    joints = path.knots[[len(path.knots) // 2]]
    (place,), (turn,) = path.base(joints)
    ruler = Ruler(graph.robot)
    ruler.measured((place, quaternions(turn[None])[0], joints[0]))
    links = [g for g, name in ruler.shapes.items() if name.startswith(f"limb{path.limb}/forearm")]
    links = links or [g for g, name in ruler.shapes.items() if name.startswith(f"limb{path.limb}/")]
    centre = ruler.data.geom_xpos[links[-1]]
    graph.add_obstacles([Box("across", "obstacle", tuple(centre.tolist()), (HALF,) * 3)])
    try:
        made = plan_of(graph, states, np.zeros(3), 0.0, "astar")
    except MlivrError:
        return True
    finally:
        graph.remove_obstacles()
    if made is None:
        return True
    again = made.joint_path(0).knots
    return again.shape != path.knots.shape or not np.allclose(again, path.knots)


def study_motions(number: int, workers: int) -> dict[str, Any]:
    """Measure random steps of all robots, equally many of each."""
    rows = study_rows("truth_motions:motion", number // len(ROBOTS), workers, robot=ROBOTS)
    found: dict[str, Any] = {}
    for robot in ROBOTS:
        some = [row for row in rows if row["robot"] == robot]
        made = [row for row in some if row["made"]]
        found[robot] = {
            "steps": len(some), "made": len(made),
            "configurations": sum(row["configurations"] for row in made),
            "penetrating": sum(row["penetrating"] for row in made),
            "control": sum(row["control"] for row in made),
            "least": min(row["least"] for row in made), "w_m": min(row["w_m"] for row in made),
        }  # fmt: skip
        found[robot] |= {name: max(row[name] for row in made) for name in ("slip", "outside")}
    clearance = graph_of(ROBOTS[0]).settings.clearance
    return {"clearance": clearance, "tolerance": TOLERANCE, "robots": found}
