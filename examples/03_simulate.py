"""Carry a plan out in MuJoCo, with torque limits, compliant grasps and contacts."""

from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.simulation import execute

graph = stance_graph()
plan = Planner(graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps").unwrap()

execution = execute(graph, plan, progress=lambda done: print(f"{done} steps carried out"))

for capture in execution.captures:
    print(
        f"{capture.time:6.1f} s: limb {capture.limb} grasped {capture.point}, "
        f"position error {1e3 * capture.distance:.2f} mm"
    )
if execution.failure is not None:
    print("failed:", execution.failure.message)
peaks = execution.peaks
print(f"joint torque at most {peaks.joint_torque.max():.1f} N m")
print(f"grasp force at most {peaks.grasp_force.max():.1f} N")
print(f"base position error at most {1e3 * peaks.base_error:.2f} mm")
execution.save("simulation.npz")
