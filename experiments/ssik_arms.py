"""Which solutions the library ssik finds of arms as it describes them, against this package.

    python experiments/ssik_arms.py [--out results] [--poses 100] [--workers 2]

ssik ships arms as their makers' URDF files have them, and solves arms of six joints whatever their
axes, so also those that EAIK knows no closed form of: in some files axes that meet in a point by
the maker's table lie a fraction of a millimetre apart. Each arm is written as an MJCF file and read
as a robot's; of an arm of seven joints one is held, and locked in ssik. Compared are all solutions
at poses of drawn joint angles: those of the exact arm beside each branch of the closed form
(`RobotFile.exact_file_angles`), and ssik's. Poses close to singular ones, where a branch has no
such solution, are drawn again. Times are processor time. Writes `ssik_arms.json`, whose table
`readme.py` shows in the docs.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from arm_branches import of_package
from eaik.IK_HP import HPRobot
from reports import CORES, NOTHING, experiment, study_rows, table
from scipy.spatial.transform import Rotation
from ssik import Manipulator
from ssik.solvers.jointlock import seven_r

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.from_file import RobotFile, read_robot
from mlivr_gym.robot.link_frames import link_frames

HELD_ANGLE = 0.8
"""Angle of a joint that is held [rad]."""

LIMIT = 6.2
"""Joint limit of every arm that is written as a file [rad]."""

ARMS: dict[str, tuple[str, str, int | None]] = {
    "UR3e": ("UR", "ur3e", None),
    "UR20": ("UR", "ur20", None),
    "Dobot CR5": ("UR", "cr5", None),
    "KUKA KR 210": ("spherical wrist", "kr210_r2700", None),
    "ABB IRB 120": ("spherical wrist", "irb120", None),
    "Denso VS-060": ("spherical wrist", "vs060", None),
    "Kinova Gen3, joint 1": ("spherical wrist", "gen3", 1),
    "Kinova Gen3, joint 3": ("spherical wrist", "gen3", 3),
    "Kinova Jaco 2 of 7 joints, joint 3": ("spherical wrist", "j2s7s300", 3),
    "KUKA LBR iiwa 7, joint 3": ("spherical wrist", "iiwa7", 3),
    "Realman RM75, joint 6": ("spherical shoulder", "rm75", 6),
    "Franka Research 3, joint 6": ("spherical shoulder", "fr3", 6),
    "UFactory xArm7, joint 6": ("spherical shoulder", "xarm7", 6),
}
"""Family, ssik's name and held joint of each arm."""


def mjcf_of(arm: Manipulator) -> str:
    """Return an arm as an MJCF file, whose joints are named joint1 and so on."""

    def told(vector: Array) -> str:
        return " ".join(repr(float(entry)) for entry in vector)

    joints = arm.kinbody.joints
    end = joints[-1].T_right
    quaternion = Rotation.from_matrix(end[:3, :3]).as_quat(scalar_first=True)
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
    text = f'<site name="tool0" pos="{told(end[:3, 3])}" quat="{told(quaternion)}"/>'
    for k in reversed(range(len(joints))):
        text = (
            f'<body name="link{k + 1}" pos="{told(joints[k].T_left[:3, 3])}">{inertial}'
            f'<joint name="joint{k + 1}" axis="{told(joints[k].axis)}" range="{-LIMIT} {LIMIT}" '
            f'actuatorfrcrange="-100 100"/><geom type="sphere" size="0.01"/>{text}</body>'
        )
    speeds = " ".join(["2"] * len(joints))
    return (
        f'<mujoco model="arm"><compiler angle="radian"/><custom><numeric name="speed_limits" '
        f'data="{speeds}"/></custom><worldbody><body name="base">{inertial}{text}</body>'
        "</worldbody></mujoco>"
    )


def read_arm(arm: Manipulator, held: int | None) -> RobotFile:
    """Return the robot of two arms, of which one joint is held."""
    options: dict[str, Any] = {}
    if held is not None:
        options = {"held_joint": f"joint{held}", "held_angle": HELD_ANGLE}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "arm.xml")
        path.write_text(mjcf_of(arm), encoding="utf-8")
        return read_robot(path, **options)


