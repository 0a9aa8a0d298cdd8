"""Which branches of inverse kinematics are found of arms of each family, and how fast.

    python experiments/arm_branches.py [--out results] [--poses 500] [--workers 2]

Flange poses at drawn joint angles, in the limb base frame. The closed form of each arm is compared
with EAIK, which knows the arm by the axes of the joints that move; every solution is brought back
to its pose by Pinocchio. A solution of EAIK counts if it is exact (`is_LS` marks the others). Of
three arms of seven joints the largest `w_m` at drawn joint angles is sought, with each joint held.
Times are processor time for all branches of one pose. Writes `arm_branches.json` and `.md`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import eaik.IK_HP as hp
import numpy as np
import pinocchio as pin
from reports import CORES, experiment, study_rows, table

from mlivr_gym import SphericalWristLimb, robot_spec
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.manipulability import limb_manipulability
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.robot.any_limb import AnyLimb
from mlivr_gym.robot.link_frames import link_frames
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.robot.ssrms_limb import SsrmsLimb

FREE = ((-2.0 * np.pi, 2.0 * np.pi),) * 7
IIWA = SphericalWristLimb(joint_limits=FREE)
FRANKA = SphericalWristLimb(
    d1=0.333, a2=0.316, b2=0.0825, a3=-0.0825, d4=0.384, a6=0.088, d6=0.107, held_joint=6,
    held_angle=-1.3, joint_limits=FREE,
)  # fmt: skip
"""Franka Research 3 by the maker's DH parameters, and by franka_description (Apache-2.0)."""
GEN3 = SphericalWristLimb(
    d1=0.28481, d2=-0.01175, a2=0.42076, d3=-0.01275, d4=0.31436, d6=0.167455, held_angle=0.6,
    joint_limits=FREE,
)  # fmt: skip
"""Kinova Gen3 by kortex_description of ros2_kortex (BSD-3-Clause), but for 0.18 mm at the wrist."""
PUMA = SphericalWristLimb(
    d1=0.6604, d2=0.14909, a2=0.4318, a3=0.0203, d4=0.43307, d6=0.05625, held_joint=None,
    joint_limits=FREE[:6],
)  # fmt: skip
"""PUMA 560: Corke and Armstrong-Helouvry, ICRA 1994."""

ARMS: dict[str, tuple[str, AnyLimb]] = {
    "UR5e": ("ur", robot_spec("mlivr2").limb),
    "UR10e": ("ur", robot_spec("mlivr2-ur10e").limb),
    "SSRMS, joint 1": ("ssrms", SsrmsLimb(held_angle=0.4)),
    "PUMA 560": ("spherical wrist", PUMA),
    **{
        f"iiwa 14, joint {joint}": (
            "spherical wrist" if joint < 4 else "spherical shoulder",
            replace(IIWA, held_joint=joint, held_angle=0.8),
        )
        for joint in (1, 2, 3, 5, 6)
    },
    "Gen3, joint 1": ("spherical wrist", replace(GEN3, held_joint=1)),
    "Gen3, joint 3": ("spherical wrist", GEN3),
    "Franka, joint 6": ("spherical shoulder", FRANKA),
}
"""Family and limb by name; the joint is the one that is held."""

HELD = {"iiwa 14": IIWA, "Gen3": GEN3, "Franka": FRANKA}
"""Arms of which each joint is held in turn."""


def poses_of(limb: AnyLimb, count: int) -> Array:
    """Return flange poses at drawn joint angles, shape (count, 4, 4)."""
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (count, 6))
    return np.array([link_frames(limb, q)[6] for q in angles])


def pinocchio_arm(limb: AnyLimb) -> pin.Model:
    """Return a model of the joints that move, by their axes at angles 0."""
    model, parent = pin.Model(), 0
    for k, (place, (w, x, y, z)) in enumerate(limb.link_offsets):
        step = pin.SE3(pin.Quaternion(w, x, y, z), np.array(place))
        parent = model.addJoint(parent, pin.JointModelRZ(), step, f"joint{k + 1}")
    return model


