"""What the callables of the API reference are called with where they are called right."""

import dataclasses
import inspect
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from public_api import parameters
from things import MAKERS

from mlivr_gym import robot_spec
from mlivr_gym.robot.limb_dynamics import LimbDynamics

QUICK_TRAINING = {"rounds": 1, "layouts": 1, "goals": 1, "rollouts": 1, "updates": 1}


def seen(env):
    """What a policy is asked with."""
    observation = env.reset(seed=0)[0]
    return {"env": env, "observation": observation, "mask": env.action_masks()}


SPECIAL = {
    "Cost.custom": lambda of: {"base_weight": 1.0},
    "PlanPolicy": lambda of: {"find": lambda env: None},
    "baseline_policy": lambda of: {"method": "local"},
    "policy_by_name": lambda of: {"name": "random"},
    "evaluate": lambda of: {"episodes": 1, "max_steps": 2},
    "freeze_test_set": lambda of: {
        "path": "set.json",
        "seed": 0,
        "sizes": dict.fromkeys(("same", "half", "dense", "occupied"), 0),
    },
    "beam_search": lambda of: {"width": 2, "max_steps": 2},
    "save_policy": lambda of: {
        "path": "policy",
        "actor_critic": of["LearnedPolicy"].actor_critic,
        "config": {},
    },
    "load_policy": lambda of: {"path": "pretrained"},
    "unknown_things": lambda of: {"boxes": 0, "plates": 0},
    "LookingPolicy.act": lambda of: seen(of["UnknownMapEnv"]),
    "ReplanningPolicy.act": lambda of: seen(of["ClosedLoopEnv"]),
    "MlivrVectorEnv.step": lambda of: {"actions": [0, 0]},
    "sample_task": lambda of: {"min_distance": 0.2},
    "Trajectory.every": lambda of: {"period": 0.5},
    "configuration_figure": lambda of: {"title": "a figure"},
    "LimbDynamics": lambda of: {
        field.name: getattr(of["RobotSpec"].dynamics_of(0), field.name)
        for field in dataclasses.fields(LimbDynamics)
    },
    "made_for": lambda of: {"network": "pointer"},
    "train": lambda of: {
        "method": "bc",
        "env": of["MlivrEnv"],
        "hyperparameters": {"imitation": QUICK_TRAINING, "networks": {}},
    },
    "write_dataset": lambda of: {
        "dataset_id": "mlivr/jem/expert-v0",
        "episodes": 1,
        "env_arguments": {"map": of.map},
    },
    "write_lerobot_dataset": lambda of: {
        "folder": "lerobot",
        "episodes": 1,
        "env_arguments": {"map": of.map},
    },
    "load_dataset": lambda of: {"dataset_id": "mlivr/jem/expert-v0"},
    "load_hyperparameters": lambda of: {"method": "bc"},
    "MlivrEnv": lambda of: {"map": of.map},
    "ClosedLoopEnv": lambda of: {"map": of.map},
    "UnknownMapEnv": lambda of: {"map": of.map},
    "UnseenEnv": lambda of: {
        "training": [("mlivr2", of.map)],
        "held_out": [("mlivr2", of.map)],
    },
    "MlivrVectorEnv": lambda of: {"num_envs": 2, "env": of["MlivrEnv"]},
    "StanceGraphEnv": lambda of: {"size": (32, 16)},
    "stance_graph": lambda of: {"grasp_map": of.map, "settings": of.settings},
    "after_failure": lambda of: {"failed": [(0, 2)]},
    "reach_without": lambda of: {"joint": 1, "goals": [[3.0, 0.0, 0.0]]},
    "RobotSpec.with_failed_joint": lambda of: {"joint": 5, "angle": 0.3},
    "SceneRenderer": lambda of: {"robot": robot_spec("mlivr2-ur10e"), "width": 32, "height": 16},
    "film": lambda of: {"path": "walk.gif", "size": (32, 16), "speed": 1000.0},
    "film_pictures": lambda of: {"shots": [of["Shot"]], "size": (32, 16)},
    "save_film": lambda of: {"pictures": [np.zeros((16, 32, 3), np.uint8)], "path": "walk.gif"},
    "run_study": lambda of: {"folder": "study", "engine": ThreadPoolExecutor(1)},
    "RecordVideo": lambda of: {"video_folder": "films"},
    "read_study": lambda of: {"folder": of.file("study")},
    "Camera.seeing": lambda of: {"aspect": 2.0},
    "closed_loop_film": lambda of: {"path": "walk.gif", "size": (32, 16), "speed": 1000.0},
    "find_walk": lambda of: {"method": "random", "start": of["State"], "max_steps": 3},
    "RobotSpec.from_dict": lambda of: {"data": of["RobotSpec"].to_dict()},
    "RobotSpec.load": lambda of: {"path": of.file("robot.json")},
    "RobotSpec.from_urdf": lambda of: {"path": of.file("robot.urdf")},
    "RobotSpec.from_mjcf": lambda of: {"path": of.file("robot.xml")},
    "read_robot": lambda of: {"path": of.file("robot.urdf")},
    "carrying_robot": lambda of: {"robot": of["three-limb graph"].robot},
    "limits": lambda of: {"frequencies": np.array([1.0, 2.0])},
    "plan_cargo_mission": lambda of: {
        "graph": of["three-limb graph"],
        "start": of["three limbs"].stance,
        "pick": of.free[0],
        "stow": of.free[1],
        "limbs": [0],
    },
    "Belief": lambda of: {"noise": 0.003},
    "Belief.add_hits": lambda of: {"hits": []},
    "Belief.is_blocked": lambda of: {"sample": 0},
    "Successors.take": lambda of: {"kept": np.array([0])},
    "StudyDesign.from_data": lambda of: {"data": {"kind": "plan"}},
    "StudyDesign.from_file": lambda of: {"path": of.file("study.toml")},
    "GraspMap.subset": lambda of: {"keep": np.ones(len(of.map), bool)},
    "GraspMap.load": lambda of: {"path": of.file("map.json")},
    "GraspMap.from_csv": lambda of: {"path": of.file("points.csv")},
    "GraspMap.from_mesh": lambda of: {"path": of.file("mesh.obj"), "points": POINTS},
    "GraspMap.from_dict": lambda of: {"data": of.map.to_dict()},
    "Plan.load": lambda of: {"path": of.file("plan.json"), "grasp_map": of.map},
    "Plan.from_dict": lambda of: {"data": of["whole plan"].to_dict(), "grasp_map": of.map},
    "walk_figure": lambda of: {"plans": [(of["Plan"], 1)]},
    "load_test_set": lambda of: {"path": of.file("set.json")},
    "load_obstacles": lambda of: {"path": of.file("boxes.json")},
    "mesh_boxes": lambda of: {"path": of.file("mesh.obj")},
    "Box.between": lambda of: {
        "id": "b",
        "kind": "obstacle",
        "low": (0.0, 0.0, 0.0),
        "high": (1.0, 1.0, 1.0),
    },
    "Box.from_dict": lambda of: {"data": of["Box"].to_dict()},
    "point_cloud_boxes": lambda of: {"points": [[0.0, 0.0, 0.0]]},
    "capsule_box": lambda of: {"name": "b", "start": (0.0, 0.0, 0.0), "end": (1.0, 0.0, 0.0)},
    "StanceGraph.add_obstacles": lambda of: {"boxes": [of["Box"]]},
    "StanceGraph.postures_of": lambda of: {"states": [of["State"]]},
}
"""Arguments of some callables; those without a default value have others beside them."""

