"""The checks of releases and steps, written to be read: sets, lists and loops.

What one motion may come close to, on which branches a limb can hold along a path, and which joint
angles it has on a branch is asked of compiled code that is compared elsewhere, one question at a
time. The boxes of the map are all there are. Masks are sets of pairs, branch and flip.
"""

from functools import cmp_to_key
from typing import NamedTuple

import networkx as nx
import numpy as np
from compiled import called
from limb_motions import departing, holding, motion, round_corner, swinging

from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.sweep import sweep
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, base_path
from mlivr_gym.kinematics.holding import Holding, hold_mask
from mlivr_gym.kinematics.limb import Angles, all_angles_at
from mlivr_gym.transitions.grasp_poses import angles_above
from mlivr_gym.transitions.steps import TIE, TRIES

EVERY = {(branch, flip) for branch in range(8) for flip in (0, 1)}


def members(mask):
    """Branch and flip of each bit."""
    return {(bit % 8, bit // 8) for bit in range(16) if int(mask) >> bit & 1}


def mask_of(pairs):
    """The same as bits."""
    return sum(1 << branch + 8 * flip for branch, flip in pairs)


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


class Edge(NamedTuple):
    """What `Step` says once it is checked."""

    kept: dict
    on_arc: set
    kind: int
    folds: tuple
    pair: int


NO_EDGE = Edge({}, set(), STRAIGHT, (-1, -1), -1)


class PlainChecks:
    """A robot at stances, rows of `StanceSet`, in the world of a graph."""

    def __init__(self, graph, stances):
        self.spec, self.checks, self.stances = graph.robot, graph.checks, stances
        self.shapes, self.grasps = graph.solver.shapes, graph.solver.grasps
        self.robot, self.limits = self.checks.robots[0], graph.solver.thresholds[0]
        folds = self.robot["folds"][: len(self.spec.folds)]
        self.folds = [np.array([*fold, 0.0]) for fold in folds]

    def clear(
        self, path, first, second, compared, resting=(), grasp=None, places=(0.0, 1.0), corner=None
    ):
        """Whether a limb keeps clear while the base follows a path, or stays if that is a pose.

        A corner that is rounded is base parameter and joint angles, shape (7,).
        """
        stays = path.dtype.names == ("position", "rotation")
        moves = base_path(path, path, STRAIGHT, np.zeros(3)) if stays else path
        room = motion(moves, (0.0, 0.0) if stays else places, first, second, compared)
        room["resting"]["count"] = len(resting)
        for k, (limb, ends) in enumerate(resting):
            room["resting"]["limb"][k] = limb
            room["resting"]["shapes"][k]["ends"][: len(ends)] = ends
        if corner is not None:
            round_corner(room, corner[0], corner[1:], corner[1:])
        if grasp is not None:
            behind = room["behind"]
            behind["applies"], behind["point"] = True, grasp["point"]
            behind["normal"] = grasp["normal"]
        boxes, clearance = self.checks.solver.boxes, float(self.limits["clearance"])
        return called(sweep)(self.robot, boxes, clearance, room) == CLEAR

    def swing_clear(self, path, limb, start, end, resting=()):
        """Whether a limb can swing along a line, limbs that hold aside."""
        swing = swinging(limb, start, end)
        return self.clear(path, swing, swing, ("boxes", "body", "resting"), resting)

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
        base, pairs = self.stances.base[s], members(self.stances.mask[s, limb])
        others = [i for i in range(self.spec.limbs) if i != limb]
        at_rest = [
            (i, ends)
            for i in others
            for branch, ends in self.ends(s, i).items()
            if branch in branches(members(self.stances.mask[s, i]))
        ]
        first, free, above = self.elbow_up(s, limb, pairs), set(), {}
        grasp = self.grasp(s, limb)
        for some in (first, pairs - first):
            lifted = self.above(s, limb, some)
            above |= lifted
            departs = set()
            for branch in lifted:
                flange = grasp["flange"]
                moves = departing(limb, branch, flange["position"], flange["rotation"])
                compared = "boxes", "body", "resting"
                if self.clear(base, moves, moves, compared, at_rest, grasp):
                    departs.add(branch)
            free |= on(some, departs)
            found = self.fold(base, limb, {b: above[b] for b in departs}, at_rest)
            if found:
                return found._replace(pairs=on(some, found.via))
        return Released(on(free, self.joined(base, limb, above, free, at_rest)), set(), 0, {})

    def fold(self, base, limb, above, at_rest):
        """Folding through the first fold that serves a branch, or those that it changes to."""
        for root, here in enumerate(self.folds):
            changeable = [
                fold
                for fold, there in enumerate(self.folds)
                if fold == root or self.swing_clear(base, limb, here, there, at_rest)
            ]
            via = {}
            for branch, q in above.items():
                for fold in changeable:
                    there = np.array([*self.folds[fold][:5], q[5]])
                    if branch not in via and self.swing_clear(base, limb, q, there, at_rest):
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
                if a < b and self.swing_clear(
                    base, limb, above[a], line_end(above[a], above[b])[0], at_rest
                ):
                    graph.add_edge(a, b)
        parts = sorted(nx.connected_components(graph), key=lambda part: (-len(part), min(part)))
        return parts[0] if parts else set()


class PlainStep:
    """A step of a limb between two stances, checked as `transitions.steps` says it.

    Args:
        plain: The robot at stances.
        limb: Limb that moves.
        before: Stance before the step.
        after: Stance after it.
        pivot: Centre of an arc [m].
        wanted: Pairs that each limb may be on.
        given: Whether the limbs are on these.
    """

    def __init__(self, plain, limb, before, after, pivot, wanted, given):
        self.plain, self.limb, self.given = plain, limb, given
        self.before, self.after = before, after
        self.held = [i for i in range(plain.spec.limbs) if i != limb]
        base = plain.stances.base
        self.paths = [base_path(base[before], base[after], k, pivot) for k in (STRAIGHT, ARC)]
        self.on_path = [{i: self.can_hold(i, path, wanted[i]) for i in self.held}
                        for path in self.paths]  # fmt: skip
        self.edge = NO_EDGE

    def can_hold(self, i, path, wanted):
        """Pairs on which a limb can follow a path."""
        plain = self.plain
        if not self.given:
            wanted = wanted & members(plain.stances.mask[self.after, i])
        floor = float(plain.limits["floor"]) * plain.spec.characteristic_length**3
        flange, room = plain.grasp(self.after, i)["flange"], Holding.row()
        limb = plain.robot["limbs"][i]
        return members(called(hold_mask)(limb, flange, path, floor, mask_of(wanted), room))

    def check(self, released=None):
        """The edge, `NO_EDGE` if the step fails.

        Args:
            released: What `PlainChecks.release` says of each limb at both stances; None if
                collisions are not looked at.
        """
        able = [kind for kind in (STRAIGHT, ARC) if all(self.on_path[kind].values())]
        alone, now = len(self.held) == 1, dict.fromkeys(self.held, EVERY)
        if not able:
            return self.edge
        if released is None:
            return self.folded(now, [None])
        first, last = (released[s][self.limb] for s in (self.before, self.after))
        if not first.pairs or not last.pairs:
            return self.edge
        stages = self.stages(released) if alone and not self.given else [now]
        for looked_at in stages:
            if not self.edge.kept and first.folds & last.folds:
                self.folded(looked_at, sorted(first.folds & last.folds))
        if not self.edge.kept:
            self.on_lines(first, last)
        return self.edge

    def stages(self, released):
        """Branches to look at: released at both stances, at one of them, then at none."""
        first, last = (
            {i: on(EVERY, branches(released[s][i].pairs)) for i in self.held}
            for s in (self.before, self.after)
        )
        return [
            {i: first[i] & last[i] for i in self.held},
            {i: first[i] ^ last[i] for i in self.held},
            {i: EVERY - first[i] - last[i] for i in self.held},
        ]

    def folded(self, now, folds):
        """Keep what can hold while the other limb stays folded, in the first fold that can."""
        for kind, path in enumerate(self.paths):
            standing = {
                i: self.on_path[kind][i] & now[i] - (self.kept(i) if len(self.held) == 1 else set())
                for i in self.held
            }
            if not all(standing.values()) or not all(self.on_path[kind].values()):
                continue
            for fold in folds:
                if fold is None:
                    self.keep(kind, standing, -1, -1)
                    break
                q = self.plain.folds[fold]
                if self.plain.swing_clear(path, self.limb, q, q):
                    apart = self.apart(path, standing, (q, q), still=True, swing=True)
                    if apart:
                        self.keep(kind, apart, fold, -1)
                    break
            if self.edge.kept and (self.given or len(self.held) > 1):
                break
        return self.edge

    def kept(self, i):
        return self.edge.kept.get(i, set())

    def keep(self, kind, standing, fold, pair):
        """Add what is kept on a kind of path to the edge."""
        edge, folds = self.edge, list(self.edge.folds)
        if pair < 0:
            folds[kind] = fold
        arc = set().union(*standing.values()) if kind == ARC else set()
        self.edge = Edge(
            {i: self.kept(i) | standing[i] for i in self.held},
            edge.on_arc | arc,
            edge.kind if edge.kept else kind,
            tuple(folds),
            pair,
        )

    def lines(self, first, last):
        """The lines that are tried, the shortest first: branches before and after, and ends."""
        plain, limb = self.plain, self.limb
        starts = plain.above(self.before, limb, first.pairs)
        ends = plain.above(self.after, limb, last.pairs)
        lines = [(b0, b1, *line_end(starts[b0], ends[b1])) for b0 in starts for b1 in ends]
        lines.sort(key=cmp_to_key(lambda a, b: (a[3] > b[3] + TIE) - (b[3] > a[3] + TIE)))
        return [(b0, b1, starts[b0], end) for b0, b1, end, _ in lines[:TRIES]]

    def on_lines(self, first, last):
        """Keep what can hold while the other limb swings along the shortest line that is free."""
        plain, limb = self.plain, self.limb
        for kind, path in enumerate(self.paths):
            standing = dict(self.on_path[kind])
            if not all(standing.values()):
                continue
            for b0, b1, *line in self.lines(first, last):
                if not plain.swing_clear(path, limb, *line):
                    continue
                still = self.apart(path, standing, line, still=True, swing=False)
                if not still:
                    break
                apart = self.apart(path, still, line, still=False, swing=True)
                if apart:
                    self.keep(kind, apart, -1, 8 * b0 + b1)
                    return

    def most(self, released=None):
        """Pairs on which limbs may hold on some path, beside some swing; see `check`.

        Of two limbs that hold each needs a pair that is clear of some of the other's.
        """
        found = {i: set() for i in self.held}
        for path, standing in zip(self.paths, self.on_path, strict=True):
            if not all(standing.values()):
                continue
            for line in [None] if released is None else self.swings(path, released):
                out = dict(standing)
                if line is not None:
                    out = self.each_clear(path, standing, line, ("boxes", "body", "meeting"))
                    out = all(out.values()) and self.some_apart(path, out)
                if out and all(out.values()):
                    found = {i: found[i] | out[i] for i in self.held}
        return found

    def swings(self, path, released):
        """Folds in which the limb that moves can stay, and lines that are tried and clear."""
        first, last = (released[s][self.limb] for s in (self.before, self.after))
        if not first.pairs or not last.pairs:
            return []
        lines = [(self.plain.folds[fold],) * 2 for fold in sorted(first.folds & last.folds)]
        lines += [(start, end) for _, _, start, end in self.lines(first, last)]
        return [line for line in lines if self.plain.swing_clear(path, self.limb, *line)]

    def some_apart(self, path, out):
        """One pair of limbs after the other."""
        for i in self.held:
            for j in (j for j in self.held if j > i):
                clear = [
                    (b, c)
                    for b in branches(out[i])
                    for c in branches(out[j])
                    if self.plain.clear(path, self.holds(i, b), self.holds(j, c), ("meeting",))
                ]
                out = out | {
                    i: on(out[i], {b for b, _ in clear}), j: on(out[j], {c for _, c in clear})
                }  # fmt: skip
        return out

    def holds(self, i, branch):
        """A limb that holds."""
        flange = self.plain.grasp(self.after, i)["flange"]
        return holding(i, branch, flange["position"], flange["rotation"])

    def apart(self, path, standing, line, still, swing):
        """Those of some pairs on which limbs hold clear; None if a limb has none.

        Args:
            path: Path of the base.
            standing: The pairs of each limb that holds.
            line: Joint angles of the other limb at the start and at the end.
            still: Whether they are clear of what does not move, and of each other.
            swing: Whether of the limb that moves.
        """
        out = self.each_clear(
            path, standing, line, ("boxes", "body") * still + ("meeting",) * swing
        )
        for i in self.held if still else ():
            for j in (j for j in self.held if j > i and out[i] and out[j]):
                self.both_apart(path, out, i, j)
        return out if all(out.values()) else None

    def each_clear(self, path, standing, line, compared):
        """Those of some pairs on which limbs hold clear of some parts."""
        mover, out = swinging(self.limb, *line), {}
        for i in self.held:
            free = {
                b
                for b in branches(standing[i])
                if self.plain.clear(path, self.holds(i, b), mover, compared)
            }
            out[i] = on(standing[i], free)
        return out

    def both_apart(self, path, out, i, j):
        """Leave two limbs pairs all of which are clear of each other.

        The second gives up those that meet any of the first's. If it then had none it keeps its
        first branch, and the first gives up those that meet that.
        """
        meets = {
            (b, c)
            for b in branches(out[i])
            for c in branches(out[j])
            if not self.plain.clear(path, self.holds(i, b), self.holds(j, c), ("meeting",))
        }
        rest = set(branches(out[j])) - {c for _, c in meets}
        if rest:
            out[j] = on(out[j], rest)
            return
        chosen = branches(out[j])[0]
        out[j] = on(out[j], {chosen})
        out[i] = {(b, flip) for b, flip in out[i] if (b, chosen) not in meets}