def largest_error(model: pin.Model, pose: Array, solutions: Array) -> float:
    """Return how far Pinocchio brings the flange from its pose at most [m, rad]."""
    data, worst = model.createData(), 0.0
    for q in solutions:
        pin.forwardKinematics(model, data, q)
        worst = max(worst, float(np.abs(pin.log6(data.oMi[6].actInv(pin.SE3(pose))).vector).max()))
    return worst


def of_package(limb: AnyLimb, poses: Array) -> tuple[list[Array], float]:
    """Return the solutions of each pose, and the time of one pose [s]."""
    spec = RobotSpec(limb=limb)
    robots = LimbShapes(spec).rows
    count = 8 * len(poses)
    bases, grasps, out = Pose.rows(count), Grasp.rows(count)[:, None], Angles.rows(count)[:, None]
    bases["rotation"][:] = np.eye(3)
    mount = spec.mounted[0]
    turn, place = np.array(mount.rotation), np.array(mount.position)
    grasps["flange"]["position"][:, 0] = np.repeat(place + poses[:, :3, 3] @ turn.T, 8, axis=0)
    grasps["flange"]["rotation"][:, 0] = np.repeat(turn @ poses[:, :3, :3], 8, axis=0)
    bits = np.tile(np.arange(8), len(poses))[:, None]
    held_angles(robots, bases, grasps, bits, out)
    began = time.process_time()
    held_angles(robots, bases, grasps, bits, out)
    took = (time.process_time() - began) / len(poses)
    angles = out["q"].reshape(len(poses), 8, 6)
    return [rows[np.isfinite(rows[:, 0])] for rows in angles], took


def axes_of(limb: AnyLimb) -> tuple[Array, Array, Array]:
    """Return axes (6, 3) and steps between them (7, 3) at angles 0, and the flange's axes there."""
    frames = link_frames(limb, np.zeros(6))
    places = np.vstack([np.zeros(3), frames[1:, :3, 3], frames[6, :3, 3]])
    return frames[1:, :3, 2], np.diff(places, axis=0), frames[6, :3, :3]


def eaik_solver(limb: AnyLimb) -> Callable[[Array], int]:
    """Return a function that counts the exact solutions that EAIK finds."""
    axes, steps, turn = axes_of(limb)
    arm = hp.HPRobot(axes, steps)
    to_zero = np.eye(4)
    to_zero[:3, :3] = turn.T

    def count(pose: Array) -> int:
        return sum(not fit for fit in arm.IK(pose @ to_zero).is_LS)

    return count


def counted(solver: Callable[[Array], int], poses: Array) -> dict[str, Any]:
    """Return the number of solutions of a library, and the time of one pose [s]."""
    solver(poses[0])
    began = time.process_time()
    found = [solver(pose) for pose in poses]
    took = (time.process_time() - began) / len(poses)
    return {"found": found, "seconds": took}


def branches(task: int, arm: str, poses: int) -> dict[str, Any]:
    """Return what the package and EAIK find of an arm."""
    limb = ARMS[arm][1]
    targets = poses_of(limb, poses)
    solutions, took = of_package(limb, targets)
    model = pinocchio_arm(limb)
    errors = [largest_error(model, *both) for both in zip(targets, solutions, strict=True)]
    ours = [len(rows) for rows in solutions]
    other = counted(eaik_solver(limb), targets)
    pairs = list(zip(ours, other["found"], strict=True))
    return {
        "found": sum(ours),
        "seconds": took,
        "largest_error": max(errors),
        "eaik": {
            "found": sum(other["found"]),
            "fewer": sum(a < b for a, b in pairs),
            "more": sum(a > b for a, b in pairs),
            "seconds": other["seconds"],
        },
    }