def solutions_of_ssik(arm: Manipulator, held: int | None, pose: Array) -> Array:
    """Return the angles of all joints that ssik finds at a pose, shape (number, joints) [rad]."""
    if held is None:
        found = arm.solve(pose, respect_limits=False, allow_refinement=True)
    else:
        found, _ = seven_r.solve(
            arm.kinbody, pose, lock_idx=held - 1, lock_samples=[HELD_ANGLE], allow_refinement=True
        )
    return np.array([one.q for one in found]).reshape(-1, arm.dof)


def solutions_of_file(file: RobotFile, held: int | None, pose: Array) -> Array | None:
    """Return those beside the branches at a flange pose of the family, in the limb's base frame.

    None if a branch has none, close to a singular posture.
    """
    try:
        branches = of_package(file.fields["limb"], pose[None])[0][0]
        found = [file.exact_file_angles(np.stack([q, q]))[0] for q in branches]
    except RobotError:
        return None
    return np.array(found if held is None else np.insert(found, held - 1, HELD_ANGLE, axis=1))


def apart(some: Array, others: Array) -> Array:
    """Return how far each solution is from the nearest of others, half turns at most [rad]."""
    turned: Array = np.abs(np.angle(np.exp(1j * (some[:, None] - others[None])))).max(axis=-1)
    least: Array = turned.min(axis=1, initial=np.pi)
    return least


def eaik_family(arm: Manipulator, held: int | None) -> str | None:
    """Return the name that EAIK has for an arm with a held joint, None if it cannot solve it."""
    frame, axes, places = np.eye(4), [], [np.zeros(3)]
    for joint in arm.kinbody.joints:
        frame = frame @ joint.T_left
        axes.append(frame[:3, :3] @ joint.axis)
        places.append(frame[:3, 3])
        frame = frame @ joint.T_right
    steps = np.diff([*places, frame[:3, 3]], axis=0)
    robot = HPRobot(np.array(axes), steps, None if held is None else [(held - 1, HELD_ANGLE)])
    name: str = robot.getKinematicFamily()
    return name if robot.hasKnownDecomposition() else None


def compared(task: int, arm: str, poses: int) -> dict[str, Any]:
    """Return how the solutions of an arm compare."""
    _, name, held = ARMS[arm]
    theirs = Manipulator.from_prebuilt(name)
    file, rng = read_arm(theirs, held), np.random.default_rng(task)
    ours, found, foreign, missed, error, seconds = 0, 0, 0, 0, 0.0, 0.0
    for _ in range(poses):
        mine = None
        while mine is None:
            pose = link_frames(file.fields["limb"], rng.uniform(-np.pi, np.pi, 6))[6]
            mine = solutions_of_file(file, held, pose)
        goal = theirs.fk(mine[0])
        error = max(error, *(float(np.abs(theirs.fk(q) - goal).max()) for q in mine))
        began = time.process_time()
        other = solutions_of_ssik(theirs, held, goal)
        seconds += time.process_time() - began
        ours, found = ours + len(mine), found + len(other)
        foreign += int((apart(other, mine) > 1e-6).sum())
        missed += int((apart(mine, other) > 1e-6).sum())
    return {
        "deviation_m": file.position_error, "eaik": eaik_family(theirs, held), "found": ours,
        "ssik": found, "foreign": foreign, "missed": missed, "largest_error": error,
        "ssik_seconds": seconds / poses,
    }  # fmt: skip


def measured(poses: int, workers: int) -> dict[str, Any]:
    """Return what is measured of all arms."""
    rows = study_rows("ssik_arms:compared", 1, workers, arm=list(ARMS), poses=[poses])
    return {"poses": poses, "arms": {row["arm"]: row for row in rows}}


def markdown(data: dict[str, Any]) -> str:
    """Return the table for the page on robots."""
    head = (
        "arm of ssik 8.2.0, and the joint that it holds | form | flange off the form [mm] | "
        "EAIK solves it | solutions | ssik's that are none of these | these that ssik misses | "
        "ssik: ms a pose"
    )
    return table(head, (
        (name, ARMS[name][0], f"{1e3 * row['deviation_m']:.3f}",
         "yes" if row["eaik"] else NOTHING, row["found"], row["foreign"], row["missed"],
         f"{1e3 * row['ssik_seconds']:.1f}")
        for name, row in data["arms"].items()
    ))  # fmt: skip


if __name__ == "__main__":
    experiment("ssik_arms", __doc__, measured, poses=100, workers=CORES)
