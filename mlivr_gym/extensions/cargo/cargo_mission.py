"""Pick up a bag at a point, carry it, and stow it at another: planned and simulated.

The robot walks on all limbs to where one of them reaches the bag, picks it up and folds. The others
walk to where it reaches the other point, and it puts the bag down. Which limb carries is the one
with the cheapest two walks. Walks and motions of the limb are found one after the other: each walk
is a plan of its graph, the sum of both is the best of those tried and no proved minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np

from mlivr_gym import stance_graph
from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import NoPlanError, RobotError
from mlivr_gym.extensions.cargo.arm_motion import LimbMotion, LimbScene
from mlivr_gym.extensions.cargo.carrying import carrying_robot
from mlivr_gym.kinematics import grasp_rows
from mlivr_gym.motion import FREE, Plan
from mlivr_gym.planners import QUERY, Planner, SearchOptions
from mlivr_gym.robot import MOST_LIMBS, Cargo, RobotSpec
from mlivr_gym.robot.rigid import combined, rigid
from mlivr_gym.schema import NAME, Integer, ListOf, OrNone
from mlivr_gym.simulation import Execution, Limits, execute
from mlivr_gym.simulation.recording import SimulatedInterval
from mlivr_gym.stances import StanceGraph
from mlivr_gym.values import as_triple
from mlivr_gym.world import Box

BAG = "bag"
"""Id of the box that stands for the bag until it is picked up."""

DISTANCE, DIRECTIONS = 0.4, 6
"""Where walks may end besides above the bag: distance from there [m], and number of directions."""

LIMIT = 3000
"""Maximum number of expansions of a search: it is given up where no walk leads."""


@dataclass(frozen=True)
class CargoMission:
    """A planned mission."""

    limb: int
    """Number of the limb that carries."""
    graphs: tuple[StanceGraph, StanceGraph]
    """Stance graphs of the robot and of the robot that carries."""
    plans: tuple[Plan, Plan]
    """The walks to the bag and with it."""
    motions: tuple[LimbMotion, LimbMotion, LimbMotion]
    """The motions of the limb: to the bag, with it to its fold, and from there to its new point."""

    @checked()
    def execute(self, limits: Limits | None = None) -> dict[str, Execution | SimulatedInterval]:
        """Carry the mission out in MuJoCo, up to its end or first failure; return its parts.

        They are `"walk"`, `"pick up"`, `"fold"`, `"carry"` and `"stow"`, without walks of no step.
        Each starts at rest where it is planned to. While a limb moves with the bag, its gripper has
        the mass of the bag but not its shape.
        """
        (walk, carry), (pick, fold, stow) = self.plans, self.motions
        parts: dict[str, Execution | SimulatedInterval] = {}
        order = {"walk": walk, "pick up": pick, "fold": fold, "carry": carry, "stow": stow}
        for name, part in order.items():
            if isinstance(part, LimbMotion):
                parts[name] = part.execute(self.graphs[1], limits or Limits())
            elif isinstance(part, Plan) and part.steps:
                parts[name] = execute(self.graphs[part is carry], part, limits)
            if name in parts and parts[name].failure is not None:
                break
        return parts


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
    handle at the middle of its upper face. Returned is the mission of the least cost over the limbs
    tried. Raises a `NoPlanError` with the reason of each limb if none can do it, and another
    `MlivrError` if an argument cannot be used.

    Parameters
    ----------
    graph
        The stance graph of a robot of at least three limbs.
    start
        Point id (or index) of each limb.
    pick, stow
        Ids of the points on which the bag stands, and shall stand.
    cargo
        The bag.
    cost
        Cost of the walks, `"steps"` or `"base"`.
    limbs
        Numbers of the limbs that may carry, by default all.
    """
    k, grasp_map, half = graph.grasp_map.index(pick), graph.grasp_map, 0.5 * cargo.edges
    graph.grasp_map.index(stow)
    rotation, found, reasons = grasp_map.rotations[k], list[CargoMission](), list[str]()
    centre = as_triple(grasp_map.positions[k] + half[2] * rotation[:, 2])
    bag = Box(BAG, "obstacle", centre, as_triple(half), Box.rows(rotation))
    graph.add_obstacles([bag])
    try:
        search = partial(Planner(graph).plan, start, cost=cost, options=SearchOptions(limit=LIMIT))
        position = graph.posture(graph.indices(start)).base_position[0]
        goals = _goals(graph, pick, position)
        walk_to = cache(lambda k: search(goals[k]).plan)  # the walks are those of all limbs
        walks = partial(map, walk_to, range(len(goals)))
        for limb in range(graph.robot.limbs) if limbs is None else limbs:
            try:
                found.append(_with_limb(graph, limb, walks, (pick, stow), cargo, cost))
            except (NoPlanError, RobotError) as error:
                reasons.append(f"limb {limb}: {error}")
    finally:
        graph.add_obstacles((), replaced=(BAG,))
    if not found:
        why = "; ".join(reasons)
        raise NoPlanError(f"no limb can bring the bag from {pick!r} to {stow!r}: {why}")
    return min(found, key=lambda mission: sum(plan.cost for plan in mission.plans))


def _grasp(graph: StanceGraph, point: str, height: float) -> Any:
    """Return a point of the map, or what is above it by a height [m], as a record of `Grasp`."""
    k, grasp_map = graph.grasp_map.index(point), graph.grasp_map
    rail, _, normal = grasp_map.rotations[k].T
    above = grasp_map.positions[k] + height * normal
    return grasp_rows(above, normal, rail, graph.robot.tool_length)[()]


