"""Arms of a URDF or MJCF file: which joints form one, where it grasps, and what it holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError, shortened
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.link_frames import axes_of, rigid

JOINTS = 6
"""Number of joints of an arm that move; of an arm with one joint more, that one is held."""

SHORTEST_ARM = 5
"""Number of joints from which on a tool frame ends an arm, and a chain is one."""

HELD_JOINT = 3
"""The joint of an arm of seven that is held by default: the roll of the upper arm."""

TOOL_NAMES = ("grasp", "tcp", "tool0", "tool", "ee_link", "attachment_site", "flange")
"""Endings of the names of tool frames, the preferred first."""

OF_GRIPPERS = ("gripper", "finger", "jaw", "knuckle", "claw")
"""Words in the names of links and joints that belong to a gripper."""

MOST_TILT = np.deg2rad(1.0)
"""Largest angle between the last joint's axis and the nearest axis of the tool frame [rad]."""


class Tool(NamedTuple):
    """The tool frame of an arm."""

    body: int
    """Body that carries it, by its number in the model."""
    frame: Array
    """The frame in that body, shape (4, 4)."""
    name: str
    """Name of the link or site."""


class FileArm(NamedTuple):
    """An arm of a file, by numbers of joints in the model."""

    joints: tuple[int, ...]
    """All its joints, in order from the body, six or seven."""
    tool: Tool
    """Where it grasps."""
    held: int | None = None
    """Index of the joint that is held."""
    angle: float = 0.0
    """Angle at which it is held [rad]."""

    @property
    def moving(self) -> tuple[int, ...]:
        """The six joints that move."""
        return tuple(joint for k, joint in enumerate(self.joints) if k != self.held)