def largest_w_m(task: int, arm: str, draws: int) -> dict[str, float]:
    """Return the largest `w_m` at drawn angles of an arm that holds the joint of index `task`."""
    limb = HELD[arm]
    places = [(0.0, 0.0, limb.d1), (0.0, -limb.d2, limb.d1)]
    places += [(limb.b2, -limb.d2, limb.d1 + limb.a2)]
    x, y, z = limb.b2 + limb.a3, -limb.d2 - limb.d3, limb.d1 + limb.a2 + limb.d4
    places = [(0.0, 0.0, 0.0), places[0], places[1], places[2], (x, y, z), (x, y, z)]
    places += [(x + limb.a6, y, z)]
    model, parent, last = pin.Model(), 0, np.zeros(3)
    for k, place in enumerate(places):
        joint = pin.JointModelRZ() if k % 2 == 0 else pin.JointModelRevoluteUnaligned(
            np.array([0.0, -1.0, 0.0])
        )  # fmt: skip
        step = pin.SE3(np.eye(3), np.array(place) - last)
        parent, last = model.addJoint(parent, joint, step, f"joint{k}"), np.array(place)
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, limb.d6]))
    frame = model.addFrame(pin.Frame("flange", parent, tip, pin.FrameType.OP_FRAME))
    data, rng, best = model.createData(), np.random.default_rng(0), 0.0
    scale = robot_spec("mlivr2").characteristic_length * limb.arm_length / (0.425 + 0.3922)
    for q in rng.uniform(-np.pi, np.pi, (draws, 7)):
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        columns = pin.computeFrameJacobian(model, data, q, frame, world)
        six = np.delete(columns, task, axis=1)
        best = max(best, float(limb_manipulability(six, scale)))
    return {"w_m": best}


def measured(poses: int, draws: int, workers: int) -> dict[str, Any]:
    """Return what is measured of all arms."""
    arms = study_rows("arm_branches:branches", 1, workers, arm=list(ARMS), poses=[poses])
    held = study_rows("arm_branches:largest_w_m", 7, workers, arm=list(HELD), draws=[draws])
    w_m: dict[str, dict[str, float]] = {name: {} for name in HELD}
    for row in held:
        w_m[row["arm"]][str(row["task"] + 1)] = row["w_m"]
    return {"poses": poses, "draws": draws, "w_m": w_m, "arms": {row["arm"]: row for row in arms}}


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    rows = [
        (
            name, ARMS[name][0], f"{row['found']:,}", f"{row['largest_error']:.1e}",
            f"{1e6 * row['seconds']:.2g}", f"{row['eaik']['found']:,}",
            f"{row['eaik']['fewer']} / {row['eaik']['more']}",
            f"{1e6 * row['eaik']['seconds']:.3g}",
        )
        for name, row in data["arms"].items()
    ]  # fmt: skip
    head = (
        "arm, and the joint that it holds | family | branches | largest error | us a pose | "
        "EAIK: branches | poses with more / fewer | us a pose"
    )
    held = [
        (name, *(f"{data['w_m'][name][str(joint)]:.3f}" for joint in range(1, 8)))
        for name in data["w_m"]
    ]
    return (
        "# Branches of inverse kinematics\n\n"
        f"All branches of {data['poses']:,} flange poses at drawn joint angles, made by "
        "`experiments/arm_branches.py`. *Largest error*: how far Pinocchio brings the flange from "
        "its pose with any of the solutions [m, rad]. *Poses with more / fewer*: at how many poses "
        "EAIK finds more, or fewer, solutions than the closed form of this package. Times "
        "are processor time; those of EAIK contain the call from Python, while this package "
        "computes all poses in one call. The machine was busy.\n\n"
        + table(head, rows)
        + "\n## Which joint to hold\n\n"
        f"The largest `w_m` of the other six joints at {data['draws']:,} drawn angles of all "
        "seven, without joint limits, by Pinocchio; characteristic lengths grow with the arm as in "
        "[your own robot](../docs/how-to/own-robot.md). With joint 4 held, the elbow, no posture "
        "comes near the default threshold of 0.1: another reason why it is refused.\n\n"
        + table("arm | " + " | ".join(f"joint {k}" for k in range(1, 8)), held)
    )


if __name__ == "__main__":
    experiment("arm_branches", __doc__, measured, markdown, poses=500, draws=20000, workers=CORES)