POINTS = [
    {"id": "P", "face": "deck", "position": [0, 0, 0], "normal": [0, 0, 1], "rail": [1, 0, 0]}
]


NAMED = {
    "start": lambda of: of.query["start"],
    "goal": lambda of: of.query["goal"],
    "stance": lambda of: of["State"].stance,
    "stances": lambda of: np.array([of["State"].stance]),
    "point": lambda of: of["State"].stance[0],
    "rotations": lambda of: np.eye(3)[None],
    "w_m": lambda of: 0.1,
    "limb": lambda of: 0,
    "limbs": lambda of: 2,
    "index": lambda of: 0,
    "k": lambda of: 0,
    "taken": lambda of: 0,
    "tolerance": lambda of: 0.2,
    "goal_tolerance": lambda of: 0.2,
    "path": lambda of: "written",
    "mask": lambda of: of["MlivrEnv"].action_masks(),
    "position": lambda of: of["Plan"].configuration(0)[0],
    "quaternion": lambda of: of["Plan"].configuration(0)[1],
    "joints": lambda of: of["Plan"].configuration(0)[2],
    "configuration": lambda of: of["Plan"].configuration(0),
    "configurations": lambda of: [of["Plan"].configuration(0)],
    "points": lambda of: of["Plan"].stances[0],
    "positions": lambda of: np.zeros((2, 3)),
    "name": lambda of: "ur5e",
    "radius": lambda of: 0.1,
    "seed": lambda of: 0,
    "width": lambda of: 32,
    "cost": lambda of: "base",
    "episodes": lambda of: 1,
    "total": lambda of: 10.0,
    "action": lambda of: int(np.flatnonzero(of["MlivrEnv"].action_masks())[0]),
    "time": lambda of: 0.0,
    "after": lambda of: of["StanceGraph"].neighbouring_nodes(of["State"].stance)[0][0],
}


def typed(things, annotation):
    """The names of classes in an annotation of which there is an instance."""
    return [name for name in re.findall(r"\w+", str(annotation)) if name in MAKERS]


def good(things, title, function):
    """The arguments with which a callable is called right: those without a default, and some."""
    given = dict(SPECIAL.get(title, lambda of: {})(things))
    for name, one in parameters(function).items():
        if name in given or one.default is not one.empty:
            continue
        found = typed(things, one.annotation)
        if title in MAKERS and name in dir(things[title]):
            given[name] = getattr(things[title], name)
        elif found:
            given[name] = things[found[0]]
        elif name in NAMED:
            given[name] = NAMED[name](things)
        else:
            raise LookupError(f"{title}: add {name} to the tables of {Path(__file__).name}")
    return given


def bound(things, title, function):
    """A callable, that of a method on an instance."""
    kind, _, name = title.partition(".")
    if not name or inspect.ismethod(function):
        return function
    return getattr(things["seven joints" if name == "with_failed_joint" else kind], name)
