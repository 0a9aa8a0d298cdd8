"""The checks of steps, written to be read: sets, lists and loops, over those of `plain_checks`."""

from functools import cmp_to_key
from typing import NamedTuple

from compiled import called
from limb_motions import holding, swinging
from plain_checks import branch_set_of, branches, line_end, members, on

from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, base_path
from mlivr_gym.kinematics.holding import Holding, held_branches
from mlivr_gym.transitions.swing_lines import TIE, TRIES


class Edge(NamedTuple):
    """What `Step` says once it is checked."""

    kept: dict
    path_kind: int
    fold: int
    line_branches: int


NO_EDGE = Edge({}, STRAIGHT, -1, -1)


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
            wanted = wanted & members(plain.stances.branch_sets[self.after, i])
        floor = float(plain.limits["floor"]) * plain.spec.characteristic_length**3
        flange, scratch = plain.grasp(self.after, i)["flange"], Holding.row()
        limb = plain.robot["limbs"][i]
        return members(
            called(held_branches)(limb, flange, path, floor, branch_set_of(wanted), scratch)
        )

    def check(self, released=None):
        """The edge, `NO_EDGE` if the step fails.

        Args:
            released: What `PlainChecks.release` says of each limb at both stances; None if
                collisions are not looked at.
        """
        able = [kind for kind in (STRAIGHT, ARC) if all(self.on_path[kind].values())]
        if not able:
            return self.edge
        if released is None:
            return self.folded([None])
        first, last = (released[s][self.limb] for s in (self.before, self.after))
        if not first.pairs or not last.pairs:
            return self.edge
        self.folded(sorted(first.folds & last.folds))
        if not self.edge.kept:
            self.on_lines(first, last)
        return self.edge

    def folded(self, folds):
        """Keep what can hold while the other limb stays folded, in the first fold that can."""
        for kind, path in enumerate(self.paths):
            standing = dict(self.on_path[kind])
            if not all(standing.values()):
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
            if self.edge.kept:
                break
        return self.edge

    def keep(self, kind, standing, fold, pair):
        """Let the edge be what is kept on a kind of path."""
        self.edge = Edge(dict(standing), kind, fold, pair)

    def lines(self, first, last):
        """The lines that are tried, see `swing_lines`."""
        return swing_lines(self.plain, self.limb, (self.before, self.after), first, last)

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


def swing_lines(plain, limb, stances, first, last):
    """The lines that are tried, the shortest first: branches before and after, and ends."""
    starts, ends = (
        plain.above(s, limb, release.pairs)
        for s, release in zip(stances, (first, last), strict=True)
    )
    pairs = [(b0, b1) for b0 in starts for b1 in ends]
    here, there = (plain.grasp(s, limb)["point"] for s in stances)
    if there.round(6).tolist() < here.round(6).tolist():
        # Of lines of equal length the step back takes the same.
        pairs = [(b0, b1) for b1 in ends for b0 in starts]
    lines = [(b0, b1, *line_end(starts[b0], ends[b1])) for b0, b1 in pairs]
    lines.sort(key=cmp_to_key(lambda a, b: (a[3] > b[3] + TIE) - (b[3] > a[3] + TIE)))
    return [(b0, b1, starts[b0], end) for b0, b1, end, _ in lines[:TRIES]]
