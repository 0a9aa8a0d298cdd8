"""What the callables of the API reference are called with where they are called right."""

import dataclasses
import inspect
import json
import re
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from importlib import import_module

import mujoco
import numpy as np
from plans import first_steps
from public_api import parameters

from mlivr_gym import (
    Box,
    MlivrError,
    Settings,
    jem_map,
    robot_spec,
    stance_graph,
)
from mlivr_gym.closed_loop.belief import Belief
from mlivr_gym.closed_loop.cargo_mission import CargoMission, MissionPart
from mlivr_gym.closed_loop.depth_camera import DepthCamera, Look
from mlivr_gym.closed_loop.loop import run_closed_loop
from mlivr_gym.closed_loop.record import Event, Footage
from mlivr_gym.closed_loop.ros_messages import point_cloud_message
from mlivr_gym.envs.closed_loop import ClosedLoopEnv
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.rewards import BaseReward, StepOutcome, TotalReward
from mlivr_gym.envs.task import Task
from mlivr_gym.envs.unknown_map import UnknownMapEnv
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.fastest import Candidate
from mlivr_gym.motion.path_segments import path_segments
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.rendering import SceneRenderer, Shot
from mlivr_gym.pictures.route import Route
from mlivr_gym.planners import Cost, Planner
from mlivr_gym.planners.additions import AddedPoints, MoreLimbs
from mlivr_gym.planners.algorithm1 import SearchTree
from mlivr_gym.planners.corridor import CorridorPlan
from mlivr_gym.planners.outcome import Improvement
from mlivr_gym.planners.reach import reach_from
from mlivr_gym.planners.smallest_change import Change
from mlivr_gym.planners.why_not import Cause
from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.robot.limb_dynamics import LimbDynamics
from mlivr_gym.robot.visuals import Visual
from mlivr_gym.schema import FieldPath
from mlivr_gym.simulation.disturbances import DisturbanceRanges, robot_body_ids
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.monte_carlo import execute_many
from mlivr_gym.simulation.recording import Failure
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.station_load import station_load
from mlivr_gym.simulation.timing import plan_trajectory
from mlivr_gym.stances.critical import Loss
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.studies import StudyDesign, run_study
from mlivr_gym.world.rails import Handrail


def mlivr(name):
    """A module of the package."""
    return import_module(f"mlivr_gym.{name}")


QUICK_TRAINING = {"rounds": 1, "layouts": 1, "goals": 1, "rollouts": 1, "updates": 1}


class Things:
    """One instance of each class of the reference, made when it is first asked for."""

    def __init__(self, grasp_map, folder):
        self.map, self.folder, self.made, self.graphs = grasp_map, folder, {}, {}
        self.settings = Settings()

    def __contains__(self, name):
        return name in MAKERS

    def __getitem__(self, name):
        if name not in self.made:
            self.made[name] = MAKERS[name](self)
        return self.made[name]

    @cached_property
    def agents(self):
        return mlivr("agents")

    @cached_property
    def joints(self):
        return self["Plan"].motion.joint_positions[0]

    @cached_property
    def query(self):
        """Start and goal."""
        graph, env = self["TwoLimbGraph"], self["MlivrEnv"]
        return {"start": graph.ids(env.state.stance), "goal": env.goal.tolist()}

    @cached_property
    def free(self):
        """The ids of two points that no limb of a robot of three holds at the start."""
        held = self["three limbs"].stance
        return [point for k, point in enumerate(self.map.ids) if k not in held][:2]

    def file(self, name):
        """The path of a file, which is written when it is first asked for."""
        path = self.folder / name
        if not path.exists():
            FILES[name](self, path)
        return path

    def graph_once(self, *given):
        """The stance graph of some arguments, made once."""
        key = given[0].fingerprint, *given[1:]
        self.graphs[key] = self.graphs.get(key) or stance_graph(*given)
        return self.graphs[key]

    def put_back(self):
        """Leave graphs and environments as they were."""
        for name in ("TwoLimbGraph", "ImplicitGraph"):
            graph = self.made.get(name)
            if graph is not None and (graph.obstacles or graph.occupied):
                graph.remove_obstacles()
                graph.vacate()


def environment(things, kind=MlivrEnv, **options):
    """An environment at the start of an episode, with a graph that others do not share."""
    things.graphs.clear()
    env = kind(map=things.map, **options)
    things.graphs.clear()
    env.reset(seed=0)
    return env


