"""Steps between nodes of a table: their stances for the step check, and candidate steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.compiled.limb_masks import has_bit, unpacked
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.tried_poses import bases_at
from mlivr_gym.postures.turns import permuted_limbs
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.node_pairs import row_of
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.transitions.records import ReleaseRecord, StanceSet
from mlivr_gym.world.grasp_map import GraspMap


class CandidateSteps(NamedTuple):
    """Candidate steps from a node."""

    limb: IntArray
    """Limb that moves, shape (k,)."""
    rows: IntArray
    """Rows of the nodes after the steps, shape (k,)."""
    turns: IntArray
    """Cyclic relabellings from these to the limbs of the robot, shape (k,)."""
    bits: IntArray
    """Bits of the pairs, see `node_pairs`, shape (k,)."""


def node_stances(
    grasp_map: GraspMap, robot: RobotSpec, table: NodeTable, rows: IntArray, turns: IntArray
) -> StanceSet:
    """Return nodes of a table, relabelled, as the step check reads them.

    Parameters
    ----------
    grasp_map
        The map.
    robot
        The robot.
    table
        The nodes.
    rows
        Rows of the nodes, shape (k,).
    turns
        Cyclic relabellings of the limbs, shape (k,).
    """
    points = permuted_limbs(table.points[rows].astype(np.int64), turns)
    base = Pose.rows(len(rows))
    base["position"], base["rotation"] = bases_at(
        grasp_map, robot, points, table.tried[rows].astype(np.int64)
    )
    masks, branches, folds = (
        permuted_limbs(unpacked(one[rows], table.limbs), turns)
        for one in (table.masks, table.released, table.folds)
    )
    released = ReleaseRecord.rows(*points.shape)
    released["branches"], released["folds"], released["known"] = branches, folds, True
    return StanceSet(np.ascontiguousarray(points), base, masks, released)


def candidate_steps(table: NodeTable, row: int, turn: int) -> CandidateSteps:
    """Return the candidate steps from a node of a table, relabelled, in the order of limbs."""
    limbs, supports = table.limbs, table.supports[row]
    most = int((table.start[supports + 1] - table.start[supports]).sum())
    found = np.empty((most, 3), dtype=np.int64)
    limb, member, bits = found[: list_candidate_steps(table, row, found)].T
    rows, moved = np.divmod(member, limbs)
    limb_now = (limb - turn) % limbs
    order = np.lexsort((table.points[rows, moved], limb_now))
    return CandidateSteps(limb_now[order], rows[order], (moved - limb + turn)[order], bits[order])


@entry
def list_candidate_steps(table: NodeTable, node: int, found: IntArray) -> int:
    """Write limb, member reached and bit of each candidate step from a node; return how many."""
    count, limbs = 0, table.points.shape[1]
    for limb in range(limbs):
        row = row_of(table, node, limb)
        if row < 0:
            continue
        support = table.supports[node, limb]
        begin, end = int(table.start[support]), int(table.start[support + 1])
        for k in range(end - begin):
            if has_bit(table.bits, row + k):
                found[count, 0], found[count, 1] = limb, table.members[begin + k]
                found[count, 2] = row + k
                count += 1
    return count
