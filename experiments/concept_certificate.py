"""Draw the certificate of `docs/concepts.md`: proved lower bounds of `w_m` along a base path.

    python experiments/concept_certificate.py

The bounds of `kinematics/certificate.py` are computed here a second time in plain NumPy, with
sampled instead of bounded travel in each interval. Writes `docs/figures/certificate.png` and
`.svg`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from concept_figures import GOAL, OUT, START, manipulability
from matplotlib.figure import Figure
from reports import two_limb_graph

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.base_path import base_poses
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.pictures.figures import write_figure
from mlivr_gym.planners import Planner
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

STEP = 1
"""Index of the step of the plan that is drawn."""

DEEPEST = 8
"""Maximum number of bisections of an interval."""

SAMPLES = 41
"""Samples of the motion within an interval."""


class Interval(NamedTuple):
    """An interval of the base path with its lower bound of `w_m`."""

    first: float
    last: float
    bound: float
    """Lower bound of `w_m` on the whole interval; 0 if none is proved."""


class Holding(NamedTuple):
    """A support limb that holds its point while the base follows its path."""

    graph: TwoLimbGraph
    path: RegraspPath
    limb: int
    flange: tuple[Array, Array]
    """Position [m] and axis of the flange in the module frame."""

    def wrist_and_axis(self, s: Array) -> tuple[Array, Array]:
        """Return wrist position and flange axis in the frame of the limb's mount, each (k, 3)."""
        robot, (position, axis) = self.graph.robot, self.flange
        places, rotations = base_poses(self.path.regrasp.base_path, s)
        mount = robot.mount_rotations[self.limb]
        wrist = np.einsum("kji,kj->ki", rotations, position - robot.limb.d6 * axis - places)
        direction = np.einsum("kji,j->ki", rotations, axis)
        return (wrist - robot.mount_positions[self.limb]) @ mount, direction @ mount

    def w_m(self, s: Array) -> Array:
        """Return the limb manipulability by its definition at path parameters, shape (k,)."""
        joints = self.path.supports(s)[:, self.limb]
        return np.array([manipulability(self.graph, q) for q in joints])

    def bound(self, first: float, last: float, shoulder: int) -> float:
        """Return the lower bound of `w_m` between two path parameters."""
        arm, scale = self.graph.robot.limb, self.graph.robot.characteristic_length**3
        middle = 0.5 * (first + last)
        wrist, axis = self.wrist_and_axis(np.append(np.linspace(first, last, SAMPLES), middle))
        d = np.linalg.norm(wrist - wrist[-1], axis=1).max()
        a = np.arccos(np.clip(axis @ axis[-1], -1.0, 1.0)).max()
        x, y = wrist[-1, :2]
        rho = np.hypot(x, y)
        u = np.sqrt(rho * rho - arm.d4**2) * (-1.0 if shoulder else 1.0)
        c1, s1 = (u * x - arm.d4 * y) / rho**2, (u * y + arm.d4 * x) / rho**2
        s5 = np.hypot(c1 * axis[-1, 0] + s1 * axis[-1, 1], axis[-1, 2])
        elbow = np.linalg.norm(self.forearm(middle))
        lowest_u = np.sqrt(max((rho - d) ** 2 - arm.d4**2, 0.0)) if rho > d else 0.0
        if not lowest_u:
            return 0.0
        turned = a + d / lowest_u
        if s5 <= turned:
            return 0.0
        change = d + abs(arm.d4) * d / lowest_u + abs(arm.d5) * turned / (s5 - turned)
        ends = np.array([max(elbow - change, 0.0), elbow + change]) ** 2
        cosines = (ends - arm.a2**2 - arm.a3**2) / (2.0 * arm.a2 * arm.a3)
        s3 = np.sqrt(max(1.0 - (cosines**2).max(), 0.0))
        return float(abs(arm.a2 * arm.a3) * lowest_u * (s5 - turned) * s3 / scale)

    def forearm(self, s: float) -> Array:
        """Return the vector from the shoulder to the end of the forearm, shape (2,) [m]."""
        arm, q = self.graph.robot.limb, self.path.supports(np.array([s]))[0, self.limb]
        upper, lower = q[1], q[1] + q[2]
        ends: Array = arm.a2 * np.array([np.cos(upper), np.sin(upper)])
        return ends + arm.a3 * np.array([np.cos(lower), np.sin(lower)])

    def intervals(self, shoulder: int, floor: float) -> list[Interval]:
        """Return the intervals into which the path is bisected until each bound is decided."""
        undecided, decided = [(0.0, 1.0, 0)], []
        while undecided:
            first, last, depth = undecided.pop()
            bound = self.bound(first, last, shoulder)
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
    regrasp, floor = planned_regrasp(graph, plan, STEP), graph.settings.path_floor
    limb = 1 - regrasp.limb
    pose = graph.solver.grasps[regrasp.before[limb]]["flange"]
    flange = np.array(pose["position"]), np.array(pose["rotation"])[:, 2]
    holding = Holding(graph, RegraspPath(graph, regrasp), limb, flange)
    intervals = holding.intervals(regrasp.branches[limb] // 4, floor)
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
    figure.suptitle(
        f"The certificate: {len(intervals)} intervals prove that $w_m$ of the supporting "
        "limb stays above its floor", x=0.02, ha="left", fontsize=11,
    )  # fmt: skip
    write_figure(figure, OUT / "certificate.png")


if __name__ == "__main__":
    main()
