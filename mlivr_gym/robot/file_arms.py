"""Arms of a URDF or MJCF file: which joints form one, which is locked, and where it grasps."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from mlivr_gym.errors import RobotError, shortened
from mlivr_gym.robot.description import Description, Tool, each
from mlivr_gym.robot.file_options import FileOptions

JOINTS = 6
"""Number of joints of an arm that move; of an arm with one joint more, that one is locked."""

SHORTEST_ARM = 5
"""Number of joints from which on a tool frame ends an arm, and a chain is one."""

LOCKED_JOINT = 3
"""The joint of an arm of seven that is locked by default: the roll of the upper arm."""

TOOL_NAMES = ("grasp", "tcp", "tool0", "tool", "ee_link", "attachment_site", "flange")
"""Endings of the names of tool frames, the preferred first."""

OF_GRIPPERS = ("gripper", "finger", "jaw", "knuckle", "claw")
"""Words in the names of links and joints that belong to a gripper."""


class FileArm(NamedTuple):
    """An arm of a file, by numbers of joints in the model."""

    joints: tuple[int, ...]
    """All its joints, in order from the body, six or seven."""
    tool: Tool
    """Where it grasps."""
    locked: int | None = None
    """Index of the joint that is locked."""
    angle: float = 0.0
    """Angle at which it is locked [rad]."""

    @property
    def moving(self) -> tuple[int, ...]:
        """The six joints that move."""
        return tuple(joint for k, joint in enumerate(self.joints) if k != self.locked)


def arms_of(file: Description, options: FileOptions) -> tuple[FileArm, ...]:
    """Return the arms of a file, and bring their locked joints to their angles.

    Without `tips` every chain of hinges that begins at the body is one; joints that several tips
    share belong to the body. Raises a `RobotError` if there is none, a name is unknown, a joint of
    an arm is no hinge, or one is to be locked that cannot be.
    """
    first = file.after(0)
    long = [body for body in first if file.depth(body) >= SHORTEST_ARM] or first
    tips, frames = options.tips, options.tool_frame
    frames = (frames,) if isinstance(frames, str) else frames
    if tips is None and frames is not None and len(frames) == len(long):
        tips = frames
    if tips:
        chains = [file.path(_tool_named(file, name).body) for name in tips]
        for name, chain in zip(tips, chains, strict=True):
            if not chain:
                raise RobotError(f"no joint lies before {name!r}; name the last link of a limb")
        while len(chains) > 1 and all(len(c) > 1 and c[0] == chains[0][0] for c in chains):
            chains = [chain[1:] for chain in chains]
    else:
        chains = [_longest(file, body) for body in long]
    if not chains:
        raise RobotError("the file has no limb: none of its joints is revolute")
    names = each("tool_frame", frames or options.tips, len(chains), "limbs")
    locked = each("locked_joint", options.locked_joint, len(chains), "limbs")
    angles = each("locked_angle", options.locked_angle, len(chains), "limbs")
    every = zip(chains, names, locked, angles, strict=True)
    arms = tuple(_with_locked(file, _arm(file, chain, name), *one) for chain, name, *one in every)
    mujoco.mj_kinematics(file.model, file.data)
    return arms


def _arm(file: Description, chain: list[int], name: str | None) -> FileArm:
    """Return an arm of moving bodies with the tool frame of a name, or a usual one."""
    joints = tuple(_hinge(file, body) for body in chain)
    if len(joints) not in (JOINTS, JOINTS + 1):
        first, last = (file.joints[joints[k]].name for k in (0, -1))
        raise RobotError(
            f"the arm of joints {first!r} to {last!r} has {len(joints)} "
            f"{'joint' if len(joints) == 1 else 'joints'}; a limb has six, or seven of which one "
            "is locked: name its last link with tips"
        )
    if name is not None:
        tool = _tool_named(file, name)
        if file.path(tool.body)[-len(chain) :] != chain:
            raise RobotError(
                f"tool_frame {tool.name!r} is not fixed to the last link of the limb, "
                f"{file.name_of(chain[-1])!r}"
            )
        return FileArm(joints, tool)
    fixed = np.flatnonzero(file.moved == chain[-1]).tolist()
    carriers = {file.parent(body) for body in fixed if body != chain[-1]}
    leaves = [body for body in fixed if body not in carriers]
    end = leaves[0] if len(leaves) == 1 else chain[-1]
    usual = _usual_tool(file, chain[-1])
    if usual is None:
        file.notes.append(f"no tool frame of a usual name: the tool is link {file.name_of(end)!r}")
    return FileArm(joints, usual or Tool(end, np.eye(4), file.name_of(end)))


def _tool_named(file: Description, name: str) -> Tool:
    if name not in file.tools:
        known = ", ".join(file.tools)
        raise RobotError(f"the file has no link or site {shortened(name)}; it has {known}")
    return file.tools[name]


def _usual_tool(file: Description, last: int) -> Tool | None:
    """Return the tool frame of a customary name that is fixed to a link, None if none is."""
    fixed = {name: tool for name, tool in file.tools.items() if file.moved[tool.body] == last}
    fixed.pop(file.name_of(last), None)
    order = (fixed[name] for ending in TOOL_NAMES for name in fixed if name.endswith(ending))
    return next(order, None)


def _longest(file: Description, body: int) -> list[int]:
    """Return the chain of joints from a body on, without those of a gripper.

    It ends at a tool frame of a customary name, and where names tell of a gripper.
    """
    chain = [body]
    while True:
        end = chain[-1]
        after = [one for one in file.after(end) if not _is_of_gripper(file, one, chain)]
        is_whole = len(chain) >= JOINTS and (len(after) != 1 or not file.is_hinge(after[0]))
        ends = len(chain) >= SHORTEST_ARM and _usual_tool(file, end) is not None
        if not after or is_whole or ends:
            return chain
        if len(after) > 1:
            names = ", ".join(repr(file.name_of(one)) for one in after)
            raise RobotError(
                f"the chain of joints branches after link {file.name_of(end)!r} into {names}; "
                "name the last link of each limb with tips"
            )
        chain += after


def _is_of_gripper(file: Description, body: int, chain: list[int]) -> bool:
    """Return whether a link or its joint is named as of a gripper, and those of the arm are not.

    A joint of the wrist moves the gripper and is of the arm.
    """

    def words(link: int) -> set[str]:
        joint = file.model.joint(file.model.body_jntadr[link]).name
        if "wrist" in joint.lower():
            return set()
        name = f"{file.name_of(link)} {joint}".lower()
        return {word for word in OF_GRIPPERS if word in name}

    return bool(words(body)) and not any(map(words, chain))


def _hinge(file: Description, body: int) -> int:
    """Return the joint that moves a body."""
    model = file.model
    if model.body_jntnum[body] > 1:
        raise RobotError(
            f"link {file.name_of(body)!r} has {model.body_jntnum[body]} joints; a link of a limb "
            "must have one, revolute"
        )
    joint = int(model.body_jntadr[body])
    name = model.joint(joint).name
    if joint not in file.joints:
        is_slide = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        kind = "prismatic" if is_slide else "a ball joint"
        raise RobotError(f"joint {name!r} is {kind}; the joints of a limb must be revolute")
    follows = (model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_obj1id == joint)
    if follows.any():
        other = int(model.eq_obj2id[follows][0])
        leader = f"joint {model.joint(other).name!r}" if other >= 0 else "a constant"
        raise RobotError(
            f"joint {name!r} mimics {leader}; every joint of a limb must move by itself"
        )
    return joint


def _with_locked(file: Description, arm: FileArm, name: str | None, angle: float | None) -> FileArm:
    """Return an arm with its locked joint, and set that joint's angle in the file's data.

    Of an arm of seven it is the one that is named, by default the third, by default at 0.
    """
    joints = [file.joints[joint].name for joint in arm.joints]
    if name is not None and name not in joints:
        raise RobotError(f"locked_joint is {name!r}; the limb's joints are {', '.join(joints)}")
    if len(joints) == JOINTS:
        for field, given in (("locked_joint", name), ("locked_angle", angle)):
            if given is not None:
                raise RobotError(
                    f"{field} is {given!r}; the limb of joints {', '.join(joints)} has none "
                    "locked, as only an arm of seven joints has: give None for this limb"
                )
        return arm
    index = LOCKED_JOINT - 1 if name is None else joints.index(name)
    file.data.qpos[file.model.jnt_qposadr[arm.joints[index]]] = angle or 0.0
    return arm._replace(locked=index, angle=angle or 0.0)
