"""Arms without a closed form: which of their solutions are found, how fast, and how they plan.

    python experiments/numeric_solutions.py [--out results] [--poses 100] [--workers 2]

The arms are those of ssik, which solves any six joints; they are written as MJCF files and read as
two limbs of a robot with simple capsules along the links. A solution counts as regular if `w_m` is
at least that of a step's path, 0.03, at the characteristic length of the robot; of the regular
ones that ssik finds, those are counted that a branch here is. Stances and plans are on the JEM with
the default settings: fewest steps between four drawn pairs of stances, the first of them
with everything that the first plan of a process needs but machine code. Times are processor time.
Writes `numeric_solutions.json`, whose table `readme.py` shows in the docs.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from arm_branches import of_package
from reports import CORES, NOTHING, experiment, study_rows, table
from ssik import Manipulator
from ssik_arms import apart, mjcf_of, read_arm, solutions_of_ssik

from mlivr_gym import RobotSpec, stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.robot.link_frames import link_frames
from mlivr_gym.settings import PATH_FLOOR
from mlivr_gym.viewer.curves import limb_manipulabilities

ARMS = {
    "UFactory xArm 6": "xarm6",
    "FANUC CRX-10iA/L": "crx10ial",
    "Kinova Jaco 2, 6 joints": "jaco2",
    "Kinova Gen3 lite": "gen3_lite",
    "Rokae xMate SR3": "xmatesr3",
    "Rokae xMate CR7": "xmatecr7",
    "i2rt Big YAM": "big_yam",
}
"""ssik's name of each arm."""

QUERIES = 4
"""Number of plans."""


def solved(task: int, arm: str, poses: int) -> dict[str, Any]:
    """Return how many of ssik's solutions are found, and the time of one pose [s]."""
    theirs = Manipulator.from_prebuilt(ARMS[arm])
    file, rng = read_arm(theirs, None), np.random.default_rng(task)
    robot = RobotSpec(**file.fields)
    angles = rng.uniform(-np.pi, np.pi, (poses, 6))
    targets = np.array([link_frames(robot.limb, q)[6] for q in angles])
    mine, seconds = of_package(robot.limb, targets)
    out = {"family": robot.limb.family, "ssik": 0, "regular": 0, "found": 0, "foreign": 0}
    for q, rows in zip(angles, mine, strict=True):
        other = solutions_of_ssik(theirs, None, theirs.fk(file.to_file_angles(q[None])[0]))
        known = file.from_file_angles(other[:, None])[:, 0]
        w_m = limb_manipulabilities(robot, np.stack([known, known], axis=1))[:, 0]
        useful = known[w_m >= PATH_FLOOR]
        out["ssik"] += len(known)
        out["regular"] += len(useful)
        out["found"] += int((apart(useful, rows) < 1e-6).sum())
        out["foreign"] += int((apart(rows, known) > 1e-6).sum())
    return {**out, "seconds": seconds}


def planned(task: int, arm: str) -> dict[str, Any]:
    """Return the stances of two such arms and the times of plans [s]."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "arm.xml")
        path.write_text(mjcf_of(Manipulator.from_prebuilt(ARMS[arm])), encoding="utf-8")
        robot = RobotSpec.from_mjcf(path, capsules="ur5e")
    began = time.process_time()
    graph = stance_graph(robot=robot)
    planner, rng = Planner(graph), np.random.default_rng(task)
    times, steps = [], []
    for _ in range(QUERIES):
        start, goal = rng.integers(len(graph), size=2)
        position = graph.node_postures(np.array([goal])).base_position[0]
        result = planner.plan(graph.points[start].tolist(), position, "steps")
        times.append(time.process_time() - began)
        steps.append(len(result.plan.steps) if result.plan is not None else None)
        began = time.process_time()
    return {"stances": len(graph), "first": times[0], "later": max(times[1:]), "steps": steps}


def measured(poses: int, workers: int) -> dict[str, Any]:
    """Return what is measured of all arms."""
    rows = study_rows("numeric_solutions:solved", 1, workers, arm=list(ARMS), poses=[poses])
    plans = study_rows("numeric_solutions:planned", 1, workers, arm=list(ARMS))
    both = zip(rows, plans, strict=True)
    return {"poses": poses, "arms": {row["arm"]: row | plan for row, plan in both}}


def markdown(data: dict[str, Any]) -> str:
    """Return the table for the page on robots."""
    head = (
        "arm of ssik 8.2.0 | solutions | regular ones | of these found | found that are none | "
        "us a pose | stances on the JEM | first plan [s] | slowest of 3 later [s] | steps"
    )
    return table(head, (
        (name, row["ssik"], row["regular"], f"{100.0 * row['found'] / row['regular']:.1f} %",
         row["foreign"], f"{1e6 * row['seconds']:.0f}", f"{row['stances']:,}",
         f"{row['first']:.1f}", f"{row['later']:.1f}",
         ", ".join(NOTHING if count is None else str(count) for count in row["steps"]))
        for name, row in data["arms"].items()
    ))  # fmt: skip


if __name__ == "__main__":
    experiment("numeric_solutions", __doc__, measured, poses=100, workers=CORES)
