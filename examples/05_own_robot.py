"""Plan with robots of your own: one with longer arms, and one with three limbs."""

import dataclasses

from mlivr_gym import Limb, RobotSpec, stance_graph
from mlivr_gym.planners import Planner

# Lengths of the UR10e in the standard DH convention [m]; the capsules of the UR5e are stretched.
arm = Limb(d1=0.1807, a2=-0.6127, a3=-0.57155, d4=0.17415, d5=0.11985, d6=0.11655)
long_arms = RobotSpec(name="long arms", limb=arm, heights=(0.8, 0.9, 1.0, 1.1), span=3.2)

graph = stance_graph(robot=long_arms)
print(f"{long_arms.name}: {len(graph)} stances")
plan = Planner(graph).plan(("D2a:4", "D2b:4"), (4.6, 0.0, -0.1), "steps").unwrap()
print(plan)

# With more than two limbs the first plan that is found is returned.
three = dataclasses.replace(RobotSpec(), name="three limbs", limbs=3)
graph = stance_graph(robot=three)
result = Planner(graph).plan(
    ("D2a:2", "D2b:2", "D2b:6"), (3.1, 0.0, -0.4), "weighted", regrasp_price=0.1
)
print(f"{three.name}: {result.message}")
