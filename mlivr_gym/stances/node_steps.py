"""Steps between nodes of a table: their stances for the step check, and candidate steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.compiled.limb_branch_sets import has_bit, unpacked
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.base_poses import bases_at
from mlivr_gym.postures.relabelling import relabelled
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.node_edges import row_of
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.transitions.records import ReleaseRecord, StanceArrays
from mlivr_gym.world.grasp_map import GraspMap


class CandidateSteps(NamedTuple):
    """Candidate steps from a node."""

    limb: IntArray
    """Limb that moves, shape (k,)."""
    rows: IntArray
    """Rows of the nodes after the steps, shape (k,)."""
    relabellings: IntArray
    """Cyclic relabellings from these to the limbs of the robot, shape (k,)."""
    edges: IntArray
    """Numbers of the edges, see `node_edges`, shape (k,)."""


def node_stances(
    grasp_map: GraspMap, robot: RobotSpec, table: NodeTable, rows: IntArray, relabellings: IntArray
) -> StanceArrays:
    """Return nodes of a table, cyclically relabelled, as the step check reads them, shape (k,)."""
    points = relabelled(table.points[rows].astype(np.int64), relabellings)
    base = Pose.rows(len(rows))
    base["position"], base["rotation"] = bases_at(
        grasp_map, robot, points, table.pose_number[rows].astype(np.int64)
    )
    branch_sets, branches, folds = (
        relabelled(unpacked(one[rows], table.limbs), relabellings)
        for one in (table.branch_sets, table.releasable, table.folds)
    )
    releases = ReleaseRecord.rows(*points.shape)
    releases["branches"], releases["folds"], releases["known"] = branches, folds, True
    return StanceArrays(np.ascontiguousarray(points), base, branch_sets, releases)


def candidate_steps(table: NodeTable, row: int, relabelling: int) -> CandidateSteps:
    """Return the candidate steps from a node of a table, relabelled, in the order of limbs."""
    limbs, support_sets = table.limbs, table.support_sets[row]
    most = int((table.start[support_sets + 1] - table.start[support_sets]).sum())
    found = np.empty((most, 3), dtype=np.int64)
    limb, member, edges = found[: list_candidate_steps(table, row, found)].T
    rows, moved = np.divmod(member, limbs)
    limb_now = (limb - relabelling) % limbs
    order = np.lexsort((table.points[rows, moved], limb_now))
    return CandidateSteps(
        limb_now[order], rows[order], (moved - limb + relabelling)[order], edges[order]
    )


@entry
def list_candidate_steps(table: NodeTable, node: int, found: IntArray) -> int:
    """Write limb, member reached and number of each candidate step from a node; return how many."""
    count, limbs = 0, table.points.shape[1]
    for limb in range(limbs):
        row = row_of(table, node, limb)
        if row < 0:
            continue
        support_set = table.support_sets[node, limb]
        begin, end = int(table.start[support_set]), int(table.start[support_set + 1])
        for k in range(end - begin):
            if has_bit(table.joined, row + k):
                found[count, 0], found[count, 1] = limb, table.members[begin + k]
                found[count, 2] = row + k
                count += 1
    return count
