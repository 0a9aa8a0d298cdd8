"""Replay a walk with MuJoCo alone, from a model in MJCF and a trajectory in CSV.

The first half writes the two files, as `mlivr-gym render --mjcf` and `mlivr-gym simulate` do. The
second half reads them without this package, as another simulator or controller would.
"""

import csv
from pathlib import Path

import mujoco
import numpy as np

from mlivr_gym import stance_graph
from mlivr_gym.motion import save_csv
from mlivr_gym.planners import Planner
from mlivr_gym.simulation import exported_model, plan_trajectory

graph = stance_graph()
plan = Planner(graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps").unwrap()
save_csv(plan_trajectory(graph, plan, period=0.1), "walk.csv")
points = graph.indices(plan.stances[0])
model = exported_model(graph.grasp_map, graph.robot, plan.configuration(0), points)
Path("scene.xml").write_text(model)

# From here on only MuJoCo is used.
model = mujoco.MjModel.from_xml_path("scene.xml")
data = mujoco.MjData(model)
with open("walk.csv") as stream:
    rows = list(csv.DictReader(stream))
joints = [name for name in rows[0] if name.endswith("/position_rad")]
places = [model.joint(name.removesuffix("/position_rad")).qposadr[0] for name in joints]
base = model.joint("base").qposadr[0]

deepest, farthest = 0.0, 0.0
for row in rows:
    data.qpos[base : base + 3] = [float(row[f"base_{axis}_m"]) for axis in "xyz"]
    data.qpos[base + 3 : base + 7] = [float(row[f"base_q{axis}"]) for axis in "wxyz"]
    data.qpos[places] = [float(row[name]) for name in joints]
    mujoco.mj_forward(model, data)
    if data.ncon:
        deepest = min(deepest, float(data.contact.dist.min()))
    for limb in (0, 1):
        if row[f"limb{limb}/grasp"]:
            held = data.site(f"point/{row[f'limb{limb}/grasp']}").xpos
            off = np.linalg.norm(data.site(f"limb{limb}/grasp").xpos - held)
            farthest = max(farthest, float(off))
print(f"{len(rows)} configurations, {float(rows[-1]['time_s']):.1f} s")
print(f"deepest penetration {1e3 * -deepest:.3f} mm, grippers at most {1e3 * farthest:.3f} mm off")
