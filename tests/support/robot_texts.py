"""URDF texts of arms, from published lengths, in poses and conventions of other authors."""

import re
import warnings

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.simulation.scene import robot_alone

UR10E = (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655)
"""Lengths of the UR10e [m]: Universal_Robots_ROS2_Description, config/ur10e (BSD-3-Clause)."""

JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{xyz}" rpy="{rpy}"/>{more}</joint>"""
LIMITS = '<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="{torque}" velocity="2"/>'
INERTIAL = """<inertial><origin xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0.002" iyz="0.003"/></inertial>"""
SHAPE = (
    """<collision><origin xyz="0 0 0"/><geometry><sphere radius="0.03"/></geometry></collision>"""
)


def told(values):
    return " ".join(repr(float(value)) for value in np.ravel(values))


def frames_along(steps):
    """Frames of the joints and the flange of an arm at angles 0, joints turning about z.

    A step is where a frame lies in the one before, and about which axis it is turned by how much.
    """
    frame, out = np.eye(4), []
    for place, axis, degrees in steps:
        step = np.eye(4)
        step[:3, :3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
        step[:3, 3] = place
        frame = frame @ step
        out.append(frame)
    return out


def frames_of(lengths):
    """Frames of the joints and the flange of a UR arm at angles 0, standard DH convention."""
    d1, a2, a3, d4, d5, d6 = lengths
    return frames_along((
        ((0.0, 0.0, 0.0), "x", 0.0), ((0.0, 0.0, d1), "x", 90.0), ((a2, 0.0, 0.0), "x", 0.0),
        ((a3, 0.0, 0.0), "x", 0.0), ((0.0, 0.0, d4), "x", 90.0), ((0.0, 0.0, d5), "x", -90.0),
        ((0.0, 0.0, d6), "x", 0.0),
    ))  # fmt: skip


IIWA14 = frames_along((
    ((0.0, 0.0, 0.1575), "x", 0.0), ((0.0, 0.0, 0.2025), "x", -90.0), ((0.0, 0.0, 0.0), "x", 90.0),
    ((0.0, 0.0, 0.42), "x", 90.0), ((0.0, 0.0, 0.0), "x", -90.0), ((0.0, 0.0, 0.4), "x", -90.0),
    ((0.0, 0.0, 0.0), "x", 90.0), ((0.0, 0.0, 0.126), "x", 0.0),
))  # fmt: skip
"""Joints and flange of a KUKA LBR iiwa 14 R820, whose axes are z, y, z, -y, z, y, z.

By the maker's data sheet (0.36 m, 0.42 m, 0.4 m, 0.126 m), and by `lbr_iiwa_14_r820.urdf` of the
package kuka_lbr_iiwa_support of ROS-Industrial (Apache-2.0) but for 0.44 mm.
"""

IIWA14_FIGURES = tuple(
    (float(np.deg2rad(limit)), torque, mass)
    for limit, torque, mass in zip(
        (170, 120, 170, 120, 170, 120, 175), (320, 320, 176, 176, 110, 40, 40),
        (5.76, 6.35, 3.5, 3.5, 3.5, 1.8, 1.2), strict=True,
    )
)  # fmt: skip
"""Limit [rad], largest torque [N m] and mass of the link [kg] of each joint: limits and torques by
the data sheet, masses by `kuka_iiwa_14/iiwa14.xml` of MuJoCo Menagerie (BSD-3-Clause)."""

FRANKA = frames_along((
    ((0.0, 0.0, 0.333), "x", 0.0), ((0.0, 0.0, 0.0), "x", -90.0), ((0.0, -0.316, 0.0), "x", 90.0),
    ((0.0825, 0.0, 0.0), "x", 90.0), ((-0.0825, 0.384, 0.0), "x", -90.0),
    ((0.0, 0.0, 0.0), "x", 90.0), ((0.088, 0.0, 0.0), "x", 90.0), ((0.0, 0.0, 0.107), "x", 0.0),
))  # fmt: skip
"""Joints and flange of a Franka Research 3 by the maker's table of modified DH parameters, and by
`robots/fr3/kinematics.yaml` of franka_description (Apache-2.0)."""

GEN3 = frames_along((
    ((0.0, 0.0, 0.15643), "x", 180.0), ((0.0, 0.005375, -0.12838), "x", 90.0),
    ((0.0, -0.21038, -0.006375), "x", -90.0), ((0.0, 0.006375, -0.21038), "x", 90.0),
    ((0.0, -0.20843, -0.006375), "x", -90.0), ((0.0, 0.0, -0.10593), "x", 90.0),
    ((0.0, -0.10593, 0.0), "x", -90.0), ((0.0, 0.0, -0.061525), "x", 180.0),
))  # fmt: skip
"""Joints and flange of a Kinova Gen3 of seven joints by `kortex_description` of ros2_kortex
(BSD-3-Clause), but for 0.18 mm by which axis 5 lies beside axes 6 and 7."""

KR16 = frames_along((
    ((0.0, 0.0, 0.0), "x", 180.0), ((0.26, 0.0, -0.675), "x", -90.0), ((0.68, 0.0, 0.0), "x", 0.0),
    ((0.0, -0.035, 0.0), "y", -90.0), ((0.0, 0.0, -0.67), "y", 90.0), ((0.0, 0.0, 0.0), "y", -90.0),
    ((0.0, 0.0, -0.158), "y", 180.0),
))  # fmt: skip
"""Joints and flange of a KUKA KR 16-2 with the arm straight ahead, by `kr16_2.urdf` of the package
kuka_kr16_support of ROS-Industrial (Apache-2.0)."""

PUMA560 = frames_along((
    ((0.0, 0.0, 0.0), "x", 0.0), ((0.0, 0.0, 0.6604), "x", -90.0),
    ((0.4318, 0.0, 0.14909), "x", 0.0), ((0.0203, -0.43307, 0.0), "x", 90.0),
    ((0.0, 0.0, 0.0), "x", -90.0), ((0.0, 0.0, 0.0), "x", 90.0), ((0.0, 0.0, 0.05625), "x", 0.0),
))  # fmt: skip
"""Joints and flange of a PUMA 560: Corke and Armstrong-Helouvry, "A search for consensus among
model parameters reported for the PUMA 560 robot", ICRA 1994; the base height is Unimation's."""


def arm_urdf(frames, seed=None, prefix="", root="base_link", links=True, figures=None):
    """An arm as URDF text; with a seed the frames, signs and zero angles are drawn at random.

    `frames` are those of the joints, about whose z axes they turn, and the flange's; `figures` are
    limit, torque and mass of each joint.
    Drawn ones have joint axes along any unit vector, turned either way.
    """
    rng = None if seed is None else np.random.default_rng(seed)
    parts, count = [], len(frames) - 1
    mine = [np.eye(4)] + [frame.copy() for frame in frames[:count]]
    axes = [np.array([0.0, 0.0, 1.0])] * count
    if rng is not None:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(None, rng).as_matrix()
        angles = rng.uniform(-1.5, 1.5, count)
        moved = np.eye(4)
        out = []
        for k in range(count):
            step = frames[k] if k == 0 else np.linalg.inv(frames[k - 1]) @ frames[k]
            moved = moved @ step
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec([0, 0, angles[k]]).as_matrix()
            moved = moved @ turn
            out.append(moved.copy())
        tip = moved @ np.linalg.inv(frames[-2]) @ frames[-1]
        mine, axes = [np.eye(4)], []
        for k in range(count):
            loose = np.eye(4)
            loose[:3, :3] = Rotation.random(None, rng).as_matrix()
            sign = rng.choice([-1.0, 1.0])
            place = out[k].copy()
            place[:3, 3] += rng.uniform(-0.1, 0.1) * place[:3, 2]
            mine.append(place @ loose)
            axes.append(sign * loose[:3, :3].T[:, 2])
        frames = [*frames[:count], tip]
    for k in range(count):
        step = np.linalg.inv(mine[k]) @ mine[k + 1]
        low, high = (-3.1, 3.0) if k == 2 else (-6.0, 6.1)
        torque, mass = 100 + k, 1.0 + k
        if figures is not None:
            high, torque, mass = figures[k]
            low = -high
        more = LIMITS.format(axis=told(axes[k]), low=low, high=high, torque=torque)
        parent = root if k == 0 else f"{prefix}link{k}"
        parts.append(joint_of(f"{prefix}joint{k + 1}", "revolute", parent, f"{prefix}link{k + 1}",
                              step, more))  # fmt: skip
        inertial = INERTIAL.format(mass=mass)
        parts.append(f'<link name="{prefix}link{k + 1}">{inertial}{SHAPE if links else ""}</link>')
    step, last = np.linalg.inv(mine[-1]) @ frames[-1], f"{prefix}link{count}"
    parts.append(joint_of(f"{prefix}fixed", "fixed", last, f"{prefix}tool0", step, ""))
    parts.append(f'<link name="{prefix}tool0"/>')
    return "\n".join(parts)


def joint_of(name, kind, parent, child, step, more):
    """A joint between two links, which lie to each other as a homogeneous transform says."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where the pitch is a quarter turn, one of many is taken
        rpy = Rotation.from_matrix(step[:3, :3]).as_euler("xyz")
    return JOINT.format(name=name, kind=kind, parent=parent, child=child, xyz=told(step[:3, 3]),
                        rpy=told(rpy), more=more)  # fmt: skip


def one_arm(lengths=UR10E, frames=None, **options):
    """A URDF of one arm, of the UR form or with the frames of its joints and its flange."""
    base = f'<link name="base_link">{INERTIAL.format(mass=4.0)}</link>'
    return f'<robot name="arm">{base}{arm_urdf(frames or frames_of(lengths), **options)}</robot>'


def whole_robot(places, lengths=UR10E):
    """A URDF of a body with an arm at each of some frames, (4, 4), of one or of several kinds.

    An arm is of the UR form with its lengths, or has the frames of its joints and its flange. The
    body is a box of 0.3 m, 0.2 m and 0.1 m.
    """
    box = '<collision><geometry><box size="0.3 0.2 0.1"/></geometry></collision>'
    parts = [f'<link name="body">{INERTIAL.format(mass=20.0)}{box}</link>']
    each = [lengths] * len(places) if np.isscalar(lengths[0]) else lengths
    for k, (place, mine) in enumerate(zip(places, each, strict=True)):
        parts.append(joint_of(f"mount{k}", "fixed", "body", f"foot{k}", place, ""))
        parts.append(f'<link name="foot{k}"/>')
        frames = frames_of(mine) if np.isscalar(mine[0]) else mine
        parts.append(arm_urdf(frames, prefix=f"arm{k}_", root=f"foot{k}"))
    return f'<robot name="whole">{"".join(parts)}</robot>'


def written(folder, text, name="arm.urdf"):
    """Write a file of a robot; return its path."""
    path = folder / name
    path.write_text(text)
    return str(path)


def more(text, *parts):
    """A file with further elements."""
    return text.replace("</robot>", "".join(parts) + "</robot>")


def hinge(name, parent, child, place=(0.02, 0.0, 0.05)):
    """A revolute joint and the link that it moves, which has a shape."""
    step = np.eye(4)
    step[:3, 3] = place
    limits = '<axis xyz="0 1 0"/><limit lower="0" upper="0.8" effort="5" velocity="2"/>'
    return joint_of(name, "revolute", parent, child, step, limits) + (
        f'<link name="{child}">{SHAPE}</link>'
    )


def tool_of(text, rpy=(0.0, 0.0, 0.0), length=0.05):
    """A file whose tool frame is turned, and beyond the last link."""
    frame = f'xyz="0 0 {length}" rpy="{told(rpy)}"'
    return re.sub(r'(name="fixed".*?<origin )xyz="[^"]*" rpy="[^"]*"', rf"\1{frame}", text,
                  flags=re.DOTALL)  # fmt: skip


def straight_arm():
    """An arm whose last link is the flange, so that a tool frame is given in its axes."""
    return one_arm(frames=frames_of((0.18, -0.6, -0.57, 0.17, 0.12, 0.0)))


def with_mesh(text, name):
    """A file in which a mesh is the first shape of a link that moves."""
    return text.replace('<sphere radius="0.03"/>', f'<mesh filename="{name}"/>', 1)


def mjcf_by_mujoco(robot):
    """A robot as MuJoCo writes its model, to six digits, with its limits of torque and speed."""
    spec = robot_alone(robot)
    names, torques = np.ravel(robot.named_joints).tolist(), robot.torque_limits.ravel()
    for name, torque in zip(names, torques, strict=True):
        spec.joint(name).actfrcrange = [-torque, torque]
    spec.add_numeric(name="speed_limits", data=robot.speed_limits.ravel(), size=len(names))
    spec.compile()
    return spec.to_xml()
