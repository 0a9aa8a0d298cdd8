"""The check of a step of two limbs on lines of its support, written to be read.

Whether one line is clear is asked of `intervals.check_line`, which is compared elsewhere; which
lines there are, and which holds an edge keeps, is said here with sets and loops.
"""

import numpy as np
from compiled import called
from joint_lines import line_scratch
from plain_checks import branches, members
from plain_steps import swing_lines

from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.intervals import check_line
from mlivr_gym.kinematics.limb import Angles, all_angles_at
from mlivr_gym.robot.link_frames import link_frames, rigid
from mlivr_gym.transitions.line_steps import ON_LINE, OTHER_FOLD, PLACES

TURN = 2.0 * np.pi


def in_window(angles, windows):
    """Joint angles in windows (6, 2), or None if one has no winding there."""
    low, high = windows.T
    wound = angles - TURN * np.floor((angles - low + 1e-6) / TURN)
    return wound if (wound <= high + 1e-6).all() else None


class PlainLineStep:
    """A step between two rows of `StanceArrays`, beside what `PlainChecks` knows of them."""

    def __init__(self, plain, limb, before, after):
        self.plain, self.limb, self.support = plain, limb, 1 - limb
        self.before, self.after = before, after

    def hold(self, s, branch, flip):
        """Joint angles of the support at a stance, None if it cannot hold so."""
        plain, out = self.plain, Angles.rows(8)
        flange = plain.grasp(s, self.support)["flange"]
        all_angles_at(plain.checks.robots, self.support, plain.stances.base[s], flange, out)
        q = out[branch]["q"] + np.array([0, 0, 0, 0, 0, np.pi * flip])
        windows = plain.robot["limbs"][self.support]["arm"]["window"]
        return in_window(q, windows) if np.isfinite(q).all() else None

    def line(self, branch, flip):
        """Joint angles of the support at both ends of its line (2, 6), None if there is no line."""
        ends = [self.hold(s, branch, flip) for s in (self.before, self.after)]
        return None if any(q is None for q in ends) else np.array(ends)

    def is_regular(self, line):
        """Whether `w_m` of the support is above the floor at some places of its line."""
        spec = self.plain.spec
        for k in range(PLACES):
            q = line[0] + (k + 0.5) / PLACES * (line[1] - line[0])
            frames, columns = link_frames(spec.every_limb[self.support], q), []
            flange = frames[6, :3, 3]
            for j in range(6):
                h = 1e-6 * np.eye(6)[j]
                ahead = link_frames(spec.every_limb[self.support], q + h)[6]
                turn = (ahead[:3, :3] @ frames[6, :3, :3].T - np.eye(3)) / 1e-6
                axis = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
                columns.append([*(ahead[:3, 3] - flange) / 1e-6, *axis])
            w_m = abs(np.linalg.det(columns)) / spec.characteristic_length**3
            if w_m < float(self.plain.limits["floor"]) * (1.0 + 1e-4):
                return False
        return True

    def is_clear(self, line, flip, swing, alone=False):
        """Whether the robot is clear on a line of its support beside a swing, (2, 6)."""
        plain, joints = self.plain, np.zeros((2, 2, 6))
        joints[:, self.support], joints[:, self.limb] = line, swing
        flange = plain.grasp(self.after, self.support)["flange"]
        turn = np.diag([-1.0, -1.0, 1.0]) if flip else np.eye(3)
        frame = rigid(flange["rotation"] @ turn, flange["position"])
        limbs = 1 << self.support if alone else 3
        scratch = line_scratch(
            joints, self.support, frame, boxes=limbs, holding=1 << self.support, base=True,
            itself=limbs, first=self.limb, second=-1 if alone else self.support,
        )  # fmt: skip
        boxes, clearance = plain.checks.solver.boxes, float(plain.limits["clearance"])
        return called(check_line)(plain.robot, boxes, clearance, scratch) == CLEAR

    def lines(self, first, last):
        """The lines that are tried, see `plain_steps.swing_lines`."""
        return swing_lines(self.plain, self.limb, (self.before, self.after), first, last)

    def check(self, wanted, first, last):
        """Kept pairs of branch and flip with the codes of their swings, and the branches of a line.

        Args:
            wanted: Pairs that the support may be on.
            first: What `PlainChecks.release` says of the limb that moves, before the step.
            last: The same after it.
        """
        kept, rest, shared = {}, [], -1
        if not first.pairs or not last.pairs:
            return kept, shared
        for branch, flip in sorted(wanted):
            line = self.line(branch, flip)
            if line is None or not self.is_regular(line):
                continue
            for fold in sorted(first.folds & last.folds):
                q = self.plain.folds[fold]
                if self.is_clear(line, flip, np.array([q, q])):
                    kept[branch, flip] = fold
                    break
            else:
                rest.append((branch, flip, line))
        for b0, b1, *swing in self.lines(first, last) if rest else ():
            served = [(b, f) for b, f, line in rest if self.is_clear(line, f, np.array(swing))]
            if served:
                kept |= dict.fromkeys(served, ON_LINE)
                shared = 8 * b0 + b1
                break
        return kept, shared


def codes_of(kept):
    """The code of each branch, of which flip 0 and 1 may have different ones."""
    out = {}
    for branch in branches(kept):
        both = {kept[pair] for pair in kept if pair[0] == branch}
        out[branch] = both.pop() if len(both) == 1 else OTHER_FOLD
    return out


__all__ = ["PlainLineStep", "codes_of", "members"]
