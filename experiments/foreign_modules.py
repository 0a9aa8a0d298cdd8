"""Try modules that others published: a table of handrails, and a mesh whose tracks are found in it.

    curl -LO https://github.com/danielpmorton/pyastrobee/raw/43c9c844/pyastrobee/assets/meshes/\
iss/obj/eu_lab/eu_lab.obj
    python experiments/foreign_modules.py --mesh eu_lab.obj

The table has the handrails of a world of Robonaut 2 in the US Lab (Chunting/r2_planning, BSD), the
mesh is Columbus (NASA IGOAL; in danielpmorton/pyastrobee, MIT, from nasa/astrobee_media). Each goes
the way of the page "Bring your own module": a file, a map, a plan, a walk in MuJoCo. Writes
`foreign_modules.json` and `foreign_modules.md`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from reports import experiment, table
from us_lab import BAR, handrails

from mlivr_gym import GraspMap, stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.execution import execute
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

SPACING = 0.2
"""Distance of points along a rail [m]."""

TRACK = 1.692, 0.03
"""Length of the seat tracks in the mesh, and more than their width [m]."""

BESIDE = 0.08
"""Parts of the mesh that are within this distance of a track are taken for its own body [m]."""

RESOLUTION = 0.02
"""Edge of the cubes that cover the mesh [m]."""

DRAWS = 60
"""Pairs of stances that are drawn; the longest plan that is found is carried out."""


def handrail_table() -> str:
    """Return the points of the published handrails as a CSV table."""
    rows = ["id,x,y,z,nx,ny,nz,rx,ry,rz,face"]
    for bar in handrails()[0]:
        start, end = np.array(bar["start"]), np.array(bar["end"])
        along = (end - start) / BAR
        for k in range(5):
            place = 0.5 * (start + end) + (k - 2) * SPACING * along
            figures = [f"{value:.5f}" for value in (*place, *bar["normal"], *along.round(4))]
            rows.append(",".join([f"{bar['id']}:{k}", *figures, bar["id"].split("_")[0]]))
    return "\n".join(rows) + "\n"


def tracks_of(parts: list[Any]) -> list[dict[str, Any]]:
    """Return the seat tracks among the connected parts of a mesh along x, as segments."""
    found = []
    for part in parts:
        (low, high), size = part.bounds, np.ptp(part.bounds, axis=0)
        along = int(size.argmax())
        others = np.delete(size, along)
        if (
            along == 0
            or abs(size[along] - TRACK[0]) > 0.01
            or not (0.02 < others.min() <= others.max() < TRACK[1])
        ):
            continue
        across, middle = 3 - along, 0.5 * (low + high)
        normal, half = np.zeros(3), np.zeros(3)
        normal[across], half[along] = -np.sign(middle[across]), 0.5 * size[along]
        middle[across] = (low, high)[int(normal[across] > 0)][across]
        found.append(
            {
                "id": f"T{len(found)}", "face": f"{'xyz'[across]}{'-+'[int(normal[across] < 0)]}",
                "start": (middle - half).tolist(), "end": (middle + half).tolist(),
                "normal": normal.tolist(),
            }
        )  # fmt: skip
    return found


def without(parts: list[Any], tracks: list[dict[str, Any]]) -> Any:
    """Return the mesh of the parts that are not near one of the tracks, whose bodies they are."""
    ends = np.array([[track["start"], track["end"]] for track in tracks])
    low, high = ends.min(axis=1) - BESIDE, ends.max(axis=1) + BESIDE
    rest = [
        part
        for part in parts
        if not ((part.bounds[0] >= low) & (part.bounds[1] <= high)).all(axis=1).any()
    ]
    return trimesh.util.concatenate(rest)


def walked(world: GraspMap) -> dict[str, Any]:
    """Return the figures of a map, and of a plan on it that is carried out."""
    graph = stance_graph(world)
    assert isinstance(graph, TwoLimbGraph)
    planner, rng, plans = Planner(graph), np.random.default_rng(0), []
    for a, b in rng.integers(len(graph), size=(DRAWS, 2)):
        goal = graph.postures(graph.points[b][None]).base_position[0]
        if (goal <= world.cabin[0]).any() or (goal >= world.cabin[1]).any():
            continue
        start = graph.state(graph.points[a].tolist())
        plans.append(planner.plan(start, goal, "steps", limit=5000).plan)
    plan = max((one for one in plans if one is not None), key=lambda one: one.base_translation)
    walk = execute(graph, plan)
    return {
        "points": len(world),
        "boxes": len(world.boxes),
        "stances": len(graph),
        "plans": f"{sum(one is not None for one in plans)} of {len(plans)}",
        "steps": len(plan.steps),
        "metres": plan.base_translation,
        "failure": walk.failure and walk.failure.message,
        "grasp_force": float(np.max(walk.peaks.grasp_force)),
    }


def measured(mesh: str) -> dict[str, Any]:
    """Return the figures of both modules."""
    with tempfile.TemporaryDirectory() as folder:
        csv, stl = Path(folder, "handrails.csv"), Path(folder, "columbus.stl")
        csv.write_text(handrail_table())
        first = walked(GraspMap.load(csv))
        whole: Any = trimesh.load(mesh, force="mesh", process=False)
        whole.merge_vertices(merge_tex=True, merge_norm=True)
        parts = list(whole.split(only_watertight=False))
        tracks = tracks_of(parts)
        without(parts, tracks).export(stl)
        world = GraspMap.from_mesh(stl, resolution=RESOLUTION, segments=tracks, spacing=SPACING)
    return {"handrails": first, "mesh": walked(world) | {"tracks": len(tracks)}}


def markdown(data: dict[str, Any]) -> str:
    """Return the report."""
    titles = {
        "handrails": "US Lab, handrails of Robonaut 2's world, as a table",
        "mesh": "Columbus, mesh of NASA's IGOAL",
    }
    rows = [
        (
            titles[name], row["points"], row["boxes"], f"{row['stances']:,}", row["plans"],
            row["steps"], f"{row['metres']:.1f}", row["failure"] or "carried out",
            f"{row['grasp_force']:.0f}",
        )
        for name, row in data.items()
    ]  # fmt: skip
    head = (
        "module | points | boxes | stances | plans found | steps of the longest | its base "
        "translation [m] | in MuJoCo | largest grasp force [N]"
    )
    return f"""# Modules that others published

[Bring your own module](../docs/how-to/own-module.md) was followed with two modules whose
figures nobody of this project made: the 14 handrails that Chunting/r2_planning (BSD) publishes of
the US Lab, as a CSV table, and NASA's mesh of Columbus (danielpmorton/pyastrobee, MIT, commit
43c9c844; NASA media usage guidelines). Robots of two UR5e start and end in drawn stances; the
longest plan is carried out.

{table(head, rows)}
The table was a map as it is. It has no walls, so its plans keep clear of the robot and of nothing
else. The mesh is a drawing, with tracks and their screws as bodies: with these, the cubes that
cover the mesh stood in front of each point, at each resolution tried down to 0.02 m, and no stance
was left. {data["mesh"]["tracks"]} seat tracks
were therefore found among its connected parts by their size, given as segments, and left out of the
mesh with everything within {BESIDE} m of them; the rest was covered with cubes of {RESOLUTION} m.

`experiments/foreign_modules.py` makes this page; the mesh is not part of the package.
"""


if __name__ == "__main__":
    experiment("foreign_modules", __doc__, measured, markdown, mesh="eu_lab.obj")