class Tree:
    """The bodies of a file as a tree."""

    def __init__(self, file: Description) -> None:
        """Find the bodies that joints other than a free one move."""
        self.file, self.model = file, file.model
        free = int(mujoco.mjtJoint.mjJNT_FREE)
        joints, kinds = file.model.body_jntnum, file.model.jnt_type
        self._moving = [
            body
            for body in range(1, file.model.nbody)
            if joints[body] and kinds[file.model.body_jntadr[body]] != free
        ]

    def name(self, body: int) -> str:
        """Return the name of a body."""
        return str(self.model.body(body).name) or f"body {body}"

    def frame(self, body: int) -> Array:
        """Return the frame of a body in the world, shape (4, 4)."""
        data = self.file.data
        return rigid(data.xmat[body].reshape(3, 3), data.xpos[body])

    def carriers(self, body: int) -> list[int]:
        """Return a body, the one that carries it, and so on up to the root, without the world."""
        out = []
        while body:
            out.append(body)
            body = int(self.model.body_parentid[body])
        return out

    def path(self, body: int) -> list[int]:
        """Return the moving bodies from the robot's body to a body, this one included."""
        return [b for b in reversed(self.carriers(body)) if b in self._moving]

    def after(self, body: int) -> list[int]:
        """Return the bodies that joints on a body move, or those fixed to it; of 0 the first."""
        before = [body] if body else []
        return [b for b in self._moving if self.path(b)[:-1][-1:] == before]

    def fixed_to(self, body: int) -> list[int]:
        """Return a moving body and those that are fixed to it."""
        return [b for b in range(1, self.model.nbody) if self.path(b)[-1:] == [body]]

    def is_hinge(self, body: int) -> bool:
        """Return whether one revolute joint moves a body."""
        joint = int(self.model.body_jntadr[body])
        return self.model.body_jntnum[body] == 1 and joint in self.file.joints

    def depth(self, body: int) -> int:
        """Return the number of joints of the longest chain from a body on."""
        return 1 + max(map(self.depth, self.after(body)), default=0)

    def frame_named(self, name: str) -> Tool:
        """Return the link or site of a name."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, str(name))
        if site >= 0:
            return self._site(site)
        body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, str(name))
        if body < 1:
            links = ", ".join(self.name(b) for b in range(1, self.model.nbody))
            sites = ", ".join(str(self.model.site(k).name) for k in range(self.model.nsite))
            known = links + (f"; sites {sites}" if sites else "")
            raise RobotError(
                f"the file has no link or site {shortened(name)}; it has links {known}"
            )
        return Tool(body, np.eye(4), str(name))

    def _site(self, site: int) -> Tool:
        frame = rigid(axes_of(self.model.site_quat[site]), self.model.site_pos[site])
        return Tool(int(self.model.site_bodyid[site]), frame, str(self.model.site(site).name))

    def named_tool(self, last: int) -> Tool | None:
        """Return the tool frame of a customary name that is fixed to a link, None if none is."""
        fixed = self.fixed_to(last)
        sites = [k for k in range(self.model.nsite) if int(self.model.site_bodyid[k]) in fixed]
        tools = [self._site(k) for k in sites]
        tools += [Tool(b, np.eye(4), self.name(b)) for b in fixed if b != last]
        order = [one for ending in TOOL_NAMES for one in tools if one.name.endswith(ending)]
        return order[0] if order else None


def arms_of(
    tree: Tree, tips: Sequence[str] | None, tool_frames: Sequence[str] | None
) -> tuple[FileArm, ...]:
    """Return the arms of a file, without held joints.

    `tips` are the links or sites in which they end, None for every chain of hinges that begins at
    the body; `tool_frames` are those of each arm, None for a customary name, or the last link.
    Joints that several tips share belong to the body. Raises a `RobotError` if there is none, a
    name is unknown, or a joint of an arm is no hinge.
    """
    first = tree.after(0)
    long = [body for body in first if tree.depth(body) >= SHORTEST_ARM] or first
    named = tips or (tool_frames if tool_frames and len(tool_frames) == len(long) else None)
    if named:
        chains = [tree.path(tree.frame_named(name).body) for name in named]
        for name, chain in zip(named, chains, strict=True):
            if not chain:
                raise RobotError(f"no joint lies before {name!r}; name the last link of a limb")
        while len(chains) > 1 and all(len(c) > 1 and c[0] == chains[0][0] for c in chains):
            chains = [chain[1:] for chain in chains]
        tool_frames = tool_frames or tips
    else:
        chains = [_longest(tree, body) for body in long]
    if not chains:
        raise RobotError("the file has no limb: none of its joints is revolute")
    if tool_frames is not None and len(tool_frames) != len(chains):
        raise RobotError(
            f"tool_frame has {len(tool_frames)} names; the file has {len(chains)} limbs"
        )
    out = []
    for k, chain in enumerate(chains):
        joints = tuple(_hinge(tree, body) for body in chain)
        _check_count(tree, joints)
        tool = None if tool_frames is None else tree.frame_named(tool_frames[k])
        if tool is not None and tree.path(tool.body)[-len(chain) :] != chain:
            raise RobotError(
                f"tool_frame {tool.name!r} is not fixed to the last link of the limb, "
                f"{tree.name(chain[-1])!r}"
            )
        out.append(FileArm(joints, tool or _usual_tool(tree, chain[-1])))
    return tuple(out)


def _longest(tree: Tree, body: int) -> list[int]:
    """Return the chain of joints from a body on, without those of a gripper.

    It ends at a tool frame of a customary name, and where names tell of a gripper.
    """
    chain = [body]
    while True:
        here = chain[-1]
        after = [b for b in tree.after(here) if not _is_of_gripper(tree, b, chain)]
        is_whole = len(chain) >= JOINTS and (len(after) != 1 or not tree.is_hinge(after[0]))
        ends = len(chain) >= SHORTEST_ARM and tree.named_tool(here) is not None
        if not after or is_whole or ends:
            return chain
        if len(after) > 1:
            names = ", ".join(repr(tree.name(b)) for b in after)
            raise RobotError(
                f"the chain of joints branches after link {tree.name(here)!r} into {names}; name "
                "the last link of each limb with tips"
            )
        chain += after


def _is_of_gripper(tree: Tree, body: int, chain: list[int]) -> bool:
    """Return whether a link or its joint is named as of a gripper, and those of the arm are not."""

    def words(link: int) -> set[str]:
        joint = tree.model.joint(int(tree.model.body_jntadr[link])).name
        name = f"{tree.name(link)} {joint}".lower()
        return {word for word in OF_GRIPPERS if word in name}

    return bool(words(body)) and not any(map(words, chain))


def _hinge(tree: Tree, body: int) -> int:
    """Return the joint that moves a body."""
    model = tree.model
    if model.body_jntnum[body] > 1:
        raise RobotError(
            f"link {tree.name(body)!r} has {model.body_jntnum[body]} joints; a link of a limb must "
            "have one, revolute"
        )
    joint = int(model.body_jntadr[body])
    name = model.joint(joint).name
    if joint not in tree.file.joints:
        is_slide = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        kind = "prismatic" if is_slide else "a ball joint"
        raise RobotError(f"joint {name!r} is {kind}; the joints of a limb must be revolute")
    for k in range(model.neq):
        if model.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj1id[k] == joint:
            other = int(model.eq_obj2id[k])
            leader = f" joint {model.joint(other).name!r}" if other >= 0 else " a constant"
            raise RobotError(
                f"joint {name!r} mimics{leader}; every joint of a limb must move by itself"
            )
    return joint


def _check_count(tree: Tree, joints: tuple[int, ...]) -> None:
    """Refuse an arm of another number of joints than six or seven."""
    if len(joints) not in (JOINTS, JOINTS + 1):
        first, last = (tree.file.joints[joints[k]].name for k in (0, -1))
        raise RobotError(
            f"the arm of joints {first!r} to {last!r} has {len(joints)} "
            f"{'joint' if len(joints) == 1 else 'joints'}; a limb has six, or seven of which one "
            "is held: name its last link with tips"
        )


def _usual_tool(tree: Tree, last: int) -> Tool:
    """Return the tool frame behind the last joint: by a customary name, or the last link."""
    fixed = tree.fixed_to(last)
    carriers = {int(tree.model.body_parentid[b]) for b in fixed if b != last}
    leaves = [b for b in fixed if b not in carriers]
    end = leaves[0] if len(leaves) == 1 else last
    return tree.named_tool(last) or Tool(end, np.eye(4), tree.name(end))


def with_held_joints(
    tree: Tree,
    arms: tuple[FileArm, ...],
    names: Sequence[str | None] | None,
    angles: Sequence[float | None] | None,
) -> tuple[FileArm, ...]:
    """Return arms with the joints that are held, and bring these to their angles [rad].

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
    out = tuple(_with_held_joint(tree, *one) for one in zip(arms, *each, strict=True))
    mujoco.mj_kinematics(tree.model, tree.file.data)
    return out


def _with_held_joint(tree: Tree, arm: FileArm, name: str | None, angle: float | None) -> FileArm:
    """Return an arm with the joint that it holds, and set the joint's angle."""
    joints = [tree.file.joints[joint].name for joint in arm.joints]
    if name is not None and name not in joints:
        raise RobotError(f"held_joint is {name!r}; the limb's joints are {', '.join(joints)}")
    if len(joints) == JOINTS:
        for field, given in (("held_joint", name), ("held_angle", angle)):
            if given is not None:
                raise RobotError(
                    f"{field} is {given!r}; the limb of joints {', '.join(joints)} holds none of "
                    "them, as only an arm of seven joints does: give None for this limb"
                )
        return arm
    index = HELD_JOINT - 1 if name is None else joints.index(name)
    figures = tree.file.joints[arm.joints[index]]
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
    tree.file.data.qpos[tree.model.jnt_qposadr[arm.joints[index]]] = angle
    return arm._replace(held=index, angle=angle)