def drawn_route(things):
    return Route.of(things.map, things["Plan"])


def walked(things):
    """A walk in the closed loop that was filmed."""
    return run_closed_loop(things["TwoLimbGraph"], **things.query, max_steps=1, filmed=True)


def mission(things):
    knots = np.tile(things.joints[0], (2, 1))
    plan = things["Plan"]
    bag = Box.between("bag", "obstacle", (9.0, 9.0, 9.0), (9.1, 9.1, 9.1))
    plan = dataclasses.replace(plan, world=dataclasses.replace(plan.world, obstacles=(bag,)))
    return CargoMission(
        0, things["Cargo"], (things["TwoLimbGraph"],) * 2, (plan,) * 2, (knots,) * 3
    )


MAKERS = {
    "TwoLimbGraph": lambda of: stance_graph(of.map, settings=of.settings),
    "StanceGraph": lambda of: of["TwoLimbGraph"],
    "ImplicitGraph": lambda of: stance_graph(of.map, "mlivr3", of.settings),
    "GraspMap": lambda of: of.map,
    "RobotSpec": lambda of: of["TwoLimbGraph"].robot,
    "Settings": lambda of: of.settings,
    "MlivrEnv": lambda of: environment(of, render_mode="rgb_array", width=32, height=16),
    "Env": lambda of: of["MlivrEnv"],
    "StanceGraphEnv": lambda of: of["MlivrEnv"],
    "ClosedLoopEnv": lambda of: environment(of, ClosedLoopEnv),
    "UnknownMapEnv": lambda of: environment(of, UnknownMapEnv),
    "MlivrVectorEnv": lambda of: MlivrVectorEnv(2, env=MlivrEnv(map=of.map, precompute=True)),
    "ActionMaskObservation": lambda of: ActionMaskObservation(of["MlivrEnv"]),
    "PointObservation": lambda of: mlivr("agents.features").PointObservation(of["MlivrEnv"]),
    "Observation": lambda of: of["MlivrEnv"].reset(seed=0)[0],
    "State": lambda of: of["MlivrEnv"].state,
    "Successors": lambda of: of["TwoLimbGraph"].successors(of["State"]),
    "Task": lambda of: Task(of["State"], np.array(of.query["goal"])),
    "Generator": lambda of: np.random.default_rng(0),
    "Randomness": lambda of: of["Generator"],
    "Moves": lambda of: of["MlivrEnv"].moves,
    "Postures": lambda of: of["TwoLimbGraph"].posture(of["State"].stance),
    "LayoutTasks": lambda of: mlivr("envs.layout_tasks").LayoutTasks(),
    "WalkTasks": lambda of: mlivr("envs.tasks").WalkTasks(),
    "StepReward": lambda of: mlivr("envs.rewards").StepReward(),
    "BaseReward": lambda of: BaseReward(),
    "TotalReward": lambda of: TotalReward(BaseReward(), 1.0, False, 0.9, 0.2),
    "StepOutcome": lambda of: StepOutcome(0.1, 1.0, 0.9, False, True, 0.5),
    "RandomPolicy": lambda of: of.agents.RandomPolicy(),
    "Policy": lambda of: of.agents.RandomPolicy(),
    "ExpertPolicy": lambda of: of.agents.ExpertPolicy(),
    "LookingPolicy": lambda of: of.agents.LookingPolicy(of["RandomPolicy"]),
    "ReplanningPolicy": lambda of: of.agents.ReplanningPolicy(),
    "PlanPolicy": lambda of: of.agents.planner_policy(),
    "LearnedPolicy": lambda of: mlivr("agents.learned").load_policy("pretrained", of["MlivrEnv"]),
    "EvaluationTask": lambda of: of.agents.EvaluationTask(**of.query),
    "Evaluation": lambda of: of.agents.evaluate(of["MlivrEnv"], of["RandomPolicy"], 1, max_steps=2),
    "HeldOutWorld": lambda of: mlivr("agents.test_set").load_test_set()[0],
    "ImitationHyperparameters": lambda of: mlivr(
        "agents.hyperparameters"
    ).ImitationHyperparameters(),
    "Planner": lambda of: Planner(of["TwoLimbGraph"]),
    "PlanningResult": lambda of: of["Planner"].plan(**of.query),
    "whole plan": lambda of: of["PlanningResult"].unwrap(),
    "Plan": lambda of: first_steps(of["whole plan"], 1),
    "Query": lambda of: of["Plan"].query,
    "World": lambda of: of["Plan"].world,
    "Motion": lambda of: of["Plan"].motion,
    "Statistics": lambda of: of["Plan"].statistics,
    "Step": lambda of: of["Plan"].steps[0],
    "StepMotion": lambda of: step_motion(of["TwoLimbGraph"], of["Plan"], 0),
    "CorridorPlan": lambda of: CorridorPlan(of["PlanningResult"], of["TwoLimbGraph"], True),
    "Cost": lambda of: Cost.named("base"),
    "CostToGo": lambda of: of["Planner"].cost_to_go(of.query["goal"]),
    "Goal": lambda of: of["CostToGo"].goal,
    "Improvement": lambda of: Improvement(0.1, 1.0, 1.0),
    "Cause": lambda of: Cause((), "nothing"),
    "AddedPoints": lambda of: AddedPoints(("P",), ("P",), of.map, True),
    "MoreLimbs": lambda of: MoreLimbs("mlivr3", of.query["start"], "found"),
    "Change": lambda of: Change("points", ("P",), True),
    "Reach": lambda of: reach_from(of["TwoLimbGraph"], of.query["start"], 2),
    "SearchTree": lambda of: SearchTree(),
    "Trajectory": lambda of: plan_trajectory(of["TwoLimbGraph"], of["Plan"], period=0.1),
    "Durations": lambda of: Durations(),
    "segments": lambda of: path_segments(
        RegraspPath(of["TwoLimbGraph"], planned_regrasp(of["TwoLimbGraph"], of["Plan"], 0))
    ),
    "Camera": lambda of: Camera((0.0, 0.0, 0.0)),
    "Route": drawn_route,
    "Foothold": lambda of: of["Route"].footholds[0],
    "Shot": lambda of: Shot(of["Plan"].configuration(0)),
    "SceneRenderer": lambda of: SceneRenderer(of.map, robot_spec("mlivr2-ur10e"), 32, 16),
    "Cargo": lambda of: mlivr("robot.cargo").Cargo(1.0, 0.2),
    "Limb": lambda of: of["RobotSpec"].limb,
    "SphericalWristLimb": lambda of: robot_spec("mlivr2-iiwa").limb,
    "LimbDynamics": lambda of: of["RobotSpec"].dynamics_of(0),
    "Capsule": lambda of: of["RobotSpec"].shapes[0],
    "Visual": lambda of: Visual("upper_arm", "arm.obj"),
    "RobotFile": lambda of: read_robot(of.file("robot.urdf"), limbs=2),
    "Execution": lambda of: execute(of["TwoLimbGraph"], of["Plan"]),
    "Recording": lambda of: of["Execution"].recording,
    "Peaks": lambda of: of["Execution"].peaks,
    "Capture": lambda of: of["Execution"].captures[0],
    "Failure": lambda of: Failure("time", 1.0, 0, "swing", 0, "too long", {}),
    "ControllerParameters": lambda of: of["Execution"].controller,
    "Physics": lambda of: of["Execution"].physics,
    "Limits": lambda of: mlivr("simulation.limits").Limits(),
    "DisturbanceRanges": lambda of: DisturbanceRanges(),
    "Disturbance": lambda of: DisturbanceRanges().draw(
        0, len(robot_body_ids(of["MjModel"])), 2, len(of.map.ids)
    ),
    "Setup": lambda of: Setup(),
    "Simulation": lambda of: Setup().simulation(of.map, of["RobotSpec"]),
    "MjModel": lambda of: of["Simulation"].model,
    "MjData": lambda of: of["Simulation"].data,
    "StationLoad": lambda of: station_load(of["Recording"]),
    "RunOutcome": lambda of: next(
        iter(execute_many(of["TwoLimbGraph"], [of["Plan"]], samples=1, workers=1))
    ),
    "Reaction": lambda of: mlivr("fastest").step_reactions(of["TwoLimbGraph"], of["Plan"])[0],
    "Candidate": lambda of: Candidate(of["Plan"], "base", None, 1.0, 1.0, 1.0),
    "MissionPart": lambda of: MissionPart("walk", of["Recording"], of["Peaks"], None, 0.0),
    "CargoMission": mission,
    "ClosedLoopRecord": walked,
    "Event": lambda of: Event("end", 0.0, {"outcome": "arrived", "reason": ""}),
    "Footage": lambda of: Footage(),
    "CrewMember": lambda of: mlivr("closed_loop.crew").CrewMember((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    "Look": lambda of: Look(np.zeros((1, 3)), np.zeros((1, 3))),
    "DepthCamera": lambda of: DepthCamera(pixels=3),
    "Belief": lambda of: Belief(of["TwoLimbGraph"], 0.003),
    "seven joints": lambda of: robot_spec("mlivr2-iiwa"),
    "three limbs": lambda of: random_state(of["ImplicitGraph"], np.random.default_rng(0)),
    "spare": lambda of: jem_map().subset(np.arange(331) > 328, "spare"),
    "Loss": lambda of: Loss("P", ("P",), 1, 1),
    "StudyDesign": lambda of: StudyDesign("good_arguments:row", {"a": (1, 2)}, 1),
    "RunBlock": lambda of: of["StudyDesign"].blocks[0],
    "Box": lambda of: Box.between("bag", "obstacle", (9.0, 9.0, 9.0), (9.1, 9.1, 9.1)),
    "Segment": lambda of: of.map.segments[0],
    "Handrail": lambda of: Handrail("H", "deck", (0.0, 0.0, 0.0), (1.0, 0.1, 0.1)),
}
"""How an instance of each class is made, by the name of the class."""


def seen(env):
    """What a policy is asked with."""
    mask = env.action_masks()
    return {"env": env, "observation": env.reset(seed=0)[0], "mask": mask}


def corridor(of):
    return {"grasp_map": of.map, **of.query, "settings": of.settings}


SPECIAL = {
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
    "unknown_things": lambda of: {"boxes": 1, "plates": 0},
    "LookingPolicy.act": lambda of: seen(of["UnknownMapEnv"]),
    "ReplanningPolicy.act": lambda of: seen(of["ClosedLoopEnv"]),
    "MlivrVectorEnv.step": lambda of: {"actions": [0, 0]},
    "sample_task": lambda of: {"min_distance": 0.2},
    "Trajectory.at": lambda of: {"indices": np.array([0, 1])},
    "Trajectory.backwards": lambda of: {"slowness": 2},
    "Trajectory.turned_back": lambda of: {"first": 2, "slowness": 2, "duration": 0.5},
    "Trajectory.every": lambda of: {"period": 0.5},
    "Durations.time_scalings": lambda of: {"segments": of["segments"]},
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
    "load_dataset": lambda of: {"dataset_id": "mlivr/jem/expert-v0"},
    "load_hyperparameters": lambda of: {"method": "bc"},
    "MlivrEnv": lambda of: {"map": of.map},
    "ClosedLoopEnv": lambda of: {"map": of.map},
    "UnknownMapEnv": lambda of: {"map": of.map},
    "MlivrVectorEnv": lambda of: {"num_envs": 2, "env": of["MlivrEnv"]},
    "StanceGraphEnv": lambda of: {"size": (32, 16)},
    "stance_graph": lambda of: {"grasp_map": of.map, "settings": of.settings},
    "plan_in_corridor": corridor,
    "RobotSpec.with_failed_joint": lambda of: {"joint": 5, "angle": 0.3},
    "SceneRenderer": lambda of: {"robot": robot_spec("mlivr2-ur10e"), "width": 32, "height": 16},
    "film": lambda of: {"path": "walk.gif", "size": (32, 16), "speed": 1000.0},
    "film_pictures": lambda of: {"shots": [of["Shot"]], "size": (32, 16)},
    "save_film": lambda of: {"pictures": [np.zeros((16, 32, 3), np.uint8)], "path": "walk.gif"},
    "execute_many": lambda of: {"plans": [], "workers": 1},
    "run_study": lambda of: {"folder": "study", "engine": ThreadPoolExecutor(1)},
    "RecordVideo": lambda of: {"video_folder": "films"},
    "read_study": lambda of: {"folder": of.file("study")},
    "Camera.seeing": lambda of: {"aspect": 2.0},
    "closed_loop_film": lambda of: {"path": "walk.gif", "size": (32, 16), "speed": 1000.0},
    "mission_film": lambda of: {
        "parts": [of["MissionPart"]],
        "path": "walk.gif",
        "size": (32, 16),
        "speed": 1000.0,
    },
    "Route.add_to": lambda of: {"scene": mujoco.MjvScene(of["MjModel"], 1000)},
    "Cost.heuristic": lambda of: {
        "name": "consistent",
        "distance": np.ones(2),
        "max_displacement": 0.5,
    },
    "Cost.inadmissible_estimate": lambda of: {"distance": np.ones(2)},
    "points_to_add": lambda of: {"candidates": of["spare"]},
    "smallest_changes": lambda of: {"candidates": of["spare"]},
    "one_more_limb": lambda of: {"limit": 2},
    "find_walk": lambda of: {"method": "random", "start": of["State"], "max_steps": 3},
    "RobotSpec.from_dict": lambda of: {"data": of["RobotSpec"].to_dict()},
    "RobotSpec.load": lambda of: {"path": of.file("robot.json")},
    "RobotSpec.from_urdf": lambda of: {"path": of.file("robot.urdf")},
    "RobotSpec.from_mjcf": lambda of: {"path": of.file("robot.xml")},
    "read_robot": lambda of: {"path": of.file("robot.urdf")},
    "carrying_robot": lambda of: {"robot": of["ImplicitGraph"].robot},
    "Cargo.frame_on": lambda of: {"body_edges": np.ones(3), "tool_length": 0.05},
    "Cargo.limb_solids": lambda of: {"gripper_mass": 0.5, "tool_length": 0.05},
    "Peaks.of": lambda of: {"speeds": np.zeros((1, 2, 6))},
    "Peaks.join": lambda of: {"parts": [of["Peaks"]]},
    "limits": lambda of: {"frequencies": np.array([1.0, 2.0])},
    "DisturbanceRanges.only": lambda of: {"name": "friction"},
    "DisturbanceRanges.draw": lambda of: {"body_count": 9, "points": 3},
    "success_rate": lambda of: {"outcomes": [of["RunOutcome"]]},
    "plan_cargo_mission": lambda of: {
        "graph": of["ImplicitGraph"],
        "start": of["three limbs"].stance,
        "pick": of.free[0],
        "stow": of.free[1],
        "limbs": [0],
    },
    "CrewMember.middles": lambda of: {"times": np.zeros(2)},
    "point_cloud_message": lambda of: {"points": []},
    "points_of_message": lambda of: {"message": point_cloud_message([], 0.0)},
    "Belief": lambda of: {"noise": 0.003},
    "Belief.add_hits": lambda of: {"hits": []},
    "Belief.is_blocked": lambda of: {"first": 0},
    "Belief.will_touch": lambda of: {"sample": 0},
    "Successors.take": lambda of: {"kept": np.array([0])},
    "StudyDesign.from_data": lambda of: {"data": {"kind": "plan"}},
    "StudyDesign.from_file": lambda of: {"path": of.file("study.toml")},
    "columns_of": lambda of: {"kind": "plan"},
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
    "Box.rows": lambda of: {"rotation": np.eye(3)},
    "Box.each_between": lambda of: {"name": "b", "kind": "obstacle", **CORNERS},
    "Box.between": lambda of: {
        "id": "b",
        "kind": "obstacle",
        "low": (0.0, 0.0, 0.0),
        "high": (1.0, 1.0, 1.0),
    },
    "Box.each_placed": lambda of: {
        "boxes": [of["Box"]],
        "name": "b",
        "rotation": np.eye(3),
        "translation": np.zeros(3),
    },
    "Box.from_dict": lambda of: {"data": of["Box"].to_dict()},
    "point_cloud_boxes": lambda of: {"points": [[0.0, 0.0, 0.0]]},
    "capsule_box": lambda of: {"name": "b", "start": (0.0, 0.0, 0.0), "end": (1.0, 0.0, 0.0)},
    "TwoLimbGraph.add_obstacles": lambda of: {"boxes": [of["Box"]]},
    "ImplicitGraph.add_obstacles": lambda of: {"boxes": [of["Box"]]},
    "TwoLimbGraph.postures_of": lambda of: {"states": [of["State"]]},
    "ImplicitGraph.postures_of": lambda of: {"states": [of["three limbs"]]},
}
"""Arguments of some callables; those without a default value have others beside them."""

CORNERS = {"low": np.zeros((1, 3)), "high": np.ones((1, 3))}
POINTS = [
    {"id": "P", "face": "deck", "position": [0, 0, 0], "normal": [0, 0, 1], "rail": [1, 0, 0]}
]


def row(task, a):
    """What a run of a study of this module does."""
    return {"b": float(task + a)}


FILES = {
    "robot.urdf": lambda of, path: robot_spec("mlivr2-ur10e").to_urdf(path),
    "robot.xml": lambda of, path: robot_spec("mlivr2-ur10e").to_mjcf(path),
    "robot.json": lambda of, path: of["RobotSpec"].save(path),
    "plan.json": lambda of, path: of["whole plan"].save(path),
    "map.json": lambda of, path: of.map.save(path),
    "set.json": lambda of, path: path.write_bytes(asset_path("test_set.json").read_bytes()),
    "boxes.json": lambda of, path: path.write_text(json.dumps({"boxes": [of["Box"].to_dict()]})),
    "points.csv": lambda of, path: path.write_text(
        "id,x,y,z,nx,ny,nz,rx,ry,rz\nP,0,0,0,0,0,1,1,0,0\n"
    ),
    "mesh.obj": lambda of, path: path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    "study.toml": lambda of, path: path.write_text('kind = "plan"\ntasks = 1\n'),
    "study": lambda of, path: run_study(of["StudyDesign"], path, ThreadPoolExecutor(1)),
}

NAMED = {
    "graph": lambda of: of["TwoLimbGraph"],
    "grasp_map": lambda of: of.map,
    "start": lambda of: of.query["start"],
    "goal": lambda of: of.query["goal"],
    "stance": lambda of: of["State"].stance,
    "stances": lambda of: np.array([of["State"].stance]),
    "point": lambda of: of["State"].stance[0],
    "rotations": lambda of: np.eye(3)[None],
    "bits": lambda of: np.zeros((1, 2), np.int64),
    "angles": lambda of: of["Plan"].configuration(0)[2],
    "place": lambda of: FieldPath("limb", MlivrError),
    "characteristic_length": lambda of: 0.87,
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
    "present": lambda of: of["Plan"].configuration(0),
    "points": lambda of: of["Plan"].stances[0],
    "positions": lambda of: np.zeros((2, 3)),
    "name": lambda of: "ur5e",
    "radius": lambda of: 0.1,
    "seed": lambda of: 0,
    "width": lambda of: 32,
    "height": lambda of: 16,
    "cost": lambda of: "base",
    "episodes": lambda of: 1,
    "total": lambda of: 10.0,
    "action": lambda of: int(np.flatnonzero(of["MlivrEnv"].action_masks())[0]),
    "time": lambda of: 0.0,
    "plans": lambda of: [(of["Plan"], 1)],
    "after": lambda of: of["TwoLimbGraph"].neighbouring_nodes(of["State"].stance)[0][0],
}


class ThreeLimbs:
    """The things of a graph of three limbs where they are others."""

    def __init__(self, things):
        self.things, self.state = things, things["three limbs"]

    def __getattr__(self, name):
        return getattr(self.things, name)

    def __getitem__(self, name):
        graph = self.things["ImplicitGraph"]
        return {
            "State": lambda: self.state,
            "TwoLimbGraph": lambda: graph,
            "StanceGraph": lambda: graph,
            "Postures": lambda: graph.posture(self.state.stance),
            "Successors": lambda: graph.successors(self.state),
        }.get(name, lambda: self.things[name])()


def typed(things, annotation):
    """The names of classes in an annotation of which there is an instance."""
    return [name for name in re.findall(r"\w+", str(annotation)) if name in MAKERS]


def good(things, title, function):
    """The arguments with which a callable is called right: those without a default, and some."""
    given = dict(SPECIAL.get(title, lambda of: {})(things))
    if title.startswith("ImplicitGraph."):
        things = ThreeLimbs(things)
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
            raise LookupError(f"{title}: nothing for {name}")
    return given


def bound(things, title, function):
    """A callable, that of a method on an instance."""
    kind, _, name = title.partition(".")
    if not name or inspect.ismethod(function):
        return function
    return getattr(things["seven joints" if name == "with_failed_joint" else kind], name)
