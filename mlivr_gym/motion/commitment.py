"""From a sequence of stances to a plan: branches, joint angles and base paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.kinematics.base_path import LIMIT_TOLERANCE, PATH_KINDS, SAMPLES, STRAIGHT, follow
from mlivr_gym.motion.plan import Step
from mlivr_gym.motion.swings import Hold, Swing, SwingFinder, direct_line
from mlivr_gym.postures.selection import base_along, choices_along
from mlivr_gym.postures.solver import Postures
from mlivr_gym.stances.stance_graph import StanceGraph, State
from mlivr_gym.transitions.step_check import Way

Array = NDArray[np.float64]


class Assembly(NamedTuple):
    """A plan's branches, angles, manipulability and steps; `beyond` is a step that joint limits or shapes forbid."""

    branches: NDArray[np.int64]
    joints: Array
    w_m: Array
    w_b: Array
    steps: tuple[Step, ...]
    beyond: int | None


def holds(points: NDArray[np.int64], limb: int) -> list[tuple[int, int]]:
    """First and last stance of each time `limb` holds one point; `points` has shape (K, N)."""
    spans, first = [], 0
    for k in range(1, len(points) + 1):
        if k == len(points) or points[k, limb] != points[first, limb]:
            spans.append((first, k - 1))
            first = k
    return spans


def assemble(
    graph: StanceGraph,
    states: Sequence[State],
    postures: Postures,
    start_joints: Array | None = None,
) -> Assembly:
    """Complete a sequence of states.

    For each time a limb holds, the branch is the one left at its end that has the largest least
    `w_m` over the hold; of equal ones the first. Joint angles are continuous over a hold, on the
    winding inside the limits that is nearest to where the limb was before.

    Args:
        graph: The stance graph.
        states: K states, each with the branches left.
        postures: Their K postures.
        start_joints: Joint angles that the limbs have at the start, shape (N, 6) [rad], if they are
            given.
    """
    count, limbs = len(states), graph.limbs
    checked = graph.settings.transitions
    solver, robot = graph.solver, graph.robot
    points = np.array([state.stance for state in states])
    mounts = (
        solver.mount_rotations,
        solver.mount_positions,
        solver.lengths,
        robot.characteristic_length,
    )
    p, z, w = np.empty((count, limbs, 3)), np.empty((count, limbs, 3)), np.empty((count, limbs, 4))
    choices_along(
        points, graph.grasp_map.positions, graph.grasp_map.normals, robot.tool_length,
        postures.position,
        postures.rotation, *mounts, p, z, w,
    )  # fmt: skip
    branches = postures.branch.copy()
    flips = np.zeros((count, limbs), dtype=np.int64)
    allowed: list[dict[int, int]] = [{} for _ in range(limbs)]
    if checked:
        for limb in range(limbs):
            for first, last in holds(points, limb):
                allowed[limb][first] = states[last].masks[limb]
                if graph.settings.collisions and last < count - 1:
                    here = postures.take(slice(last, last + 1))
                    allowed[limb][first] &= graph.released(states[last].stance, here, limb)
                mask = allowed[limb][first]
                least = w[first : last + 1, limb].min(axis=0)
                bits = [bit for bit in range(16) if mask >> bit & 1]
                bit = max(bits, key=lambda b: (round(float(least[(b & 7) >> 1]), 12), -b))
                branches[first : last + 1, limb], flips[first : last + 1, limb] = bit & 7, bit >> 3
    pivots = _pivots(graph, points)
    ways = _ways(graph, points, postures, branches + 8 * flips) if checked else []
    if _keep_lines(ways, points, allowed, branches, flips):
        ways = _ways(graph, points, postures, branches + 8 * flips)
    joints, spans, beyond = _joint_angles(
        graph, points, pivots, postures, branches, flips, ways, start_joints
    )
    w_m = np.take_along_axis(w, branches[..., None] >> 1, axis=2)[..., 0]
    w_b = np.empty(count)
    base_along(p, z, branches, *mounts, np.empty((limbs, 8, 6, 6)), np.empty((2, 6, 6)), w_b)
    steps = []
    for k in range(count - 1):
        limb = int(np.flatnonzero(points[k] != points[k + 1])[0])
        x, y, height = pivots[k].tolist()
        kind = ways[k].kind if checked else STRAIGHT
        swing = Swing("unchecked", np.zeros((0, 7)))
        if checked and graph.settings.collisions and beyond is None:
            path = (
                postures.position[k], postures.rotation[k], postures.position[k + 1],
                postures.rotation[k + 1], kind, pivots[k],
            )  # fmt: skip
            held = [i for i in range(limbs) if i != limb]
            finder = SwingFinder(
                graph, limb, path, [Hold(i, int(points[k, i]), int(branches[k, i])) for i in held]
            )  # fmt: skip
            start = _lifted(graph, points, postures, branches, flips, joints, k, limb)
            end = _lifted(graph, points, postures, branches, flips, joints, k + 1, limb)
            last, fewest, most = spans[limb][k + 1]
            ends, pair = postures.take(slice(k, k + 2)), ways[k].pair
            line = (
                direct_line(graph, limb, points[k : k + 2, limb].tolist(), ends, pair)
                if pair >= 0
                else None
            )
            found = finder.find(start, end, (fewest, most), ways[k].fold, line)
            if found is None:
                beyond = k
            else:
                swing = found
                turned = np.rint((swing.knots[-1, 1:] - end) / (2.0 * np.pi))
                joints[k + 1 : last + 1, limb] += 2.0 * np.pi * turned
        steps.append(
            Step(
                limb=limb,
                from_point=graph.grasp_map.ids[points[k, limb]],
                to_point=graph.grasp_map.ids[points[k + 1, limb]],
                path=PATH_KINDS[kind] if checked else "unchecked",
                pivot=(x, y, height),
                displacement=float(np.linalg.norm(postures.position[k + 1] - postures.position[k])),
                swing=swing.kind,
                knots=tuple(tuple(knot) for knot in swing.knots.tolist()),
            )
        )
    return Assembly(branches, joints, w_m, w_b, tuple(steps), beyond)


