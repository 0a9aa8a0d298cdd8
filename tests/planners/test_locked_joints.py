"""Plans of robots from URDF whose arms have joint 3 or 6 locked: a Gen3 and a Franka."""

import numpy as np
import pinocchio as pin
import pytest
from held_points import assert_held
from robot_texts import FRANKA, GEN3, one_arm

from mlivr_gym import RobotSpec, Settings, stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner
from mlivr_gym.robot.limb import link_frames

HELD = {
    "franka": (FRANKA, {"locked_joint": "joint6", "locked_angle": 1.8}),
    "gen3": (GEN3, {"locked_joint": "joint3", "locked_angle": 0.3}),
}
HEIGHTS = {"franka": (0.4, 0.46, 0.52), "gen3": (0.55, 0.6, 0.65)}


@pytest.mark.parametrize("name", HELD)
def test_every_stance_of_a_plan_is_held_as_pinocchio_has_the_arm(tmp_path, jem, name):
    """Seven joints of the file bring the tool to the point, the held one at its angle."""
    some = jem.subset(np.arange(len(jem)) % 3 == 0, "some")
    frames, held = HELD[name]
    text, path = one_arm(frames=frames, seed=2), tmp_path / "arm.urdf"
    path.write_text(text)
    options = {**held, "capsules": "ur5e", "heights": HEIGHTS[name]}
    robot = RobotSpec.from_urdf(path, **options)
    graph = stance_graph(some, robot, Settings(collisions=False, limb_threshold=0.03))
    start, goal = sample_task(graph, np.random.default_rng(0), 1.0)
    plan = Planner(graph).plan(start.stance, goal, "steps").unwrap()
    model = pin.buildModelFromXML(text)
    data, tool = model.createData(), model.getFrameId("tool0")

    def flange(angles):
        """Return the flange by Pinocchio, from angles of the robot's joints."""
        theirs = np.insert(angles, int(held["locked_joint"][-1]) - 1, held["locked_angle"])
        pin.framesForwardKinematics(model, data, theirs)
        return data.oMf[tool].homogeneous.copy()

    def ours(angles):
        return link_frames(robot.limb, angles)[-1]

    there = np.linspace(-1.0, 1.0, 6)
    to_base = ours(there) @ np.linalg.inv(flange(there))
    assert len(plan.stances) > 1
    for stance in plan.stances:
        here = graph.configuration(graph.state(stance))
        assert_held(robot, some, stance, here, lambda q: to_base @ flange(q))
