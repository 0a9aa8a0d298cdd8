"""Measure a mission with bags of different masses: picked up, carried and stowed by three limbs.

    python experiments/cargo_mission.py [--out results] [--workers 2]

Each mission is carried out in MuJoCo at two paces. Writes `cargo_mission.json` and
`cargo_mission.md`.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from reports import CORES, experiment, study_rows, table

from mlivr_gym import jem_map, stance_graph
from mlivr_gym.extensions.cargo import plan_cargo_mission
from mlivr_gym.motion import JointPath
from mlivr_gym.robot import Cargo
from mlivr_gym.simulation import PACES, Recording, compile_spec, scene_spec

START, PICK, STOW = ("F3b:3", "F4a:2", "D3b:0"), "D2b:3", "F3b:6"
"""Points held at the start, and those on which the bag stands and shall stand."""

PARTS = ("walk", "pick up", "fold", "carry", "stow")
"""Parts of a mission."""

MASSES, SIZE = (1.0, 10.0, 30.0, 100.0), 0.2
"""Masses [kg] and edge [m] of the bags."""


def missions(task: int, mass: float) -> dict[str, Any]:
    """Return limb, steps, times [s] and loads of the mission at each pace."""
    graph = stance_graph(robot="mlivr3")
    mission = plan_cargo_mission(graph, START, PICK, STOW, Cargo(mass, SIZE))
    row: dict[str, Any] = {"limb": mission.limb, "steps": [len(p.steps) for p in mission.plans]}
    for pace in ("fast", "gentle"):
        parts = mission.execute(PACES[pace])
        moved = zip(("pick up", "fold", "stow"), mission.motions, strict=True)
        row[pace] = {
            "times": dict.fromkeys(PARTS, 0.0)
            | {name: float(part.recording.times[-1]) for name, part in parts.items()},
            "force": max(float(part.peaks.grasp_force.max()) for part in parts.values()),
            "torque": max(float(part.peaks.grasp_torque.max()) for part in parts.values()),
            "miss": max(
                miss(one.path, parts[name].recording) for name, one in moved if name in parts
            ),
            "failed": any(part.failure is not None for part in parts.values()),
        }
    return row


def miss(path: JointPath, recording: Recording) -> float:
    """Return how far the gripper is from where the path of its limb ends [m]."""
    model = compile_spec(scene_spec(jem_map(), path.robot))
    data, places, planned = mujoco.MjData(model), [], path.samples(2)
    ends = planned.base_positions[-1], planned.base_quaternions[-1], planned.joint_positions[-1]
    for position, quaternion, joints in (ends, recording.configuration(-1)):
        data.qpos[:] = np.concatenate([position, quaternion, joints.ravel()])
        mujoco.mj_kinematics(model, data)
        places.append(data.site(f"limb{path.limb}/grasp").xpos.copy())
    return float(np.linalg.norm(places[0] - places[1]))


def measured(workers: int) -> dict[str, Any]:
    """Return the missions with each mass."""
    return {"rows": study_rows("cargo_mission:missions", 1, workers, mass=MASSES)}


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    done = [row[pace] for row in data["rows"] for pace in ("fast", "gentle")]
    cells = []
    for row in data["rows"]:
        times = row["fast"]["times"]
        cells.append(
            [
                f"{row['mass']:g}", row["limb"], *row["steps"],
                *(f"{times[part]:.1f}" for part in PARTS),
                *(f"{sum(row[pace]['times'].values()):.1f}" for pace in ("fast", "gentle")),
                *(f"{row[pace]['force']:.0f}" for pace in ("fast", "gentle")),
                *(f"{row[pace]['torque']:.0f}" for pace in ("fast", "gentle")),
            ]
        )  # fmt: skip
    head = (
        "bag [kg] | limb | steps to it | steps with it | walk [s] | pick up [s] | fold [s] | carry "
        "[s] | stow [s] | all [s] | gentle: all [s] | peak grasp force [N] | gentle: force [N] | "
        "peak grasp torque [N m] | gentle: torque [N m]"
    )
    planned, force = PACES["fast"].grasp_force, max(row["fast"]["force"] for row in data["rows"])
    failed, miss = sum(one["failed"] for one in done), max(one["miss"] for one in done)
    return f"""# Cargo missions

Made by `experiments/cargo_mission.py`: `mlivr3` walks from {", ".join(START)} to a bag of \
{SIZE:g} m that stands on {PICK}, picks it up with the limb
that the plan chooses, carries it and stows it on {STOW}, in MuJoCo without disturbances. \
{failed} of {len(done)} missions failed; the gripper
misses its place by at most {1e3 * miss:.2f} mm. The fast pace is planned with {planned:g} N at \
a grasp, of which the compliant grasps
make up to {force:.0f} N. [How to carry cargo](../docs/how-to/cargo.md).

{table(head, cells)}"""


if __name__ == "__main__":
    experiment("cargo_mission", __doc__, measured, markdown, workers=CORES)
