"""Film of a cargo mission: the bag where it stands, in the gripper, and where it is stowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.closed_loop.cargo_mission import BAG, CargoMission, MissionPart
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.pictures.film import (
    DEFAULT_SIZE,
    FILM,
    SPEED,
    check_film_format,
    film_pictures,
    film_samples,
    save_film,
)
from mlivr_gym.pictures.rendering import Shot
from mlivr_gym.pictures.scene_shapes import add_box
from mlivr_gym.robot.cargo import LockedLimb
from mlivr_gym.schema import ListOf
from mlivr_gym.values import as_triple
from mlivr_gym.world.boxes import Box

IN_GRIPPER = "fold", "carry", "stow"
"""Parts of a mission in which the gripper holds the bag."""


@checked(
    {
        **FILM,
        "mission": InstanceOf(CargoMission),
        "parts": ListOf(InstanceOf(MissionPart), 1),
        "speed": SPEED,
    }
)
def mission_film(
    mission: CargoMission,
    parts: Sequence[MissionPart],
    path: str | Path,
    *,
    size: tuple[int, int] = DEFAULT_SIZE,
    speed: float = 8.0,
) -> None:
    """Film a mission that was carried out, all parts one after the other; see `film.film`.

    `parts` are what `mission.execute` returned.
    """
    check_film_format(path)
    graph, obstacles = mission.graphs[0], mission.graphs[1].obstacles
    standing = next(box for box in mission.plans[0].world.obstacles if box.id == BAG)
    ends = np.cumsum([part.recording.times[-1] for part in parts])
    shots = []
    for part, begin in zip(parts, [0.0, *ends], strict=False):
        for k in film_samples(part.recording, speed).tolist():
            time, here = begin + part.recording.times[k], _configuration(mission, part, k)
            bag = held_bag(mission, here) if part.name in IN_GRIPPER else standing
            text = f"{time:.0f} s of {ends[-1]:.0f} s (x{speed:g}): {part.name}"
            line = f"{text}, limb {mission.limb}"
            shots.append(Shot(here, (line,), draw=partial(add_box, box=bag)))
    save_film(film_pictures(graph.grasp_map, graph.robot, shots, size, obstacles), path)


def _configuration(mission: CargoMission, part: MissionPart, k: int) -> Configuration:
    """Return the configuration of the whole robot in a sample of a part."""
    position, quaternion, joints = part.recording.configuration(k)
    if part.name == "carry":
        joints = np.insert(joints, mission.limb, mission.motions[1][-1], axis=0)
    return position, quaternion, joints


def held_bag(mission: CargoMission, here: Configuration) -> Box:
    """Return the bag in the gripper that carries it."""
    robot, (position, quaternion, joints) = mission.graphs[0].robot, here
    dynamics = robot.dynamics_of(mission.limb)
    mount = replace(robot.mounted[mission.limb], dynamics=dynamics)
    locked = LockedLimb(mount, tuple(joints[mission.limb].tolist()))
    frame = replace(mission.cargo, limb=locked).frame_on(robot.body_edges, robot.tool_length)
    turn = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    half = as_triple(0.5 * mission.cargo.edges)
    return Box(
        BAG, "obstacle", as_triple(position + turn @ frame[:3, 3]), half,
        Box.rows(turn @ frame[:3, :3]),
    )  # fmt: skip
