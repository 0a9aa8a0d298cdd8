"""Plan, carry out and draw robots of arms from a public package of descriptions.

    pip download --no-deps example-robot-data==6.0.0
    unzip -d descriptions example_robot_data-*.whl
    python experiments/public_arms.py descriptions/cmeel.prefix/share

Two UR3, UR5, UR10 and Franka Panda, the latter with joint 6 held, on a cube, between two drawn
stances of the JEM, with collisions checked and capsules along the links. Base and upper arm of the
UR5 are not compared: the UR5e's base is larger. The Panda's joint limits leave few postures
above the default threshold of `w_m`, and its base stands lower. Writes
`public_arms.json`, whose table `readme.py` shows in the docs, and `public_arms.png`: each robot by
its visual meshes in the first, a middle and the last stance.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from reports import CORES, command_line, figures_of, keep, study_rows, table
from robots import shot

from mlivr_gym import RobotSpec, Settings, stance_graph
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.figures import save_image
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation.execution import execute
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

ARMS: dict[str, tuple[str, float, dict[str, Any]]] = {
    "UR3": ("ur_description/urdf/ur3_robot.urdf", 0.1, {"capsules": "ur5e"}),
    "UR5": (
        "ur_description/urdf/ur5_robot.urdf", 0.1,
        {"capsules": "ur5e", "apart": [("base", "upper_arm")]},
    ),
    "UR10": (
        "ur_description/urdf/ur10_robot.urdf", 0.1,
        {"tool_frame": "tool0", "body_size": 0.3, "mount_radius": 0.2, "capsules": "ur5e"},
    ),
    "Franka Panda": (
        "panda_description/urdf/panda.urdf", 0.03,
        {"tool_frame": "panda_hand_tcp", "held_joint": "panda_joint6", "held_angle": 1.8,
         "body_size": 0.2, "heights": (0.4, 0.44, 0.48, 0.52), "capsules": "ur5e"},
    ),
}  # fmt: skip
"""File in the package, threshold of `w_m`, and arguments of `RobotSpec.from_urdf`."""

DRAWS = 60
"""Pairs of stances that are drawn until a plan of `STEPS` steps is found."""

STEPS = (2, 3, 4)
"""Numbers of steps of the walk."""

OVERHEAD = 0.2
"""Height from which a base hangs from the overhead [m]."""

SIZE = (420, 340)
"""Width and height of one picture [px]."""


def walk_of(graph: TwoLimbGraph) -> Plan:
    """Return a plan of a few steps between drawn stances."""
    planner, rng = Planner(graph), np.random.default_rng(0)
    for a, b in rng.integers(len(graph), size=(DRAWS, 2)):
        goal = graph.postures(graph.points[b][None]).base_position[0]
        plan = planner.plan(graph.state(graph.points[a].tolist()), goal, "steps").plan
        if plan is not None and len(plan.steps) in STEPS:
            return plan
    raise SystemExit(f"none of {DRAWS} pairs of stances is {STEPS} steps apart")


def pictures(name: str, graph: TwoLimbGraph, plan: Plan) -> list[Any]:
    """Return the robot in three stances of a plan."""
    out = []
    for k in (0, len(plan.steps) // 2, len(plan.steps)):
        shown = graph.configuration(graph.state(plan.stances[k]))
        x, y, z = shown[0].tolist()
        # From below where the robot hangs from the overhead, whose edge would hide it.
        elevation = -15.0 if z < OVERHEAD else 20.0
        camera = Camera((x, y, z), distance=2.6, azimuth=70.0, elevation=elevation)
        out.append(shot(graph, shown, camera, f"{name}, step {k} of {len(plan.steps)}", SIZE))
    return out


def measured(task: int, share: str) -> dict[str, Any]:
    """Return what is measured of a robot, and its pictures side by side as bytes."""
    name = list(ARMS)[task]
    file, threshold, options = ARMS[name]
    path = Path(share, "example-robot-data", "robots", file)
    robot = RobotSpec.from_urdf(path, package_dirs=[share], name=name, **options)
    graph = stance_graph(robot=robot, settings=Settings(limb_threshold=threshold))
    assert isinstance(graph, TwoLimbGraph)
    plan = walk_of(graph)
    done = execute(graph, plan)
    return {
        "file": file, "options": ", ".join(f"{key}={value!r}" for key, value in options.items()),
        "threshold": threshold,
        "stances": len(graph), "steps": len(plan.steps), "walked": done.failure is None,
        "walk_s": done.simulated_time,
        "capture_m": max(capture.distance for capture in done.captures),
        "picture": np.hstack(pictures(name, graph, plan)).tobytes(),
    }  # fmt: skip


def markdown(data: dict[str, Any]) -> str:
    """Return the table for the page on robots."""
    head = (
        "arms | file of example-robot-data 6.0.0 | options | least w_m | stances | steps | "
        "duration of the walk [s] | largest error of a capture [mm]"
    )
    return table(head, (
        (name, f"`{row['file']}`", f"`{row['options']}`", f"{row['threshold']:g}",
         f"{row['stances']:,}", row["steps"], f"{row['walk_s']:.0f}" if row["walked"] else "fails",
         f"{1e3 * row['capture_m']:.1f}")
        for name, row in data.items()
    ))  # fmt: skip


def main() -> None:
    """Measure and write the results."""
    parser = command_line(__doc__, workers=CORES)
    parser.add_argument("share", type=Path, help="folder that holds example-robot-data/")
    args = parser.parse_args()
    share = [str(args.share.resolve())]
    rows = study_rows("public_arms:measured", len(ARMS), args.workers, share=share)
    shots = [np.frombuffer(row.pop("picture"), dtype=np.uint8) for row in rows]
    save_image(np.vstack(shots).reshape(-1, 3 * SIZE[0], 3), args.out / "public_arms.png")
    data = {name: figures_of(row, "share") for name, row in zip(ARMS, rows, strict=True)}
    keep(args.out, "public_arms", data)
    print(markdown(data))


if __name__ == "__main__":
    main()
