"""The intervals at which the certificate of a base path looks, for a figure.

The certificate runs compiled and tells only its answer. Here a second process runs the same code
with compilation switched off, and writes down what it looks at.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import numpy as np

from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics import certificate
from mlivr_gym.kinematics.base_path import base_path
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.motion.regrasp import Regrasp
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.stances.stance_graph import StanceGraph

VERDICTS = ("proved", "halved", "below")
"""On an interval `w_m` stays above the floor, or that is not decided; or its middle is below it."""


def intervals(
    graph: StanceGraph, regrasp: Regrasp, limb: int, branch: int
) -> list[tuple[float, float, str]]:
    """Intervals of a regrasp's base path in the order in which they are looked at.

    Args:
        graph: The stance graph; its robot is one that ships.
        regrasp: The regrasp.
        limb: A limb that holds.
        branch: Its branch.

    Returns:
        Middle, half length, and one of `VERDICTS`.
    """
    flange = graph.solver.grasps[regrasp.before[limb]]["flange"]
    length = graph.robot.characteristic_length
    asked = {
        "robot": graph.robot.name,
        "limb": limb,
        "branch": branch,
        "floor": graph.settings.path_floor * length**3,
        "flange": [flange["position"].tolist(), flange["rotation"].tolist()],
        "positions": regrasp.positions.tolist(),
        "rotations": regrasp.rotations.tolist(),
        "kind": regrasp.kind,
        "pivot": regrasp.pivot.tolist(),
    }
    done = subprocess.run(
        [sys.executable, __file__],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        input=json.dumps(asked),
        capture_output=True,
        text=True,
        check=True,
    )
    return [(middle, half, verdict) for middle, half, verdict in json.loads(done.stdout)]


def looked_at(asked: dict[str, Any]) -> list[tuple[float, float, str]]:
    """The same in a process where kernels are plain functions."""
    robot = LimbShapes(robot_spec(asked["robot"])).rows[0]
    ends = [
        pose(np.array(p), np.array(r))
        for p, r in zip(asked["positions"], asked["rotations"], strict=True)
    ]
    path = base_path(*ends, asked["kind"], np.array(asked["pivot"]))
    found: list[tuple[float, float, str]] = []
    place = [0.0, 0.0]
    travel, stays = certificate.travel_seen, certificate._stays

    def travel_seen(path: Any, base: Any, s: float, half: float, point: Any) -> float:
        place[:] = s, half
        return travel(path, base, s, half, point)

    def told(*arguments: Any) -> bool:
        proved = bool(stays(*arguments))
        found.append((place[0], place[1], VERDICTS[0] if proved else VERDICTS[1]))
        return proved

    certificate.travel_seen, certificate._stays = travel_seen, told  # type: ignore[assignment]
    kept = certificate.certify(
        robot.limbs[asked["limb"]],
        pose(*map(np.array, asked["flange"])),
        path,
        asked["floor"],
        1 << asked["branch"],
        certificate.Proof.row(),
    )
    if not kept:
        found.append((place[0], place[1], VERDICTS[2]))
    return found


if __name__ == "__main__":
    print(json.dumps(looked_at(json.load(sys.stdin))))
