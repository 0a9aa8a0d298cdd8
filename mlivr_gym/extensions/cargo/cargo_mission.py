"""Pick up a bag at a point, carry it, and stow it at another: planned and simulated.

The robot walks on all limbs to where one of them reaches the bag, picks it up and folds. The others
walk to where it reaches the other point, and it puts the bag down. Which limb carries is the one
with the cheapest two walks. Walks and motions of the limb are found one after the other: each walk
is a plan of its graph, the sum of both is the best of those tried and no proved minimum.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import tee
from typing import NamedTuple

import numpy as np

from mlivr_gym import stance_graph
from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.collisions import lies_behind
from mlivr_gym.errors import NoPlanError, RobotError, SettingError, ShapeError
from mlivr_gym.extensions.cargo.arm_motion import Handle, LimbMover, limb_trajectory
from mlivr_gym.extensions.cargo.carrying import carrying_robot
from mlivr_gym.motion import FREE, Plan
from mlivr_gym.planners import QUERY, Planner, SearchOptions
from mlivr_gym.robot import MOST_LIMBS, Cargo, RigidBody, RobotSpec
from mlivr_gym.robot.rigid import combined, quaternion_of
from mlivr_gym.schema import NAME, Integer, ListOf, OrNone
from mlivr_gym.simulation import Limits, Physics, Recording, Simulation, execute
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.recording import Failure, Peaks
from mlivr_gym.stances import StanceGraph
from mlivr_gym.values import as_triple
from mlivr_gym.world import Box, GraspMap

BAG = "bag"
"""Id of the box that stands for the bag until it is picked up."""

DISTANCES, DIRECTIONS = (0.0, 0.4), 6
"""Where walks may end: distances from the bag along the surface [m], and directions."""

LIMIT = 3000
"""Maximum number of expansions of a search: it is given up where no walk leads."""


class MissionPart(NamedTuple):
    """What was measured in one part of a mission."""

    name: str
    """One of `"walk"`, `"pick up"`, `"fold"`, `"carry"` and `"stow"`."""
    recording: Recording
    """Measurements on a time grid."""
    peaks: Peaks
    """Maxima over all time steps."""
    failure: Failure | None
    """The failure that ended it."""
    miss: float
    """Distance of the gripper from its place at the end, 0 for a walk [m]."""


@dataclass(frozen=True)
class CargoMission:
    """A planned mission."""

    limb: int
    """Number of the limb that carries."""
    cargo: Cargo
    """The bag."""
    graphs: tuple[StanceGraph, StanceGraph]
    """Stance graphs of the robot and of the robot that carries."""
    plans: tuple[Plan, Plan]
    """The walks to the bag and with it."""
    motions: tuple[Array, Array, Array]
    """Joint angles of the limb at the knots of its motions: to the bag, with it to where it is
    folded, and to where it is stowed, each (k, 6) [rad]."""

    @property
    def cost(self) -> float:
        """Cost of both walks."""
        return sum(plan.cost for plan in self.plans)

    @checked()
    def execute(
        self, limits: Limits | None = None, physics: Physics | None = None
    ) -> tuple[MissionPart, ...]:
        """Carry the mission out in MuJoCo, part by part, up to its end or first failure.

        Each part starts at rest where it is planned to. While a limb moves with the bag, its
        gripper has the mass of the bag but not its shape.
        """
        limits, physics, parts = limits or Limits(), physics or Physics(), list[MissionPart]()
        whole = self.graphs[0].robot
        loaded = loaded_robot(whole, self.limb, self.cargo)
        for name, leg, number, robot in (
            ("walk", 0, None, whole), ("pick up", 0, 0, whole), ("fold", 0, 1, loaded),
            ("carry", 1, None, loaded), ("stow", 1, 2, loaded),
        ):  # fmt: skip
            if number is not None:
                parts.append(self._move(name, (leg, number), robot, limits, physics))
            elif self.plans[leg].steps:
                done = execute(self.graphs[leg], self.plans[leg], limits, physics)
                parts.append(MissionPart(name, done.recording, done.peaks, done.failure, 0.0))
            if parts and parts[-1].failure is not None:
                break
        return tuple(parts)

    def _move(
        self, name: str, which: tuple[int, int], robot: RobotSpec, limits: Limits, physics: Physics
    ) -> MissionPart:
        """Carry out a motion of the limb at the end of a walk."""
        leg, number = which
        graph, plan, knots, limb = self.graphs[0], self.plans[leg], self.motions[number], self.limb
        position, quaternion, joints = standing(plan, limb, knots[0])
        ids = list(plan.stances[-1])
        points = [graph.grasp_map.index(point) for point in ids]
        if number:
            points[limb : limb + 1 - leg] = [FREE]
        start = position, quaternion, joints, tuple(points)
        motion = limb_trajectory(graph, limb, knots, start, robot, limits)
        obstacles = [box for box in plan.world.obstacles if box.id != BAG]
        simulation = Simulation(graph.grasp_map, robot, physics, obstacles)
        simulation.reset(*start)
        done = simulation.move(motion)
        site = simulation.data.site(f"limb{limb}/grasp").xpos.copy()
        points[limb] = FREE
        simulation.reset(position, quaternion, standing(plan, limb, knots[-1])[2], points)
        miss = float(np.linalg.norm(site - simulation.data.site(f"limb{limb}/grasp").xpos))
        return MissionPart(name, done.recording, done.peaks, done.failure, miss)


@checked(
    {
        **QUERY,
        "pick": NAME,
        "stow": NAME,
        "cargo": InstanceOf(Cargo),
        "limbs": OrNone(ListOf(Integer(0, MOST_LIMBS - 1), 1, MOST_LIMBS)),
    }
)
def plan_cargo_mission(
    graph: StanceGraph,
    start: Sequence[str | int],
    pick: str,
    stow: str,
    cargo: Cargo,
    cost: str = "steps",
    *,
    limbs: Sequence[int] | None = None,
) -> CargoMission:
    """Plan to pick a bag up at a point, to carry it and to stow it at another point.

    A bag stands on its point with its z axis along the normal, its x axis along the rail, and a
    handle at the middle of its upper face.

    Parameters
    ----------
    graph
        The stance graph of a robot of at least three limbs.
    start
        Point id (or index) of each limb.
    pick
        Id of the point on which the bag stands.
    stow
        Id of the point on which it shall stand.
    cargo
        The bag.
    cost
        Cost of the walks, `"steps"` or `"base"`.
    limbs
        Numbers of the limbs that may carry, by default all.

    Returns
    -------
    CargoMission
        The mission of the least cost over the limbs tried.

    Raises
    ------
    NoPlanError
        If no limb can do it; the message has the reason of each.
    MlivrError
        If an argument cannot be used.
    """
    if pick == stow:
        raise SettingError(f"pick and stow are both {pick!r}; they must be two points")
    if pick in (held := graph.ids(graph.indices(start))):
        raise SettingError(f"pick is {pick!r}, which limb {held.index(pick)} holds at the start")
    handles = [_handle(graph.grasp_map, point, cargo) for point in (pick, stow)]
    for point, handle in zip((pick, stow), handles, strict=True):
        _check_place(graph, point, _bag(handle, cargo))
    bag, others = _bag(handles[0], cargo), graph.obstacles
    found, reasons = list[CargoMission](), dict[str, list[str]]()
    graph.add_obstacles([bag])
    try:
        search = partial(Planner(graph).plan, start, cost=cost, options=SearchOptions(limit=LIMIT))
        position = graph.posture(graph.indices(start)).base_position[0]
        around = _goals(graph.grasp_map, graph.robot, handles[0], (position, cargo))
        found_walks: Iterator[Plan] = (
            plan for goal in around if (plan := search(goal).plan) is not None
        )
        for limb in range(graph.robot.limbs) if limbs is None else limbs:
            found_walks, walks = tee(found_walks)  # each is searched for once
            try:
                found.append(_with_limb(graph, limb, (walks, others), handles, cargo, cost))
            except (NoPlanError, RobotError) as error:
                reasons.setdefault(str(error), []).append(f"limb {limb}")
    finally:
        graph.add_obstacles((), replaced=(bag.id,))
    if not found:
        each = "; ".join(f"{' and '.join(limbs)}: {why}" for why, limbs in reasons.items())
        raise NoPlanError(f"no limb can bring the bag from {pick!r} to {stow!r}: {each}")
    return min(found, key=lambda mission: mission.cost)


def _with_limb(
    graph: StanceGraph,
    limb: int,
    there: tuple[Iterator[Plan], tuple[Box, ...]],
    handles: Sequence[Handle],
    cargo: Cargo,
    cost: str,
) -> CargoMission:
    """Return the mission in which a given limb carries.

    Raises a `NoPlanError` if it cannot reach the bag, fold with it, walk or stow it.
    """
    carrier = carrying_robot(graph.robot, limb, cargo)
    assert carrier.cargo is not None
    assert carrier.cargo.limb is not None
    fold = np.array(carrier.cargo.limb.joints)
    walks, obstacles = there
    movers = LimbMover(graph, limb, graph.obstacles), LimbMover(graph, limb, obstacles, cargo)
    others = [i for i in range(graph.robot.limbs) if i != limb]
    carrying, reason = None, "it reaches the bag from the end of no walk, or cannot fold with it"
    for walk in walks:
        picked = next(_picked(walk, movers, handles[0], fold), None)
        if picked is None:
            continue
        if carrying is None:
            carrying = stance_graph(graph.grasp_map, carrier, graph.settings)
            carrying.add_obstacles(obstacles)
            carrying.occupy(sorted(graph.occupied))
        position, quaternion, joints = walk.configuration(-1)
        search = partial(
            Planner(carrying).plan, [walk.stances[-1][i] for i in others], cost=cost,
            options=SearchOptions(limit=LIMIT),
            start_pose=(position, quaternion), start_joints=joints[others],
        )  # fmt: skip
        for goal in _goals(graph.grasp_map, graph.robot, handles[1], (position, cargo)):
            carry = search(goal).plan
            stowing = None if carry is None else _stowed(carry, movers[1], handles[1], fold)
            if carry is not None and stowing is not None:
                plans = walk, carry
                return CargoMission(limb, cargo, (graph, carrying), plans, (*picked, stowing))
        reason = "it can stow the bag at the end of no walk with it"
    raise NoPlanError(reason)


def _goals(
    grasp_map: GraspMap, robot: RobotSpec, handle: Handle, origin: tuple[Array, Cargo]
) -> list[Array]:
    """Return base positions round the handle of cargo, the nearest to a position first."""
    across, goals = np.cross(handle.normal, handle.rail), []
    position, cargo = origin
    middle = handle.point + (np.mean(robot.heights) - cargo.edges[2]) * handle.normal
    for distance in DISTANCES:
        for turn in 2.0 * np.pi * np.arange(DIRECTIONS if distance else 1) / DIRECTIONS:
            goals.append(middle + distance * (np.cos(turn) * handle.rail + np.sin(turn) * across))
    low, high = grasp_map.cabin
    inside = [goal for goal in goals if ((goal > low) & (goal < high)).all()]
    return sorted(inside, key=lambda goal: float(np.linalg.norm(goal - position)))


def _stowed(carry: Plan, mover: LimbMover, handle: Handle, fold: Array) -> Array | None:
    """Return the motion of a limb at the end of a walk from its fold to a handle."""
    mover.stand(*standing(carry, mover.limb, fold))
    for line in mover.reaches(handle):
        path = mover.connect(fold, line[0])
        if path is not None:
            return np.concatenate([path, line[1:]])
    return None


def _picked(
    walk: Plan, movers: tuple[LimbMover, LimbMover], handle: Handle, fold: Array
) -> Iterator[tuple[Array, Array]]:
    """Yield the motions of a limb at the end of a walk: to the bag, and with it to its fold."""
    empty, loaded = movers
    limb, grasp_map = empty.limb, empty.graph.grasp_map
    here = walk.configuration(-1)
    for mover in movers:
        mover.stand(*here)
    held = here[2][limb]
    point = point_handle(grasp_map, walk.stances[-1][limb])
    for leaving in empty.reaches(point, held)[:1]:
        for line in empty.reaches(handle):
            lifted = loaded.reaches(handle, line[-1])
            folding = loaded.connect(lifted[0][0], fold) if lifted else None
            path = None if folding is None else empty.connect(leaving[0], line[0])
            if folding is not None and path is not None:
                to_bag = np.concatenate([leaving[::-1], path[1:], line[1:]])
                yield to_bag, np.concatenate([lifted[0][::-1], folding[1:]])


def standing(plan: Plan, limb: int, joints: Array) -> tuple[Array, Array, Array]:
    """Return the configuration at the end of a walk, with a limb at given joint angles (6,) [rad].

    The walk may be one of the other limbs alone.
    """
    position, quaternion, held = plan.configuration(-1)
    held = held.copy()
    if plan.world.robot.cargo is not None:
        return position, quaternion, np.insert(held, limb, joints, axis=0)
    held[limb] = joints
    return position, quaternion, held


def point_handle(grasp_map: GraspMap, point: str) -> Handle:
    """Return a point of a map as a handle."""
    k = grasp_map.index(point)
    rotation = grasp_map.rotations[k]
    return Handle(grasp_map.positions[k], rotation[:, 2], rotation[:, 0])


def _handle(grasp_map: GraspMap, point: str, cargo: Cargo) -> Handle:
    """Return the handle of a bag that stands on a point."""
    foot = point_handle(grasp_map, point)
    return replace(foot, point=foot.point + cargo.edges[2] * foot.normal)


def _bag(handle: Handle, cargo: Cargo) -> Box:
    """Return a bag with a handle as an obstacle."""
    axes = np.column_stack([handle.rail, np.cross(handle.normal, handle.rail), handle.normal])
    x, y, z = (handle.point - 0.5 * cargo.edges[2] * handle.normal).tolist()
    a, b, c = (0.5 * cargo.edges).tolist()
    return Box(BAG, "obstacle", (x, y, z), (a, b, c), Box.rows(axes))


def _check_place(graph: StanceGraph, point: str, bag: Box) -> None:
    """Refuse a point on which a bag would stand too close to what does not lie behind the point."""
    foot, boxes = point_handle(graph.grasp_map, point), (*graph.grasp_map.boxes, *graph.obstacles)
    spec, kind = mujoco.MjSpec(), mujoco.mjtGeom.mjGEOM_BOX
    for box in (bag, *boxes):
        turn = quaternion_of(np.array(box.rotation))
        spec.worldbody.add_geom(type=kind, pos=box.centre, size=box.half, quat=turn)
    model, clearance = spec.compile(), graph.settings.clearance
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for k, box in enumerate(boxes):
        gap = mujoco.mj_geomDistance(model, data, 0, k + 1, clearance, None)
        if gap < clearance and not lies_behind(box, foot.point, foot.normal):
            raise ShapeError(
                f"on point {point!r} the bag would come closer than {clearance:g} m to {box.id!r}; "
                "choose another point, or a smaller bag"
            )


def loaded_robot(robot: RobotSpec, limb: int, cargo: Cargo) -> RobotSpec:
    """Return a robot whose limb `limb` has the mass of cargo at its gripper, and no more of it."""
    dynamics, frame = robot.dynamics_of(limb), np.eye(4)
    frame[:3, 3] = cargo.centre_below(robot.tool_length)
    last = RigidBody(
        dynamics.masses[5], as_triple(np.array(dynamics.centres[5])), dynamics.inertias[5]
    )
    both = combined([last, cargo.solid.moved(frame)])
    heavier = replace(
        dynamics,
        masses=(*dynamics.masses[:5], both.mass),
        centres=(*dynamics.centres[:5], both.centre),
        inertias=(*dynamics.inertias[:5], both.inertia),
    )
    mounts = list(robot.whole_mounts)
    mounts[limb] = replace(mounts[limb], dynamics=heavier)
    name = f"{robot.name}-limb{limb}-loaded"
    return replace(robot, name=name, mounts=tuple(mounts))
