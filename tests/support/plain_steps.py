"""The check of a step, written to be read: sets, lists and loops.

Whether one motion is clear, or places of it, is asked of `intervals.check_line`, which is compared
elsewhere; which motions there are, and which branches
an edge keeps, is said here over what `plain_checks` says of releases.
"""

from functools import cmp_to_key, partial
from itertools import combinations
from typing import NamedTuple

from compiled import called
from plain_checks import branches, line_end, members, on

from mlivr_gym.collisions.base_path import set_path
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.followers import choose_branch, set_follower
from mlivr_gym.collisions.intervals import WHOLE, check_line
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.transitions.relaxed_steps import MIDDLES
from mlivr_gym.transitions.steps import KEPT_CLEAR
from mlivr_gym.transitions.swing_lines import TIE, TRIES


class Edge(NamedTuple):
    """What `Step` says once it is checked."""

    kept: dict
    line_branches: int


NO_EDGE = Edge({}, -1)


class PlainStep:
    """A step of a limb between two stances, checked as `transitions.steps` says it.

    Args:
        plain: The robot at stances.
        limb: Limb that moves.
        before: Stance before the step.
        after: Stance after it.
    """

    def __init__(self, plain, limb, before, after):
        self.plain, self.limb = plain, limb
        self.before, self.after = before, after
        self.held = [i for i in range(plain.spec.limbs) if i != limb]
        bases = plain.stances.base
        here, there = (tuple(bases[s]["position"].round(6)) for s in (before, after))
        self.back = there < here
        self.ends = [bases[s].copy() for s in ((after, before) if self.back else (before, after))]
        shared = plain.stances.branch_sets[before] & plain.stances.branch_sets[after]
        self.wanted = {i: members(shared[i]) for i in self.held}

    def moved(self, standing=None, swing=None, whole=True, **compared):
        """Flips with which a limb follows clear of what is compared, of all given ones a set.

        Args:
            standing: Limbs that hold, each with its branch and the set of its flips.
            swing: Joint angles of the limb that moves at the start and at the end, (2, 6).
            whole: Whether it is asked of the whole motion, or of its first middles.
            compared: Fields of `Compared`.
        """
        plain, scratch = self.plain, LineScratch.row()
        line, standing = scratch["line"], standing or {}
        called(set_path)(line["path"], *self.ends)
        scratch["floor"] = float(plain.limits["floor"]) * plain.spec.characteristic_length**3
        line["moves"] = True
        for i in self.held:
            called(set_follower)(i, plain.grasp(self.after, i)["flange"], scratch)
        for i, (branch, flips) in standing.items():
            called(choose_branch)(i, branch, sum(1 << branch + 8 * f for f in flips), scratch)
        if swing is not None:
            for name, q in zip(("last", "first") if self.back else ("first", "last"), swing,
                               strict=True):  # fmt: skip
                line[name]["q"][self.limb] = q
        pair = compared.pop("pair", (-1, -1))
        scratch["compared"]["first"], scratch["compared"]["second"] = pair
        scratch["compared"]["holding"] = line["follows"]
        for name, value in compared.items():
            scratch["compared"][name] = value
        clearance = float(plain.limits["clearance"]) + KEPT_CLEAR
        arguments = plain.robot, plain.checks.solver.boxes, clearance, WHOLE if whole else MIDDLES
        if called(check_line)(*arguments, scratch) != CLEAR:
            return None
        return {i: {f for f in (0, 1) if int(line["flips"][i]) >> f & 1} for i in standing}

    def alone(self, collisions=True):
        """Pairs on which each limb follows, clear of all but other limbs; None without the base."""
        if collisions and self.moved(base=True) is None:
            return None
        found = {}
        for i in self.held:
            found[i] = set()
            compared = {"boxes": 1 << i, "itself": 1 << i} if collisions else {"placed": 1 << i}
            for branch in branches(self.wanted[i]):
                flips = {f for b, f in self.wanted[i] if b == branch}
                kept = self.moved({i: (branch, flips)}, **compared)
                found[i] |= {(branch, f) for f in (kept or {i: ()})[i]}
        return found if all(found.values()) else None

    def apart(self, standing, i, b, j, c, whole=True):
        """Whether two supports stay clear of each other on two branches."""
        both = {
            k: (branch, {f for other, f in standing[k] if other == branch})
            for k, branch in ((i, b), (j, c))
        }
        return self.moved(both, whole=whole, pair=(i, j)) is not None

    def beside(self, standing, swing, whole=True):
        """Those of some pairs that are clear of a swing; None if it meets more, or all of one."""
        moving = self.limb
        if self.moved(swing=swing, whole=whole, boxes=1 << moving, itself=1 << moving) is None:
            return None
        found = {}
        for i in self.held:
            free = set()
            for branch in branches(standing[i]):
                flips = {f for b, f in standing[i] if b == branch}
                clear = self.moved({i: (branch, flips)}, swing, whole, pair=(moving, i))
                free |= set() if clear is None else {branch}
            found[i] = on(standing[i], free)
        return found if all(found.values()) else None

    def both_apart(self, standing, i, j):
        """Leave two limbs pairs all of which are clear of each other.

        The second gives up those that meet any of the first's. If it then had none it keeps its
        first branch, and the first gives up those that meet that.
        """
        meets = {
            (b, c)
            for b in branches(standing[i])
            for c in branches(standing[j])
            if not self.apart(standing, i, b, j, c)
        }
        rest = set(branches(standing[j])) - {c for _, c in meets}
        if rest:
            standing[j] = on(standing[j], rest)
            return
        chosen = branches(standing[j])[0]
        standing[j] = on(standing[j], {chosen})
        standing[i] = {(b, flip) for b, flip in standing[i] if (b, chosen) not in meets}

    def pairs_of_limbs(self):
        """Pairs of limbs that hold, in cyclic order from the limb that moves on."""
        limbs = self.plain.spec.limbs
        held = [(self.limb + k) % limbs for k in range(1, limbs)]
        return list(combinations(held, 2))

    def check(self, released=None):
        """The edge, `NO_EDGE` if the step fails.

        Args:
            released: What `PlainChecks.release` says of each limb at both stances; None if
                collisions are not looked at.
        """
        if released is None:
            standing = self.alone(collisions=False)
            return NO_EDGE if standing is None else Edge(standing, -1)
        first, last = (released[s][self.limb] for s in (self.before, self.after))
        standing = self.alone() if first.pairs and last.pairs else None
        if standing is None:
            return NO_EDGE
        for i, j in self.pairs_of_limbs():
            self.both_apart(standing, i, j)
            if not standing[i] or not standing[j]:
                return NO_EDGE
        total = {i: set() for i in self.held}
        for pair, swing in self.swings(first, last):
            kept = self.beside(standing, swing)
            if kept:
                total = {i: total[i] | kept[i] for i in self.held}
                # Of one support alone each pair has a swing of its own.
                if len(self.held) > 1 or total == standing:
                    return Edge(total, pair)
        return Edge(total, -1) if all(total.values()) else NO_EDGE

    def swings(self, first, last):
        """Branches of a line, -1 for a fold, and joint angles at both ends, in order."""
        folds = [(-1, [self.plain.folds[k]] * 2) for k in sorted(first.folds & last.folds)]
        lines = swing_lines(self.plain, self.limb, (self.before, self.after), first, last)
        return folds + [(8 * b0 + b1, line) for b0, b1, *line in lines]

    def most(self, released=None):
        """Pairs on which limbs may hold beside some swing; see `check`.

        What two limbs are close to is looked at in first middles alone, and each needs a pair that
        is clear of some of the other's.
        """
        none = {i: set() for i in self.held}
        if released is None:
            return self.alone(collisions=False) or none
        first, last = (released[s][self.limb] for s in (self.before, self.after))
        standing = self.alone() if first.pairs and last.pairs else None
        found = none
        for _, swing in self.swings(first, last) if standing else ():
            kept = self.beside(standing, swing, whole=False)
            kept = kept and self.some_apart(kept)
            if kept:
                found = {i: found[i] | kept[i] for i in self.held}
        return found

    def some_apart(self, standing):
        """One limb after the other gives up what meets all that is left of another; or None."""
        left, apart = dict(standing), partial(self.apart, standing, whole=False)
        for i in self.held:
            for j in self.held:
                if i != j:
                    others = branches(left[j])
                    free = {b for b in branches(left[i]) if any(apart(i, b, j, c) for c in others)}
                    left[i] = on(left[i], free)
        return left if all(left.values()) else None


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
