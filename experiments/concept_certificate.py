"""Draw the certificate of `docs/concepts.md`: proved lower bounds of `w_m` along a base path.

    python experiments/concept_certificate.py

The lower bound of an interval is the highest floor that `kinematics/certificate.py` proves for it.
Writes `docs/figures/certificate.svg`, which is shown, and `.png`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from concept_figures import OUT, manipulability
from matplotlib.figure import Figure
from mlivr_gym.motion.base_paths import path_of, support_joints
from numba import njit
from reports import GOAL, START, two_limb_graph

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.base_path import BasePath, pose_on_path, travel_seen, turn_seen
from mlivr_gym.kinematics.families import branch_terms, stays_above
from mlivr_gym.kinematics.limb import MountedArm, flange_seen
from mlivr_gym.kinematics.poses import Pose, along, columns, vector
from mlivr_gym.motion.commitment import edges_along
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.planners import Planner
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

STEP = 1
"""Index of the step of the plan that is drawn."""

DEEPEST = 8
"""Maximum number of bisections of an interval."""

FLOORS = np.linspace(0.0, 0.2, 2001)
"""Floors of `w_m` that are tried, in ascending order."""


class Interval(NamedTuple):
    """An interval of the base path with its lower bound of `w_m`."""

    first: float
    last: float
    bound: float
    """Lower bound of `w_m` on the whole interval; 0 if none is proved."""


@njit(error_model="numpy")
def count_proved(
    limb: MountedArm,
    flange: Pose,
    path: BasePath,
    interval: tuple[float, float],
    choice: int,
    squares: Array,
    scratch: tuple[Pose, Array],
) -> int:
    """Return how many of some floors, as in `stays_above`, are proved of a class of branches.

    The interval is given by its middle and half its length.
    """
    (middle, half), (base, terms) = interval, scratch
    _, _, axis = columns(flange.rotation)
    wrist = along(vector(flange.position), -limb.arm.d6, axis)
    pose_on_path(path, middle, base)
    seen, _ = flange_seen(limb, base, flange)
    branch_terms(limb.arm, seen, terms)
    motion = travel_seen(path, base, middle, half, wrist), turn_seen(path, base, half, axis)
    count = 0
    for square in squares:
        if terms[choice, 3] >= square and stays_above(limb.arm, terms, choice, motion, square):
            count += 1
    return count


class Holding(NamedTuple):
    """A support limb that holds its point while the base follows its path."""

    graph: TwoLimbGraph
    ends: StepEnds
    path: BasePath
    limb: int

    def w_m(self, s: Array) -> Array:
        """Return the limb manipulability by its definition at path parameters, shape (k,)."""
        joints = support_joints(self.graph, self.ends, self.path, s)[:, self.limb]
        return np.array([manipulability(self.graph, q) for q in joints])

    def bound(self, first: float, last: float) -> float:
        """Return the highest floor that is proved between two path parameters; 0 if none is."""
        graph, ends = self.graph, self.ends
        limb: Any = graph.solver.shapes.robot["limbs"][self.limb]
        floors = FLOORS[1:] * graph.robot.characteristic_length**3 / limb["arm"]["links"]
        flange = graph.solver.grasps[ends.before[self.limb]]["flange"]
        interval = 0.5 * (first + last), 0.5 * (last - first)
        choice, scratch = ends.branches[self.limb] // 2, (Pose.row(), np.zeros((4, 4)))
        proved = count_proved(limb, flange, self.path, interval, choice, floors**2, scratch)
        return float(FLOORS[proved])

    def intervals(self, floor: float) -> list[Interval]:
        """Return the intervals into which the path is bisected until each bound is decided."""
        undecided, decided = [(0.0, 1.0, 0)], []
        while undecided:
            first, last, depth = undecided.pop()
            bound = self.bound(first, last)
            if bound >= floor or depth == DEEPEST:
                decided.append(Interval(first, last, bound))
            else:
                middle = 0.5 * (first + last)
                undecided += [(middle, last, depth + 1), (first, middle, depth + 1)]
        return decided


def main() -> None:
    """Draw the figure."""
    graph = two_limb_graph()
    plan = Planner(graph).plan(START, GOAL, "steps").unwrap()
    ends, floor = StepEnds.of(graph, plan.motion, STEP), graph.settings.path_floor
    limb, kind = 1 - ends.limb, edges_along(graph, plan.motion)[STEP].path_kind
    holding = Holding(graph, ends, path_of(graph, ends, kind), limb)
    intervals = holding.intervals(floor)
    s = np.linspace(0.0, 1.0, 400)
    figure = Figure(figsize=(10.4, 3.8), dpi=110, layout="constrained")
    axes = figure.subplots()
    axes.plot(s, holding.w_m(s), color=LIMB_COLOURS[limb], lw=2.0, label=f"$w_m$ of limb {limb}")
    for k, (first, last, bound) in enumerate(intervals):
        label = "lower bound proved for an interval" if k == 0 else None
        axes.fill_between([first, last], 0.0, bound, color="#9fc79a", ec="white", label=label)
    axes.axhline(floor, color="0.2", ls="--", label=f"floor, {floor:g}")
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, None), xlabel="s along the base path", ylabel="$w_m$")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)
    title = f"The certificate: {len(intervals)} intervals prove that $w_m$ of the supporting limb"
    figure.suptitle(f"{title} stays above its floor", x=0.02, ha="left", fontsize=11)
    save_figure(figure, OUT / "certificate.png")


if __name__ == "__main__":
    main()