def _lifted(
    graph: StanceGraph, points: NDArray[np.int64], postures: Postures, branches: NDArray[np.int64],
    flips: NDArray[np.int64],
    joints: Array, k: int, limb: int,
) -> Array:  # fmt: skip
    """Joint angles of a limb that has departed from its point at stance `k`, on the windings it has there."""
    solver, point = graph.solver, int(points[k, limb])
    # To depart along the normal is to move the base the other way.
    lifted = postures.position[k] - graph.robot.lift * solver.normals[point]
    here = (lifted, postures.rotation[k])
    q = joints[k, limb].copy()
    q[5] -= np.pi * flips[k, limb]
    follow(
        graph.solver.flanges[point], solver.tools[point], *here, *here, STRAIGHT, lifted,
        solver.mount_rotations[limb],
        solver.mount_positions[limb], solver.lengths, branches[k, limb], 0, np.empty(6), q,
        np.full(6, np.inf),
        np.full(6, -np.inf),
    )  # fmt: skip
    q[5] += np.pi * flips[k, limb]
    return q


def _keep_lines(
    ways: list[Way], points: NDArray[np.int64], allowed: list[dict[int, int]],
    branches: NDArray[np.int64],
    flips: NDArray[np.int64],
) -> bool:  # fmt: skip
    """Put limbs on the branches of the direct swings that the graph knows, where they may be; whether any was changed."""
    changed = False
    for k, way in enumerate(ways):
        if way.pair < 0:
            continue
        limb = int(np.flatnonzero(points[k] != points[k + 1])[0])
        spans = holds(points, limb)
        for stance, wanted in ((k, way.pair >> 3), (k + 1, way.pair & 7)):
            first, last = next(span for span in spans if span[0] <= stance <= span[1])
            if (
                branches[first, limb] != wanted
                and allowed[limb][first] >> (wanted + 8 * flips[first, limb]) & 1
            ):
                branches[first : last + 1, limb] = wanted
                changed = True
    return changed


def _pivots(graph: StanceGraph, points: NDArray[np.int64]) -> Array:
    """Centroid of the held points of each step [m], shape (K - 1, 3)."""
    held = points[:-1] == points[1:]
    centres: Array = (graph.grasp_map.positions[points[:-1]] * held[..., None]).sum(
        axis=1
    ) / held.sum(axis=1)[:, None]
    return centres


