"""Arms of a URDF or MJCF file: which joints form one, and which bodies belong to each link."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError, shortened
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.limb import FARTHEST_TURN
from mlivr_gym.robot.link_frames import rigid

JOINTS = 6
"""Number of joints of an arm that move; of an arm with one joint more, that one is held."""

HELD_JOINT = 3
"""The joint of an arm of seven that is held by default: the roll of the upper arm."""

ENDLESS = 1000.0
"""Limit from which on a joint turns without end [rad]."""

TOOL_NAMES = ("grasp", "tcp", "tool0", "tool", "ee_link", "attachment_site", "flange")
"""Endings of the names of tool frames, the preferred first."""


class HeldJoint(NamedTuple):
    """A joint of a seven-joint arm that is held."""

    joint: int
    """Its index among the joints of the arm."""
    angle: float
    """The angle at which it is held [rad]."""
    limits: tuple[float, float]
    """Its lower and upper limit [rad]."""


class FileArm(NamedTuple):
    """An arm of a file, by numbers of bodies and joints in the model."""

    joints: tuple[int, ...]
    """Joints that move, in order from the body."""
    links: tuple[int, ...]
    """Body that each of them moves."""
    tool: tuple[int, Array, Array]
    """Body that carries the tool frame, and the frame's position [m] and rotation in it."""
    held: tuple[int, HeldJoint] | None = None
    """Joint that is held, which is none of the others, by its number in the model."""

    @property
    def first(self) -> int:
        """Body that the first joint moves."""
        return self.links[0]


def arms_of(
    file: Description, tips: Sequence[str] | None, tool_frames: Sequence[str] | None
) -> tuple[FileArm, ...]:
    """Return the arms of a file.

    `tips` are the links or sites in which they end, None for every chain of hinges that begins at
    the body; `tool_frames` are those of each arm, None for a customary name, or the last link.
    Raises a `RobotError` if there is none, a name is unknown, or a joint of an arm is no hinge.
    """
    model = file.model
    if tips is not None:
        chains = [_path(file, _frame_named(file, tip)[0]) for tip in tips]
        for tip, chain in zip(tips, chains, strict=True):
            if not chain:
                raise RobotError(f"no joint lies before {tip!r}; name the last link of a limb")
        tool_frames = tips if tool_frames is None else tool_frames
    else:
        first = [b for b in _moving(model) if not _path(file, int(model.body_parentid[b]))]
        if tool_frames is not None and len(tool_frames) == len(first):
            chains = [_path(file, _frame_named(file, name)[0]) for name in tool_frames]
        else:
            chains = [_longest(file, b) for b in first]
    if not chains:
        raise RobotError("the file has no limb: none of its joints is revolute")
    if tool_frames is not None and len(tool_frames) != len(chains):
        raise RobotError(
            f"tool_frame has {len(tool_frames)} names; the file has {len(chains)} limbs"
        )
    out = []
    for k, chain in enumerate(chains):
        joints = tuple(_hinge(file, body) for body in chain)
        if tool_frames is not None:
            tool = _frame_named(file, tool_frames[k])
            if _path(file, tool[0]) != chain:
                raise RobotError(
                    f"tool_frame {tool_frames[k]!r} is not fixed to the last link of the limb, "
                    f"{body_name(model, chain[-1])!r}"
                )
        else:
            tool = _usual_tool(file, chain[-1])
        out.append(FileArm(joints, tuple(chain), tool))
    return tuple(out)


def with_held_joints(
    file: Description,
    arms: tuple[FileArm, ...],
    names: Sequence[str | None] | None,
    angles: Sequence[float | None] | None,
) -> tuple[FileArm, ...]:
    """Return arms with the joints that are held set apart, and bring these to their angles [rad].

    Each arm of seven joints holds the one that is named, for all or each, by default the third, at
    the angle [rad] for all or each, by default 0. Joint angles of the file's data are changed.
    Raises a `RobotError` if a name is none of an arm's seven joints, an angle lies outside the
    joint's limits, or a joint or an angle is given for an arm that holds none.
    """
    each: list[list[Any]] = []
    for field, given in (("held_joint", names or (None,)), ("held_angle", angles or (None,))):
        if len(given) not in (1, len(arms)):
            raise RobotError(f"{field} has {len(given)} entries; the file has {len(arms)} limbs")
        each.append([given[k % len(given)] for k in range(len(arms))])
    out = tuple(_with_held_joint(file, *one) for one in zip(arms, *each, strict=True))
    mujoco.mj_kinematics(file.model, file.data)
    return out