def _goals(graph: StanceGraph, point: str, position: Array) -> list[Array]:
    """Return base positions above a point and round it, the nearest to a position first."""
    k, grasp_map = graph.grasp_map.index(point), graph.grasp_map
    rail, across, normal = grasp_map.rotations[k].T
    turns = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    aside = np.outer(np.cos(turns), rail) + np.outer(np.sin(turns), across)
    above = grasp_map.positions[k] + np.mean(graph.robot.heights) * normal
    goals = above + DISTANCE * np.concatenate([np.zeros((1, 3)), aside])
    low, high = grasp_map.cabin
    inside = goals[((goals > low) & (goals < high)).all(axis=1)]
    return list(inside[np.linalg.norm(inside - position, axis=1).argsort(kind="stable")])


def _with_limb(
    graph: StanceGraph,
    limb: int,
    walks: Callable[[], Iterable[Plan | None]],
    ends: tuple[str, str],
    cargo: Cargo,
    cost: str,
) -> CargoMission:
    """Return the mission in which a given limb carries, from one point to another.

    Raises a `NoPlanError` if it cannot reach the bag, fold with it, walk or stow it.
    """
    robot, grasp_map, clearance = graph.robot, graph.grasp_map, graph.settings.clearance
    others = [box for box in graph.obstacles if box.id != BAG]
    carrier, heavy = carrying_robot(robot, limb, cargo), loaded_robot(robot, limb, cargo)
    empty = LimbScene(robot, limb, None, (grasp_map, graph.obstacles), clearance)
    loaded = LimbScene(heavy, limb, cargo, (grasp_map, others), clearance)
    assert carrier.cargo is not None
    assert carrier.cargo.limb is not None
    fold, height = np.array(carrier.cargo.limb.joints), float(cargo.edges[2])
    carrying = stance_graph(grasp_map, carrier, graph.settings)
    carrying.add_obstacles(others)
    carrying.occupy(sorted(graph.occupied))
    for walk in filter(None, walks()):
        picked = _picked(graph, walk, (empty, loaded), _grasp(graph, ends[0], height), fold)
        if picked is None:
            continue
        position, quaternion, joints = walk.configuration(-1)
        search = partial(
            Planner(carrying).plan, np.delete(walk.stances[-1], limb).tolist(), cost=cost,
            options=SearchOptions(limit=LIMIT),
            start_pose=(position, quaternion), start_joints=np.delete(joints, limb, axis=0),
        )  # fmt: skip
        for goal in _goals(graph, ends[1], position):
            if (carry := search(goal).plan) is None:
                continue
            place, turn, walking = carry.configuration(-1)
            loaded.stand(place, turn, np.insert(walking, limb, fold, axis=0))
            for line in loaded.departures(_grasp(graph, ends[1], height)):
                if (path := loaded.connect(fold, line[-1])) is not None:
                    points = np.insert(carrying.indices(carry.stances[-1]), limb, FREE).tolist()
                    stowed = loaded.motion(points, [*pairwise(path), line[::-1]])
                    graphs, plans = (graph, carrying), (walk, carry)
                    return CargoMission(limb, graphs, plans, (*picked, stowed))
    raise NoPlanError("it can pick the bag up and stow it at the ends of no two walks")


def _picked(
    graph: StanceGraph, walk: Plan, scenes: tuple[LimbScene, LimbScene], handle: Any, fold: Array
) -> tuple[LimbMotion, LimbMotion] | None:
    """Return the motions of a limb at the end of a walk: to the bag, and with it to its fold."""
    (empty, loaded), here = scenes, walk.configuration(-1)
    for scene in scenes:
        scene.stand(*here)
    points = list(graph.indices(walk.stances[-1]))
    for leaving in empty.departures(_grasp(graph, walk.stances[-1][empty.limb], 0.0)):
        if not np.allclose(leaving[0], here[2][empty.limb], atol=1e-4):
            continue
        for line in empty.departures(handle):
            is_clear = loaded.is_clear_along(line, handle)
            folding = loaded.connect(line[-1], fold) if is_clear else None
            path = None if folding is None else empty.connect(leaving[-1], line[-1])
            if folding is not None and path is not None:
                to_bag = empty.motion(points, [leaving, *pairwise(path), line[::-1]])
                points[empty.limb] = FREE
                return to_bag, loaded.motion(points, [line, *pairwise(folding)])
    return None


def loaded_robot(robot: RobotSpec, limb: int, cargo: Cargo) -> RobotSpec:
    """Return a robot whose limb `limb` has the mass of cargo at its gripper, and no more of it."""
    dynamics, mounts = robot.dynamics_of(limb), list(robot.whole_mounts)
    *links, last = dynamics.solids[1:]
    bag = cargo.solid.moved(rigid(np.eye(3), cargo.centre_below(robot.tool_length)))
    masses, centres, inertias = zip(*links, combined([last, bag]), strict=True)
    heavier = replace(dynamics, masses=masses, centres=centres, inertias=inertias)
    mounts[limb] = replace(mounts[limb], dynamics=heavier)
    return replace(robot, name=f"{robot.name}-limb{limb}-loaded", mounts=tuple(mounts))