def _ways(
    graph: StanceGraph, points: NDArray[np.int64], postures: Postures, bits: NDArray[np.int64]
) -> list[Way]:
    """How each step is made on the branches and flips chosen."""
    ways = []
    for k in range(len(points) - 1):
        limb = int(np.flatnonzero(points[k] != points[k + 1])[0])
        masks = [1 << int(bits[k, i]) for i in range(graph.limbs)]
        way = graph.way(
            points[k].tolist(), points[k + 1].tolist(), limb, postures.take(slice(k, k + 2)), masks
        )
        ways.append(way)
    return ways


def _joint_angles(
    graph: StanceGraph,
    points: NDArray[np.int64],
    pivots: Array,
    postures: Postures,
    branches: NDArray[np.int64],
    flips: NDArray[np.int64],
    ways: list[Way],
    start_joints: Array | None = None,
) -> tuple[Array, list[dict[int, tuple[int, Array, Array]]], int | None]:
    """Joint angles at every stance (K, N, 6) [rad], continuous over each hold.

    The first hold of a limb is on the windings of `start_joints`, if they are given. Also, for each
    limb and first stance of a hold, its last stance and the fewest and most whole turns that may be
    added to the angles over it; and the last step of a hold that does not fit inside the limits, if
    there is one.
    """
    solver, limits = graph.solver, graph.robot.limb.limits
    joints = np.empty((len(points), graph.limbs, 6))
    spans: list[dict[int, tuple[int, Array, Array]]] = []
    beyond = None
    for limb in range(graph.limbs):
        mount = (solver.mount_rotations[limb], solver.mount_positions[limb], solver.lengths)
        before = np.zeros(6)
        spans.append({})
        for first, last in holds(points, limb):
            grip, tool = (
                graph.solver.flanges[points[first, limb]],
                solver.tools[points[first, limb]],
            )
            low, high = np.full(6, np.inf), np.full(6, -np.inf)
            q = np.full(6, np.nan)
            for k in range(first, last + 1):
                if not ways:
                    q[:] = np.nan
                here = (postures.position[k], postures.rotation[k])
                start = joints[k, limb]
                if ways and k < last:
                    follow(
                        grip, tool, *here, postures.position[k + 1], postures.rotation[k + 1],
                        ways[k].kind, pivots[k],
                        *mount, branches[k, limb], SAMPLES, start, q, low, high,
                    )  # fmt: skip
                else:
                    follow(
                        grip, tool, *here, *here, STRAIGHT, here[0], *mount, branches[k, limb], 0,
                        start, q, low, high
                    )  # fmt: skip
                # Where the limb lands and where it leaves, it also moves along the normal.
                if ways and (k == first > 0 or k == last < len(points) - 1):
                    lifted = here[0] - graph.robot.lift * solver.normals[points[k, limb]]
                    follow(
                        grip, tool, *here, lifted, here[1], STRAIGHT, lifted, *mount,
                        branches[k, limb], SAMPLES,
                        np.empty(6), start.copy(), low, high,
                    )  # fmt: skip
            joints[first : last + 1, limb, 5] += np.pi * flips[first, limb]
            low[5] += np.pi * flips[first, limb]
            high[5] += np.pi * flips[first, limb]
            fewest = np.ceil((limits[:, 0] - LIMIT_TOLERANCE - low) / (2.0 * np.pi))
            most = np.floor((limits[:, 1] + LIMIT_TOLERANCE - high) / (2.0 * np.pi))
            if ways and (fewest > most).any():
                beyond = last - 1
            most = np.maximum(fewest, most)
            if first == 0 and start_joints is not None:
                given = np.rint((start_joints[limb] - joints[0, limb]) / (2.0 * np.pi))
                if ways and ((given < fewest) | (given > most)).any():
                    beyond = last - 1
                fewest = most = given
            nearest = np.clip(np.rint((before - joints[first, limb]) / (2.0 * np.pi)), fewest, most)
            joints[first : last + 1, limb] += 2.0 * np.pi * nearest
            spans[limb][first] = last, fewest - nearest, most - nearest
            before = joints[last, limb]
    return joints, spans, beyond
