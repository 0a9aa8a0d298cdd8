"""Plan a walk, print its steps, refine it, and draw it."""

from mlivr_gym import stance_graph
from mlivr_gym.pictures import plan_figure
from mlivr_gym.planners import Planner

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)

graph = stance_graph()  # measured JEM, two UR5e limbs, thresholds and collisions
planner = Planner(graph)
for cost in ("base", "steps"):
    plan = planner.plan(START, GOAL, cost).unwrap()
    print(f"least {cost}: {len(plan.steps)} steps, {plan.base_translation:.3f} m")

for number, step in enumerate(plan.steps, 1):
    print(
        f"{number}. limb {step.limb}: {step.from_point} -> {step.to_point}, "
        f"base {step.displacement:.3f} m, swing {step.swing}"
    )

better = planner.refined(plan)  # the same footholds, other base poses
print(f"refined: {better.base_translation:.3f} m")

better.save("plan.json")
plan_figure(graph.grasp_map, better, "plan.png")
