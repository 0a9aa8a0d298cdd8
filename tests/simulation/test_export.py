"""The exported model, loaded and run by MuJoCo alone."""

import mujoco
import numpy as np
import pytest

from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory_files import save_npz
from mlivr_gym.simulation.export import exported_model
from mlivr_gym.simulation.timing import step_trajectory


@pytest.fixture(scope="module")
def files(checked_graph, plan, tmp_path_factory):
    """The model of a plan's start and the trajectory of its first step, as files."""
    folder = tmp_path_factory.mktemp("export")
    world, points = plan.world, checked_graph.indices(plan.stances[0])
    model = exported_model(
        checked_graph.grasp_map, world.robot, plan.configuration(0), points, world.obstacles
    )
    (folder / "model.xml").write_text(model)
    walk = step_trajectory(checked_graph, plan, 0, Durations())
    save_npz(walk, folder / "walk.npz")
    return folder


def test_a_plan_is_replayed_by_mujoco_alone(files, checked_graph, plan):
    """PD control written out here; nothing of the package but the two files is used."""
    model = mujoco.MjModel.from_xml_path(str(files / "model.xml"))
    walk = np.load(files / "walk.npz")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    motors = [model.actuator(name).id for name in walk["joint_names"]]
    free = int(np.flatnonzero(walk["grasps"][1] == -1)[0])
    model.opt.disableactuator |= 2 << free  # the group of that limb's grasp
    # The gripper may touch what lies behind the points that it leaves and takes hold of.
    gripper = model.body(f"limb{free}/gripper").id
    model.geom_conaffinity[model.geom_bodyid == gripper] = 0
    model.geom_contype[model.geom_bodyid == gripper] = 0
    reference = walk["joint_positions"].reshape(len(walk["times"]), -1)
    speeds = walk["joint_velocities"].reshape(len(walk["times"]), -1)
    assert model.opt.timestep == pytest.approx(walk["times"][1])
    for k in range(len(walk["times"]) - 1):
        error, rate = reference[k] - data.qpos[7:], speeds[k] - data.qvel[6:]
        data.ctrl[motors] = 100.0 * error + 50.0 * rate
        mujoco.mj_step(model, data)
        assert data.sensor("contact").data[0] == 0
    target = model.site(f"point/{plan.steps[0].to_point}").pos
    assert np.linalg.norm(data.site(f"limb{free}/grasp").xpos - target) < 0.01
    np.testing.assert_allclose(data.qpos[:3], walk["base_positions"][-1], atol=0.02)