def _with_held_joint(
    file: Description, arm: FileArm, name: str | None, angle: float | None
) -> FileArm:
    """Return an arm with the joint that it holds set apart, and set the joint's angle."""
    joints = [file.joints[joint].name for joint in arm.joints]
    if name is not None and name not in joints:
        raise RobotError(f"held_joint is {name!r}; the limb's joints are {', '.join(joints)}")
    if len(joints) != JOINTS + 1:
        for field, given in (("held_joint", name), ("held_angle", angle)):
            if given is not None:
                raise RobotError(
                    f"{field} is {given!r}; the limb of joints {', '.join(joints)} holds none of "
                    "them, as only an arm of seven joints does: give None for this limb"
                )
        return arm
    index = HELD_JOINT - 1 if name is None else joints.index(name)
    figures = file.joints[arm.joints[index]]
    low, high = figures.limits or (-np.pi, np.pi)
    if angle is None and not low <= 0.0 <= high:
        raise RobotError(
            f"held_angle is missing; joint {figures.name!r}, which is held, turns from {low:g} to "
            f"{high:g} rad and cannot be at 0"
        )
    angle = 0.0 if angle is None else angle
    if not low <= angle <= high:
        raise RobotError(
            f"held_angle is {angle:g} rad; joint {figures.name!r} turns from {low:g} to "
            f"{high:g} rad"
        )
    file.data.qpos[file.model.jnt_qposadr[arm.joints[index]]] = angle
    return arm._replace(
        joints=(*arm.joints[:index], *arm.joints[index + 1 :]),
        links=(*arm.links[:index], *arm.links[index + 1 :]),
        held=(arm.joints[index], HeldJoint(index, angle, (low, high))),
    )


def limits_of(file: Description, arm: FileArm) -> list[tuple[float, float]]:
    """Return the limits of the limb's joint angles [rad]."""
    out = []
    for joint in arm.joints:
        figures = file.joints[joint]
        if figures.limits is None:
            raise RobotError(
                f"joint {figures.name!r} has no limits; give it a lower and an upper angle [rad], "
                "the lower one first"
            )
        if FARTHEST_TURN < max(np.abs(figures.limits)) < ENDLESS:
            low, high = figures.limits
            raise RobotError(
                f"joint {figures.name!r} has limits from {low:g} to {high:g} rad; angles are in "
                f"radians, at most {FARTHEST_TURN:g}: are these degrees?"
            )
        low, high = figures.limits
        out.append((max(low, -FARTHEST_TURN), min(high, FARTHEST_TURN)))
    return out


def body_frame(data: Any, body: int) -> Array:
    """Return the frame of a body in the world, shape (4, 4)."""
    return rigid(data.xmat[body].reshape(3, 3), data.xpos[body])


def tool_frame_of(data: Any, arm: FileArm) -> Array:
    """Return the tool frame of an arm in the world, shape (4, 4)."""
    body, position, rotation = arm.tool
    frame: Array = body_frame(data, body) @ rigid(rotation, position)
    return frame


def body_name(model: Any, body: int) -> str:
    """Return the name of a body."""
    return str(model.body(body).name) or f"body {body}"


def with_carriers(model: Any, body: int) -> list[int]:
    """Return a body, the one that carries it, and so on up to the root, without the world."""
    out = []
    while body:
        out.append(body)
        body = int(model.body_parentid[body])
    return out


