"""Exported walks of arms that are read from files, against Pinocchio on these files.

The arms have the axes, signs and zeros of their makers' descriptions, as ssik knows them.
"""

import csv
import json

import numpy as np
import pinocchio as pin
import pytest
import yaml
from robot_texts import written
from ssik import Manipulator
from ssik_arms import mjcf_of

from mlivr_gym import RobotSpec, Settings, jem_map, stance_graph
from mlivr_gym.errors import PlanError
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.motion.trajectory_files import save_csv, save_npz, save_ros
from mlivr_gym.planners import Planner
from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.simulation.timing import plan_trajectory

ARMS = {
    "irb120": {}, "m0609": {}, "crx10ia": {},
    "iiwa14": {"locked_joint": "joint3", "locked_angle": 0.5},
    "fr3": {"locked_joint": "joint6", "locked_angle": 1.8, "heights": (0.4, 0.46, 0.52)},
    "gen3": {"locked_joint": "joint3", "locked_angle": 0.3, "heights": (0.55, 0.6, 0.65)},
}  # fmt: skip
"""Arms of six makers by their names in ssik, with what is given besides the file.

The axes of m0609 are only nearly parallel or at right angles; crx10ia has no closed form here.
"""


def poses(positions, quaternions):
    """Homogeneous transforms of positions and quaternions w, x, y, z."""
    each = zip(np.array(positions), np.array(quaternions), strict=True)
    return np.array([pin.SE3(pin.Quaternion(*q), p).homogeneous for p, q in each])


class Original:
    """Pinocchio's model of the file of one arm, of which one joint may be locked."""

    def __init__(self, path, held):
        self.model = pin.buildModelFromMJCF(path)
        self.rest = {held.get("locked_joint"): held.get("locked_angle")}
        self.data, self.tool = self.model.createData(), self.model.getFrameId("tool0")

    def tool_at(self, angles):
        """Where the tool frame is at angles by the names of joints."""
        q = np.zeros(self.model.nq)
        for joint in range(1, self.model.njoints):
            name, at = self.model.names[joint], self.model.joints[joint].idx_q
            q[at] = angles[name] if name in angles else self.rest[name]
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.tool].homogeneous.copy()


def walk_of(robot, steps=2):
    """A plan of a few steps in a corner of the JEM, and its trajectory."""
    jem, found = jem_map(), []
    some = jem.positions[[jem.index(point) for point in ("A2a:0", "A3a:5", "D2a:2", "F3a:1")]]
    near = np.linalg.norm(jem.positions[:, None] - some, axis=2).min(axis=1) < 0.7
    graph = stance_graph(jem.subset(near), robot, Settings(limb_threshold=0.03))
    nodes = graph.nodes(graph.pairs)
    rows = np.flatnonzero(graph.is_node(nodes))
    for row in np.random.default_rng(0).permutation(rows):
        stance, here = tuple(graph.pairs[row].tolist()), nodes.base_position[row]
        if not graph.successors(graph.state(stance)):
            continue
        away = np.linalg.norm(nodes.base_position[rows] - here, axis=1)
        goal = nodes.base_position[rows][np.argsort(away)[len(away) // 2]]
        try:
            found.append(Planner(graph).plan(graph.ids(stance), tuple(goal), "steps").unwrap())
        except PlanError:
            continue
        if len(found[-1].steps) >= steps:
            break
    plan = max(found, key=lambda one: len(one.steps))
    assert len(plan.steps) >= steps
    return graph, plan, plan_trajectory(graph, plan, Durations(), period=0.5)


def from_csv(walk, folder):
    save_csv(walk, folder / "walk.csv")
    with open(folder / "walk.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    end = "/position_rad"
    names = [column.removesuffix(end) for column in rows[0] if column.endswith(end)]
    return names, np.array([[float(row[name + end]) for name in names] for row in rows])


def from_npz(walk, folder):
    save_npz(walk, folder / "walk.npz")
    with np.load(folder / "walk.npz") as data:
        return data["joint_names"].tolist(), data["joint_positions"].reshape(len(walk.times), -1)


def from_ros(walk, folder):
    save_ros(walk, folder / "walk.yaml")
    message = yaml.load((folder / "walk.yaml").read_text(), yaml.CSafeLoader)
    return message["joint_names"], np.array([one["positions"] for one in message["points"]])


def check_grasps(original, file, robot, told, base, held_points):
    """Each supporting tool stays at its point, at one place in the frame of the tool.

    `told` are names of joints and their angles; `base` are the poses of the body; `held_points`
    has the position of the point that each limb holds, NaN for none.
    """
    names, angles = told
    places = [[] for _ in range(robot.limbs)]
    for i in range(robot.limbs):
        mount = np.eye(4)
        mount[:3, :3], mount[:3, 3] = robot.mount_rotations[i], robot.mount_positions[i]
        foot = mount @ np.linalg.inv(file.file_limbs[i].mount)
        for k in np.flatnonzero(np.isfinite(held_points[:, i, 0])):
            mine = {name.removeprefix(f"limb{i}/"): angle
                    for name, angle in zip(names, angles[k], strict=True)
                    if name.startswith(f"limb{i}/")}  # fmt: skip
            tool = base[k] @ foot @ original.tool_at(mine)
            places[i].append(np.linalg.solve(tool, [*held_points[k, i], 1.0])[:3])
    every = np.concatenate(places)
    assert len(every) > len(angles)
    assert np.abs(np.linalg.norm(every, axis=1) - robot.tool_length).max() < 1e-4
    return float(np.linalg.norm(every - every[0], axis=1).max())


@pytest.mark.parametrize("name", ARMS)
def test_walks_of_public_arms_hold_their_points(name, tmp_path):
    given, path = ARMS[name], written(tmp_path, mjcf_of(Manipulator.from_prebuilt(name)), "arm.xml")
    robot = RobotSpec.from_urdf(path, capsules="ur5e", apart=[("base", "upper_arm")], **given)
    file, original = read_robot(path, **given), Original(path, given)
    graph, plan, walk = walk_of(robot)
    base = poses(walk.base_positions, walk.base_quaternions)
    held_points = np.where(
        (walk.grasps == FREE)[..., None], np.nan, graph.grasp_map.positions[walk.grasps]
    )
    for read in (from_csv, from_npz, from_ros):
        told = read(walk, tmp_path)
        assert check_grasps(original, file, robot, told, base, held_points) < 1e-9
    data = json.loads(json.dumps(plan.to_dict()))
    motion, names = data["motion"], [name for limb in robot.named_joints for name in limb]
    angles = np.array(motion["joint_positions"])
    at = [[graph.grasp_map.index(point) for point in stance] for stance in motion["stances"]]
    assert check_grasps(
        original, file, robot, (names, angles.reshape(len(angles), -1)),
        poses(motion["base_positions"], motion["base_quaternions"]), graph.grasp_map.positions[at],
    ) < 1e-9  # fmt: skip
