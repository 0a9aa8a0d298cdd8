"""Measure what cargo costs: steps, time and force of one query, for bags of different masses.

    python experiments/cargo.py [--out results] [--workers 2]

Bags of the same size lie on the body of the two-limb robot; each plan is carried out in MuJoCo at
two paces. Writes `cargo.json`, `cargo.md` and the film `cargo.gif`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from reports import CORES, GOAL, START, experiment, study_rows, table

from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.film import film
from mlivr_gym.planners import Planner
from mlivr_gym.robot.cargo import Cargo, carrying
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.limits import PACES
from mlivr_gym.simulation.station_load import station_load
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph

MASSES = (0.0, 1.0, 10.0, 30.0, 100.0)
"""Masses of the bags [kg]; 0 for no bag."""

FILMED = 30.0
"""Mass of the bag in the film [kg]."""

SIZE = (0.4, 0.4, 0.3)
"""Edges of each bag [m]."""


def planned(mass: float) -> tuple[StanceGraph, Plan]:
    """Return the graph of the robot with a bag, and its plan."""
    robot = carrying(robot_spec("mlivr2"), Cargo(mass, SIZE) if mass else None)
    graph = stance_graph(robot=robot)
    return graph, Planner(graph).plan(START, GOAL, "steps").unwrap()


def walks(task: int, mass: float) -> dict[str, Any]:
    """Return stances, steps and translation [m] with a bag, and the walk at each pace."""
    graph, plan = planned(mass)
    row: dict[str, Any] = {
        "stances": len(graph), "steps": len(plan.steps), "translation": plan.base_translation,
    }  # fmt: skip
    for pace in ("fast", "gentle"):
        walked = execute(graph, plan, PACES[pace])
        peaks = walked.peaks
        row[pace] = {
            "time": walked.simulated_time,
            "force": float(station_load(walked.recording).peak_forces.max()),
            "grasp_torque": float(np.max(peaks.grasp_torque)),
            "base_error": float(peaks.base_error),
            "failed": walked.failure is not None,
        }
    return row


def measured(workers: int) -> dict[str, Any]:
    """Return the walks with each mass."""
    return {"rows": study_rows("cargo:walks", 1, workers, mass=MASSES)}


def masses(data: dict[str, Any]) -> str:
    """Return the table of masses against steps, time and loads."""
    cells = []
    for row in data["rows"]:
        cells.append(
            [
                f"{row['mass']:g}" if row["mass"] else "no bag", f"{row['stances']:,}",
                row["steps"], f"{row['translation']:.2f}",
                *(
                    f"{row[pace][name]:.{digits}f}"
                    for pace in ("fast", "gentle")
                    for name, digits in (("time", 1), ("force", 1), ("grasp_torque", 1))
                ),
            ]
        )  # fmt: skip
    head = (
        "cargo [kg] | stances | steps | base translation [m] | time [s] | peak force [N] | "
        "peak grasp torque [N m] | gentle: time [s] | peak force [N] | peak grasp torque [N m]"
    )
    return table(head, cells)


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    walks = [row[pace] for row in data["rows"] for pace in ("fast", "gentle")]
    failed, error = sum(w["failed"] for w in walks), max(w["base_error"] for w in walks)
    size = " by ".join(f"{edge:g}" for edge in SIZE)
    return f"""# Cargo

Made by `experiments/cargo.py`: bags of {size} m on the body of `mlivr2`, plans of the fewest \
steps from {" and ".join(START)} to {GOAL}, carried out in
MuJoCo at the paces `fast` and `gentle` without disturbances. {failed} of {len(walks)} walks \
failed; the base error is at most {1e3 * error:.1f} mm. *Peak force* is that on the
station. The limbs must keep clear of the bag, whatever its mass, which the row of 1 kg shows; the \
mass then makes the walk slower within the
same limits of torque and grasp force. [How to carry cargo](../docs/how-to/cargo.md).

{masses(data)}"""


def moving_picture(data: dict[str, Any], path: Path) -> None:
    """Film the walk with `FILMED` kilograms."""
    graph, plan = planned(FILMED)
    walked, path = execute(graph, plan).recording, path.with_suffix(".gif")
    film(graph.grasp_map, graph.robot, walked, path, plan=plan, size=(480, 270), speed=8.0)


if __name__ == "__main__":
    experiment("cargo", __doc__, measured, markdown, moving_picture, workers=CORES)