def _moving(model: Any) -> list[int]:
    """Return the bodies that joints other than a free one move."""
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    return [
        body
        for body in range(1, model.nbody)
        if model.body_jntnum[body] and model.jnt_type[model.body_jntadr[body]] != free
    ]


def _path(file: Description, body: int) -> list[int]:
    """Return the moving bodies from the robot's body to a body, this one included."""
    moving = set(_moving(file.model))
    return [b for b in reversed(with_carriers(file.model, body)) if b in moving]


def _longest(file: Description, body: int) -> list[int]:
    """Return the chain of joints from a body on; the fingers of a gripper do not belong to it."""
    chain = [body]
    while True:
        here = chain[-1]
        after = [b for b in _moving(file.model) if _path(file, b)[:-1][-1:] == [here]]
        if not after or (
            len(chain) >= JOINTS and (len(after) > 1 or not _is_hinge(file, after[0]))
        ):
            return chain
        if len(after) > 1:
            names = ", ".join(repr(body_name(file.model, b)) for b in after)
            raise RobotError(
                f"the chain of joints branches after link {body_name(file.model, here)!r} into "
                f"{names}; name the last link of each limb with tips"
            )
        chain += after


def _is_hinge(file: Description, body: int) -> bool:
    return file.model.body_jntnum[body] == 1 and int(file.model.body_jntadr[body]) in file.joints


def _hinge(file: Description, body: int) -> int:
    """Return the joint that moves a body."""
    model = file.model
    if model.body_jntnum[body] > 1:
        raise RobotError(
            f"link {body_name(model, body)!r} has {model.body_jntnum[body]} joints; a link of a "
            "limb must have one, revolute"
        )
    joint = int(model.body_jntadr[body])
    if joint not in file.joints:
        kind = {
            int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic",
            int(mujoco.mjtJoint.mjJNT_BALL): "a ball joint",
        }[int(model.jnt_type[joint])]
        raise RobotError(
            f"joint {model.joint(joint).name!r} is {kind}; the joints of a limb must be revolute"
        )
    for k in range(model.neq):
        if model.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj1id[k] == joint:
            other = int(model.eq_obj2id[k])
            leader = f" joint {model.joint(other).name!r}" if other >= 0 else " a constant"
            raise RobotError(
                f"joint {model.joint(joint).name!r} mimics{leader}; every joint of a limb must "
                "move by itself"
            )
    return joint


def _frame_named(file: Description, name: str) -> tuple[int, Array, Array]:
    """Return the link or site of a name: body, position [m] and rotation."""
    model = file.model
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, str(name))
    if site >= 0:
        return _site(model, site)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, str(name))
    if body < 1:
        links = ", ".join(body_name(model, b) for b in range(1, model.nbody))
        sites = ", ".join(str(model.site(k).name) for k in range(model.nsite))
        known = links + (f"; sites {sites}" if sites else "")
        raise RobotError(f"the file has no link or site {shortened(name)}; it has links {known}")
    return body, np.zeros(3), np.eye(3)


def _site(model: Any, site: int) -> tuple[int, Array, Array]:
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.site_quat[site])
    return int(model.site_bodyid[site]), model.site_pos[site].copy(), rotation.reshape(3, 3)


def _usual_tool(file: Description, last: int) -> tuple[int, Array, Array]:
    """Return the tool frame behind the last joint: by a customary name, or the last link."""
    model = file.model
    fixed = [b for b in range(1, model.nbody) if _path(file, b)[-1:] == [last]]
    frames = {str(model.site(k).name): k for k in range(model.nsite)
              if int(model.site_bodyid[k]) in fixed}  # fmt: skip
    links = {body_name(model, b): b for b in fixed if b != last}
    for ending in TOOL_NAMES:
        for name, site in frames.items():
            if name.endswith(ending):
                return _site(model, site)
        for name, body in links.items():
            if name.endswith(ending):
                return body, np.zeros(3), np.eye(3)
    leaves = [b for b in fixed if b not in {int(model.body_parentid[c]) for c in fixed if c != b}]
    end = leaves[0] if len(leaves) == 1 else last
    return end, np.zeros(3), np.eye(3)
