"""The checks of releases, written to be read: sets, lists and loops; those of steps rest on them.

What one motion may come close to, on which branches a limb can hold along a path, and which joint
angles it has on a branch is asked of compiled code that is compared elsewhere, one question at a
time. The boxes of the map are all there are. Branch sets are sets of pairs, branch and flip.
"""

from typing import NamedTuple

import networkx as nx
import numpy as np
from compiled import called
from joint_lines import line_scratch

from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.intervals import WHOLE, check_line
from mlivr_gym.kinematics.limb import Angles, all_angles_at
from mlivr_gym.robot.rigid import rigid
from mlivr_gym.transitions.departures import Departure, departure_of
from mlivr_gym.transitions.grasp_poses import angles_above


def members(branch_set):
    """Branch and flip of each bit."""
    return {(bit % 8, bit // 8) for bit in range(16) if int(branch_set) >> bit & 1}


def branches(pairs):
    return sorted({branch for branch, _ in pairs})


def on(pairs, some):
    """Those of them on some branches."""
    return {(branch, flip) for branch, flip in pairs if branch in some}


def line_end(first, last):
    """Where a line ends that turns the tool to the nearest half turn, and its length [rad]."""
    tool = last[5] - np.pi * np.round((last[5] - first[5]) / np.pi)
    return np.array([*last[:5], tool]), float(np.abs(last - first)[:5].max())


class Released(NamedTuple):
    """What `Release` says."""

    pairs: set
    folds: set
    root: int
    via: dict


class PlainChecks:
    """A robot at stances, rows of `StanceArrays`, in the world of a graph."""

    def __init__(self, graph, stances):
        self.spec, self.checks, self.stances = graph.robot, graph.checks, stances
        self.shapes, self.grasps = graph.solver.shapes, graph.solver.grasps
        self.robot, self.limits = self.checks.robots[0], graph.solver.thresholds[0]
        folds = self.robot["folds"][: len(self.spec.folds)]
        self.folds = [np.array([*fold, 0.0]) for fold in folds]

    def line_clear(self, base, limb, line, resting, grasp=None):
        """Whether a limb can move along a line (2, 6) while the base and other limbs are at rest.

        With a grasp its gripper may be at that.
        """
        joints = np.zeros((2, self.spec.limbs, 6))
        joints[:, limb] = line
        frame = rigid(base["rotation"], base["position"])
        scratch = line_scratch(
            joints, frame=frame, boxes=1 << limb, itself=1 << limb, first=limb, resting=True
        )
        scratch["resting"]["count"] = len(resting)
        for k, (other, ends) in enumerate(resting):
            scratch["resting"]["limb"][k] = other
            scratch["resting"]["shapes"][k]["ends"][: len(ends)] = ends
        if grasp is not None:
            surface = scratch["surface"]
            surface["applies"], surface["point"] = True, grasp["point"]
            surface["normal"] = grasp["normal"]
        boxes, clearance = self.checks.solver.boxes, float(self.limits["clearance"])
        return called(check_line)(self.robot, boxes, clearance, WHOLE, scratch) == CLEAR

    def grasp(self, s, limb):
        return self.grasps[self.stances.points[s, limb]]

    def ends(self, s, limb):
        """Capsules of a limb that holds at a stance on each branch it has, in the body frame."""
        out, found = Angles.rows(8), {}
        all_angles_at(
            self.checks.robots, limb, self.stances.base[s], self.grasp(s, limb)["flange"], out
        )
        for branch in range(8):
            if np.isfinite(out[branch]["q"]).all():
                joints = np.zeros((self.spec.limbs, 6))
                joints[limb] = out[branch]["q"]
                here = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), joints
                found[branch] = capsule_ends(self.spec, self.shapes, here)[limb]
        return found

    def above(self, s, limb, pairs):
        """Joint angles of a limb above its point on some branches, where there are any."""
        found, out, base = {}, Angles.row(), self.stances.base[s]
        for branch in branches(pairs):
            if angles_above(self.checks.robots, limb, base, self.grasp(s, limb), branch, out):
                found[branch] = out["q"].copy()
        return found

    def departures(self, s, limb, pairs):
        """Knots of departures by branch, shape (n, 6), and the pairs with which they are."""
        found, able, to, base = {}, set(), Departure.row(), self.stances.base[s]
        for branch in branches(pairs):
            flips = departure_of(self.checks.robots, limb, base, self.grasp(s, limb), branch, to)
            able |= members(flips) & pairs
            found[branch] = to["knots"]["q"][: int(to["pieces"]) + 1].copy()
        return {branch: found[branch] for branch in branches(able)}, able

    def elbow_up(self, s, limb, pairs):
        """Of twins that differ in the elbow alone the one farther up in the body frame."""
        ends, dropped = self.ends(s, limb), set()
        for branch in branches(pairs):
            if branch % 2 == 0 and branch + 1 in branches(pairs):
                low, high = (ends[b][..., 2].sum() for b in (branch, branch + 1))
                dropped.add(branch if high > low else branch + 1)
        return on(pairs, set(branches(pairs)) - dropped)

    def release(self, s, limb):
        """On which branches a limb can be released, through folds or else along lines."""
        base, pairs = self.stances.base[s], members(self.stances.branch_sets[s, limb])
        others = [i for i in range(self.spec.limbs) if i != limb]
        at_rest = [
            (i, ends)
            for i in others
            for branch, ends in self.ends(s, i).items()
            if branch in branches(members(self.stances.branch_sets[s, i]))
        ]
        first, free, above = self.elbow_up(s, limb, pairs), set(), {}
        grasp = self.grasp(s, limb)
        for some in (first, pairs - first):
            knots, able = self.departures(s, limb, some)
            above |= {branch: q[-1] for branch, q in knots.items()}
            departs = {
                branch
                for branch, q in knots.items()
                if all(
                    self.line_clear(base, limb, q[k : k + 2], at_rest, grasp)
                    for k in range(len(q) - 1)
                )
            }
            free |= on(able, departs)
            found = self.fold(base, limb, {b: above[b] for b in departs}, at_rest)
            if found:
                return found._replace(pairs=on(able, found.via))
        return Released(on(free, self.joined(base, limb, above, free, at_rest)), set(), 0, {})

    def fold(self, base, limb, above, at_rest):
        """Folding through the first fold that serves a branch, or those that it changes to."""
        for root, here in enumerate(self.folds):
            changeable = [
                fold
                for fold, there in enumerate(self.folds)
                if fold == root or self.line_clear(base, limb, (here, there), at_rest)
            ]
            via = {}
            for branch, q in above.items():
                for fold in changeable:
                    there = np.array([*self.folds[fold][:5], q[5]])
                    if branch not in via and self.line_clear(base, limb, (q, there), at_rest):
                        via[branch] = fold
            if via:
                return Released(set(), set(changeable), root, via)
        return None

    def joined(self, base, limb, above, free, at_rest):
        """The most branches joined by lines, of equally many the first."""
        graph = nx.Graph()
        graph.add_nodes_from(branches(free))
        for a in branches(free):
            for b in branches(free):
                line = above[a], line_end(above[a], above[b])[0]
                if a < b and self.line_clear(base, limb, line, at_rest):
                    graph.add_edge(a, b)
        parts = sorted(nx.connected_components(graph), key=lambda part: (-len(part), min(part)))
        return parts[0] if parts else set()
