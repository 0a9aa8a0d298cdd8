"""Draw the figure of `docs/inside.md`: which module computes what, from a stance to an edge.

    python experiments/inside_figure.py

Writes `docs/inside.png` and `docs/inside.svg`.
"""

from __future__ import annotations

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from reports import ROOT

from mlivr_gym.pictures.figures import write_figure

OUT = ROOT / "docs" / "inside.png"

STAGES = (
    ("stance", "points of the limbs", "stances/two_limb_graph.py"),
    ("posture", "base pose, branches\nand their w_m, w_b", "postures/selection.py"),
    ("certificate", "branches on which support\nlimbs can follow it", "kinematics/holding.py"),
    ("release", "branches on which limbs\ncan be released, folds", "transitions/release.py"),
    ("step", "motions of the moving\nlimb, supporting limbs", "transitions/steps.py"),
    ("edge", "branches kept, path, swing", "stances/two_limb_edges.py"),
)
"""Stages in order: name, result, and the module that computes it."""

RECORDS = (
    "points",
    "StanceGeometry -> Posture",
    "BasePath",
    "ReleaseRecord",
    "StepRecord, SweptMotion",
    "TwoLimbEdge",
)
"""Records that each stage passes on."""


def main() -> None:
    """Draw the figure."""
    figure = Figure(figsize=(13.6, 2.8), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.005, 0.01, 0.99, 0.98))
    for k, ((name, result, place), record) in enumerate(zip(STAGES, RECORDS, strict=True)):
        axes.add_patch(
            Rectangle((2.6 * k, 0.0), 2.2, 1.5, facecolor="#e8f0f8", edgecolor="#1f77b4")
        )
        axes.text(2.6 * k + 1.1, 1.22, name, ha="center", fontsize=12, weight="bold")
        axes.text(2.6 * k + 1.1, 0.72, result, ha="center", va="center", fontsize=7.5)
        axes.text(2.6 * k + 1.1, 0.14, place, ha="center", fontsize=7, family="monospace")
        axes.text(2.6 * k + 1.1, -0.25, record, ha="center", fontsize=8, color="#555555")
        if k:
            axes.annotate(
                "", (2.6 * k, 0.75), (2.6 * k - 0.4, 0.75), arrowprops={"arrowstyle": "-|>"}
            )
    axes.add_patch(Rectangle((7.8, 1.95), 7.4, 0.75, facecolor="#fff3e0", edgecolor="#ff7f0e"))
    axes.text(
        11.5, 2.32,
        "collisions/sweep.py: is a whole motion clear?  intervals, shapes in their middle,\n"
        "distances against what the shapes can move, halves where that does not decide",
        ha="center", va="center", fontsize=8.5,
    )  # fmt: skip
    for x in (8.9, 11.5):
        axes.annotate("", (x, 1.95), (x, 1.5), arrowprops={"arrowstyle": "<|-|>"})
    axes.text(-0.1, -0.25, "records:", ha="right", fontsize=8, color="#555555")
    axes.set_xlim(-1.0, 15.4)
    axes.set_ylim(-0.5, 2.9)
    axes.axis("off")
    write_figure(figure, OUT)


if __name__ == "__main__":
    main()
