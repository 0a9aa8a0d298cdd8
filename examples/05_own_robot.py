"""Robots of your own: longer arms, three of them, and one from a file."""

import dataclasses

from mlivr_gym import Limb, RobotSpec, robot_spec, stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.robot import frames_of_dh, ur_dh

# The UR10e by its DH table [m]; its shapes are simple ones along the links.
table = ur_dh(d1=0.1807, a2=-0.6127, a3=-0.57155, d4=0.17415, d5=0.11985, d6=0.11655)
arm = Limb(*frames_of_dh(table))
long_arms = RobotSpec(name="long arms", limb=arm, heights=(0.8, 0.9, 1.0, 1.1), span=3.2)

graph = stance_graph(robot=long_arms)
print(f"{long_arms.name}: {len(graph)} stances")
plan = Planner(graph).plan(("D2a:4", "D2b:4"), (4.6, 0.0, -0.1), "steps").unwrap()
print(plan)

# More than two limbs: nothing is worked out beforehand, the search is inflated.
three = dataclasses.replace(RobotSpec(), name="three limbs", limbs=3)
graph = stance_graph(robot=three)
result = Planner(graph).plan(
    ("D2a:2", "D2b:2", "D2b:6"), (3.1, 0.0, -0.4), "weighted", regrasp_price=0.1
)
print(f"{three.name}: {result.message}")

# A robot from a file: here JSON that the package writes; your own URDF or MJCF serves as well.
RobotSpec(name="two arms", body_size=0.3, mount_radius=0.15).save("two_arms.json")
described = robot_spec("two_arms.json")
length, masses = described.limb.arm_length, described.dynamics_source
print(f"{described.name}: arms of {length:.3f} m, masses {masses}")
graph = stance_graph(robot=described)
result = Planner(graph).plan(("D2a:4", "D2b:4"), (3.5, 0.0, -0.1), "steps")
print(f"{described.name}: {result.message}")
