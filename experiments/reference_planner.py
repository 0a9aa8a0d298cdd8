"""Plain reference planner: the paper's Algorithm 1, which evaluates one candidate stance at a time.

A* over stances uses Python's `heapq`; inverse kinematics is Pinocchio's iterative scheme, and
manipulability is computed by its definition. It has no table, no compiled kernel, and knows of the
map only the points within the span.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from reports import timed, two_limb_graph
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, RobotSpec, Settings
from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.manipulability import base_manipulability, limb_manipulability
from mlivr_gym.planners import Planner
from mlivr_gym.postures.base_frames import base_frames
from mlivr_gym.postures.candidate_poses import OPPOSED_HEIGHTS, OPPOSED_ROLLS
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

Stance = tuple[int, int]

TOLERANCE = 0.2
"""Radius of the goal region [m]."""

NODES_ONLY = {"transitions": False, "collisions": False}
"""Settings with thresholds and without step checks, which the reference can solve, too."""

MODES: dict[str, dict[str, Any]] = {
    "thorough": {"first_pose": False, "limit": 200},
    "hasty": {"first_pose": True, "limit": 50},
}
"""All base poses and 200 iterations, or the first sufficient base pose and 50 iterations."""

ACCURACY = 1e-4
"""Norm of the log6 error at which inverse kinematics stops."""

DAMPING = 1e-6
"""Damping that is added to the diagonal of `J J^T`."""

STEP = 0.5
"""Share of the damped Newton step that is taken."""

SEED = np.array([0.0, -1.0, -1.6, -0.5, 1.5, 0.0])
"""Initial joint angles of the iteration if no earlier solution is known [rad]."""


def dh_model(lengths: Array, tool_length: float) -> tuple[pin.Model, int]:
    """Return Pinocchio's model of a UR arm, and the index of its grasp frame.

    `lengths` are d1, a2, a3, d4, d5, d6 of the DH convention [m]; `tool_length` is the distance
    from flange to grasp [m].
    """
    d1, a2, a3, d4, d5, d6 = lengths
    model, here, joint = pin.Model(), pin.SE3.Identity(), 0
    offsets, arms = (d1, 0.0, 0.0, d4, d5, d6), (0.0, a2, a3, 0.0, 0.0, 0.0)
    twists = np.pi / 2 * np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0])
    for k, (d, a, alpha) in enumerate(zip(offsets, arms, twists.tolist(), strict=True)):
        joint = model.addJoint(joint, pin.JointModelRZ(), here, f"joint{k}")
        here = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, d]))
    here = here * pin.SE3(np.eye(3), np.array([0.0, 0.0, tool_length]))
    return model, model.addFrame(pin.Frame("grasp", joint, here, pin.FrameType.OP_FRAME))


class ReferencePlanner:
    """A* over the stances of a two-limb robot; each candidate is evaluated when met, and cached.

    Attributes
    ----------
    stances
        Base position of each evaluated stance, None if it cannot be held.
    """

    def __init__(
        self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings,
        first_pose: bool = False, limit: int = 200,
    ) -> None:  # fmt: skip
        """Create a planner for a map and a robot with two limbs; steps are not checked.

        With `first_pose`, the first base pose that meets the thresholds is taken instead of the one
        with the largest margin. `limit` is the maximum number of iterations of inverse kinematics.
        """
        self.grasp_map, self.robot = grasp_map, robot
        self.first_pose, self.limit = first_pose, limit
        self.thresholds = settings.thresholds(2)
        self.model, self.frame = dh_model(robot.limb.lengths, robot.tool_length)
        self.data = self.model.createData()
        # Axes of a flange that grasps: x along the rail, z into the surface.
        self.flange_axes_in_world = grasp_map.rotations * np.array([1.0, -1.0, -1.0])
        self.mounts = [
            pin.SE3(r, p) for r, p in zip(robot.mount_rotations, robot.mount_positions, strict=True)
        ]
        self.reach = robot.limb.reach + robot.tool_length
        self.stances: dict[Stance, Array | None] = {}

    def inverse_kinematics(self, target: pin.SE3, q: Array) -> Array | None:
        """Return joint angles that bring the grasp frame to a pose in the limb frame, or None.

        The iteration starts at `q`, shape (6,) [rad].
        """
        if float(np.linalg.norm(target.translation)) > self.reach:
            return None
        model, data, frame = self.model, self.data, self.frame
        for _ in range(self.limit):
            pin.framesForwardKinematics(model, data, q)
            error = data.oMf[frame].actInv(target)
            twist = pin.log6(error).vector
            if twist @ twist < ACCURACY**2:
                return q
            jacobian = -pin.Jlog6(error.inverse()) @ pin.computeFrameJacobian(model, data, q, frame)
            normal = jacobian @ jacobian.T
            normal.flat[::7] += DAMPING
            q = q - STEP * (jacobian.T @ np.linalg.solve(normal, twist))
        return None

    def base_poses(self, stance: Stance) -> list[tuple[Array, Array]]:
        """Return base positions [m] and rotations of the posture family, by roll and height."""
        rows = list(stance)
        grasps, rotations = self.grasp_map.positions[rows], self.grasp_map.rotations[rows]
        centroid = grasps.mean(axis=0)
        frame, out, line, opposed = base_frames(
            (grasps - centroid)[None], rotations[None, :, :, 2], rotations[:1, :, 0]
        )
        rolls, heights = self.robot.rolls, self.robot.heights
        if opposed[0]:
            rolls, heights = (
                tuple(2.0 * np.pi * np.arange(OPPOSED_ROLLS) / OPPOSED_ROLLS),
                OPPOSED_HEIGHTS,
            )
        turns = [Rotation.from_rotvec(roll * line[0]).as_matrix() for roll in rolls]
        return [
            (centroid + height * (turn @ out[0]), turn @ frame[0])
            for turn in turns
            for height in heights
        ]

    def limb_jacobian(self, limb: int, q: Array) -> Array:
        """Return the Jacobian of the grasp in base axes, shape (6, 6), linear rows first."""
        local = pin.computeFrameJacobian(
            self.model, self.data, q, self.frame, pin.LOCAL_WORLD_ALIGNED
        )
        jacobian: Array = np.kron(np.eye(2), self.mounts[limb].rotation) @ local
        return jacobian

    def evaluate(self, stance: Stance) -> Array | None:
        """Return the base position of a stance [m], None if no base pose meets the thresholds."""
        best, chosen = 0.0, None
        seeds = [SEED, SEED]
        for position, rotation in self.base_poses(stance):
            base = pin.SE3(rotation, position)
            margin, jacobians, grasps = np.inf, [], []
            for limb, point in enumerate(stance):
                grasp = base.actInv(
                    pin.SE3(self.flange_axes_in_world[point], self.grasp_map.positions[point])
                )
                q = self.inverse_kinematics(self.mounts[limb].actInv(grasp), seeds[limb])
                if q is None:
                    break
                seeds[limb] = q
                jacobians.append(self.limb_jacobian(limb, q))
                grasps.append(grasp.translation)
                w_m = limb_manipulability(jacobians[-1], self.robot.characteristic_length)
                margin = min(margin, w_m / self.thresholds[0])
                if margin < 1.0 or margin <= best:
                    break
            else:
                w_b = base_manipulability(
                    np.array(jacobians), np.array(grasps), self.robot.characteristic_length
                )
                margin = min(margin, w_b / self.thresholds[1])
                if margin >= 1.0 and margin > best:
                    best, chosen = margin, position
                    if self.first_pose:
                        break
        return chosen

    def candidates(self, stance: Stance) -> list[Stance]:
        """Return neighbouring stances that respect span and separation, limb by limb."""
        positions, robot = self.grasp_map.positions, self.robot
        out: list[Stance] = []
        for limb in range(2):
            away = np.linalg.norm(positions - positions[stance[1 - limb]], axis=1)
            for point in np.flatnonzero(
                (away >= robot.grasp_separation - 1e-9) & (away <= robot.span + 1e-9)
            ).tolist():
                if point != stance[limb]:
                    out.append((point, stance[1]) if limb == 0 else (stance[0], point))
        return out

    def plan(
        self, start: Stance, goal: Array, tolerance: float, seconds: float,
        evaluate: Callable[[Stance], Array | None] | None = None,
    ) -> dict[str, Any]:  # fmt: skip
        """Run Algorithm 1 with the base cost and the heuristic `max(0, d - tolerance)`.

        `goal` and `tolerance` are in [m]; the time limit `seconds` is checked after each candidate.
        `evaluate` replaces `self.evaluate`, to count candidates. The result holds `finished`
        (before the limit), `cost` [m] (None without a plan), `expanded`, `candidates` (distinct
        evaluated stances) and `seconds`.
        """
        evaluate, began = evaluate or self.evaluate, time.perf_counter()
        self.stances, closed = {}, set[Stance]()

        def position(stance: Stance) -> Array | None:
            if stance not in self.stances:
                if self.stances and time.perf_counter() - began > seconds:
                    raise TimeoutError
                self.stances[stance] = evaluate(stance)
            return self.stances[stance]

        def estimate(place: Array) -> float:
            return max(0.0, float(np.linalg.norm(place - goal)) - tolerance)

        def search() -> float | None:
            origin = position(start)
            if origin is None:
                return None
            best = {start: 0.0}
            queue = [(estimate(origin), 0.0, start, origin)]
            while queue:
                _, minus_cost, stance, here = heapq.heappop(queue)
                if stance in closed:
                    continue
                closed.add(stance)
                if np.linalg.norm(here - goal) <= tolerance:
                    return -minus_cost
                for after in self.candidates(stance):
                    there = None if after in closed else position(after)
                    if there is None:
                        continue
                    total = best[stance] + float(np.linalg.norm(there - here))
                    if total < best.get(after, np.inf):
                        best[after] = total
                        heapq.heappush(queue, (total + estimate(there), -total, after, there))
            return None

        try:
            cost, finished = search(), True
        except TimeoutError:
            cost, finished = None, False
        return {
            "finished": finished, "cost": cost, "expanded": len(closed),
            "candidates": len(self.stances), "seconds": time.perf_counter() - began,
        }  # fmt: skip


def map_to_plan(
    grasp_map: GraspMap, start: tuple[str, ...], goal: Array, limit: float
) -> dict[str, Any]:
    """Measure map to plan without step checks, in the package and both modes of the reference."""

    def ours() -> tuple[TwoLimbGraph, Any]:
        fresh = two_limb_graph(grasp_map, **NODES_ONLY)
        return fresh, Planner(fresh).plan(start, goal).unwrap()

    times = [timed(ours)[0] for _ in range(5)]
    graph, plan = ours()
    first = (grasp_map.index(start[0]), grasp_map.index(start[1]))
    mine = {"seconds": float(np.median(times)), "cost": plan.statistics.cost}
    out: dict[str, Any] = {"ours": mine}

    def known(stance: tuple[int, int]) -> Array | None:
        s = graph.find(stance)
        return graph.base_position[s] if s >= 0 else None

    settings = Settings(**NODES_ONLY)
    counter = ReferencePlanner(grasp_map, graph.robot, settings)
    needed = counter.plan(first, goal, TOLERANCE, np.inf, known)["candidates"]
    for mode, options in MODES.items():
        reference = ReferencePlanner(grasp_map, graph.robot, settings, **options)
        run = reference.plan(first, goal, TOLERANCE, limit)
        each = run["seconds"] / run["candidates"]
        total = max(run["seconds"], 0.0 if run["finished"] else each * needed)
        out[mode] = run | {"needed": needed, "each": each, "total": total}
    return out
