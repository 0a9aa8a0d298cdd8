"""One instance of each class of the API reference, and one file of each kind."""

import dataclasses
import json
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from importlib import import_module

import numpy as np
from plans import first_steps
from robot_texts import mjcf_by_mujoco, one_arm

from mlivr_gym import (
    Box,
    Settings,
    robot_spec,
    stance_graph,
)
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.rewards import REWARDS, StepOutcome, TotalReward
from mlivr_gym.envs.task import Task
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.extensions.cargo.arm_motion import LimbMotion
from mlivr_gym.extensions.cargo.cargo_mission import CargoMission
from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.env import ClosedLoopEnv
from mlivr_gym.extensions.closed_loop.loop import run_closed_loop
from mlivr_gym.extensions.closed_loop.record import Event
from mlivr_gym.extensions.closed_loop.unknown_map import UnknownMapEnv
from mlivr_gym.extensions.reaction.fastest import Candidate
from mlivr_gym.extensions.station_load.spectra import station_load
from mlivr_gym.extensions.studies import StudyDesign, run_study
from mlivr_gym.extensions.unseen import UnseenEnv
from mlivr_gym.extensions.why_not.smallest_change import Change
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.rendering import SceneRenderer, Shot
from mlivr_gym.pictures.route import Route
from mlivr_gym.planners import Cost, Planner
from mlivr_gym.planners.outcome import Improvement
from mlivr_gym.planners.why_not import Cause
from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.robot.visuals import Visual
from mlivr_gym.simulation.disturbances import DisturbanceRanges, robot_body_ids
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.recording import Failure
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.timing import plan_trajectory
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.world.rails import Handrail


def mlivr(name):
    """A module of the package."""
    return import_module(f"mlivr_gym.{name}")


class Things:
    """One instance of each class of the reference, made when it is first asked for."""

    def __init__(self, grasp_map, folder):
        self.map, self.folder, self.made, self.graphs = grasp_map, folder, {}, {}
        self.settings = Settings()

    def __getitem__(self, name):
        if name not in self.made:
            self.made[name] = MAKERS[name](self)
        return self.made[name]

    @cached_property
    def agents(self):
        return mlivr("agents")

    @property
    def closed_loop(self):
        return mlivr("extensions.closed_loop")

    @cached_property
    def joints(self):
        return self["Plan"].motion.joint_positions[0]

    @cached_property
    def query(self):
        """Start and goal."""
        graph, env = self["StanceGraph"], self["MlivrEnv"]
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
        for name in ("StanceGraph", "three-limb graph"):
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
    return run_closed_loop(things["StanceGraph"], **things.query, max_steps=1, filmed=True)


def mission(things):
    plan = things["Plan"]
    bag = Box.between("bag", "obstacle", (9.0, 9.0, 9.0), (9.1, 9.1, 9.1))
    plan = dataclasses.replace(plan, world=dataclasses.replace(plan.world, obstacles=(bag,)))
    graphs, motions = (things["StanceGraph"],) * 2, (limb_motion(things),) * 3
    return CargoMission(0, graphs, (plan,) * 2, motions)


def limb_motion(things):
    plan = things["Plan"]
    return LimbMotion(plan.joint_path(0), things["StanceGraph"].indices(plan.stances[0]))


def unseen(things):
    """An environment of one world, in which it trains, at the start of an episode."""
    env = UnseenEnv([("mlivr2", things.map)], [("mlivr2", things.map)])
    env.reset(seed=0)
    return env


MAKERS = {
    "StanceGraph": lambda of: stance_graph(of.map, settings=of.settings),
    "three-limb graph": lambda of: stance_graph(of.map, "mlivr3", of.settings),
    "GraspMap": lambda of: of.map,
    "RobotSpec": lambda of: of["StanceGraph"].robot,
    "Settings": lambda of: of.settings,
    "MlivrEnv": lambda of: environment(of, render_mode="rgb_array", width=32, height=16),
    "Env": lambda of: of["MlivrEnv"],
    "StanceGraphEnv": lambda of: of["MlivrEnv"],
    "ClosedLoopEnv": lambda of: environment(of, ClosedLoopEnv),
    "UnknownMapEnv": lambda of: environment(of, UnknownMapEnv),
    "UnseenEnv": unseen,
    "MlivrVectorEnv": lambda of: MlivrVectorEnv(2, env=MlivrEnv(map=of.map)),
    "ActionMaskObservation": lambda of: ActionMaskObservation(of["MlivrEnv"]),
    "PointObservation": lambda of: mlivr("agents.features").PointObservation(of["MlivrEnv"]),
    "Observation": lambda of: of["MlivrEnv"].reset(seed=0)[0],
    "State": lambda of: of["MlivrEnv"].state,
    "Successors": lambda of: of["StanceGraph"].successors(of["State"]),
    "Task": lambda of: Task(of["State"], np.array(of.query["goal"])),
    "Generator": lambda of: np.random.default_rng(0),
    "Randomness": lambda of: of["Generator"],
    "Moves": lambda of: of["MlivrEnv"].moves,
    "Postures": lambda of: of["StanceGraph"].posture(of["State"].stance),
    "LayoutTasks": lambda of: mlivr("envs.layout_tasks").LayoutTasks(),
    "AnywhereTasks": lambda of: mlivr("envs.tasks").AnywhereTasks(),
    "WalkTasks": lambda of: mlivr("envs.tasks").WalkTasks(),
    "CostReward": lambda of: REWARDS["base"],
    "TotalReward": lambda of: TotalReward(REWARDS["base"], 1.0, False, 0.9, 0.2),
    "StepOutcome": lambda of: StepOutcome(0.1, 1.0, 0.9, False, True, 0.5, (3, 4), 4),
    "RandomPolicy": lambda of: of.agents.RandomPolicy(),
    "Policy": lambda of: of.agents.RandomPolicy(),
    "ExpertPolicy": lambda of: of.agents.ExpertPolicy(),
    "LookingPolicy": lambda of: of.closed_loop.LookingPolicy(of["RandomPolicy"]),
    "ReplanningPolicy": lambda of: of.closed_loop.ReplanningPolicy(),
    "PlanPolicy": lambda of: of.agents.planner_policy(),
    "LearnedPolicy": lambda of: mlivr("agents.learned").load_policy("pretrained", of["MlivrEnv"]),
    "EvaluationTask": lambda of: of.agents.EvaluationTask(**of.query),
    "Evaluation": lambda of: of.agents.evaluate(of["MlivrEnv"], of["RandomPolicy"], 1, max_steps=2),
    "HeldOutWorld": lambda of: mlivr("agents.test_set").load_test_set()[0],
    "Planner": lambda of: Planner(of["StanceGraph"]),
    "PlanningResult": lambda of: of["Planner"].plan(**of.query),
    "whole plan": lambda of: of["PlanningResult"].unwrap(),
    "Plan": lambda of: first_steps(of["whole plan"], 1),
    "Query": lambda of: of["Plan"].query,
    "World": lambda of: of["Plan"].world,
    "Motion": lambda of: of["Plan"].motion,
    "Statistics": lambda of: of["Plan"].statistics,
    "Step": lambda of: of["Plan"].steps[0],
    "Cost": lambda of: Cost.named("base"),
    "CostToGo": lambda of: of["Planner"].cost_to_go(of.query["goal"]),
    "Goal": lambda of: of["CostToGo"].goal,
    "Improvement": lambda of: Improvement(0.1, 1.0, 1.0),
    "Cause": lambda of: Cause((), "nothing"),
    "Change": lambda of: Change("obstacles", ("box",), True, 1),
    "Trajectory": lambda of: plan_trajectory(of["StanceGraph"], of["Plan"], period=0.1),
    "Camera": lambda of: Camera((0.0, 0.0, 0.0)),
    "Route": drawn_route,
    "Foothold": lambda of: of["Route"].footholds[0],
    "Shot": lambda of: Shot(of["Plan"].configuration(0)),
    "SceneRenderer": lambda of: SceneRenderer(of.map, robot_spec("mlivr2-ur10e"), 32, 16),
    "Cargo": lambda of: mlivr("robot.cargo").Cargo(1.0, 0.2),
    "LimbDynamics": lambda of: of["RobotSpec"].dynamics_of(0),
    "Capsule": lambda of: of["RobotSpec"].mounted[0].capsules[0],
    "Visual": lambda of: Visual("upper_arm", "arm.obj"),
    "RobotFile": lambda of: read_robot(of.file("robot.urdf"), limbs=2),
    "Execution": lambda of: execute(of["StanceGraph"], of["Plan"]),
    "Recording": lambda of: of["Execution"].recording,
    "Peaks": lambda of: of["Execution"].peaks,
    "Capture": lambda of: of["Execution"].captures[0],
    "Failure": lambda of: Failure("time", 1.0, 0, "swing", 0, "too long", {}),
    "ControllerParameters": lambda of: of["Execution"].controller,
    "Physics": lambda of: of["Execution"].physics,
    "Limits": lambda of: mlivr("simulation.parameters").Limits(),
    "DisturbanceRanges": lambda of: DisturbanceRanges(),
    "Disturbance": lambda of: DisturbanceRanges().draw(
        0, len(robot_body_ids(of["MjModel"])), 2, len(of.map.ids)
    ),
    "Setup": lambda of: Setup(),
    "Simulation": lambda of: Setup().simulation(of.map, of["RobotSpec"]),
    "MjModel": lambda of: of["Simulation"].model,
    "MjData": lambda of: of["Simulation"].data,
    "StationLoad": lambda of: station_load(of["Recording"]),
    "Reaction": lambda of: mlivr("extensions.reaction").step_reactions(
        of["StanceGraph"], of["Plan"]
    )[0],
    "Reach": lambda of: mlivr("extensions.failed_joints").Reach(3, 1),
    "Candidate": lambda of: Candidate(of["Plan"], "base", None, 1.0, 1.0, 1.0),
    "LimbMotion": lambda of: limb_motion(of),
    "CargoMission": mission,
    "ClosedLoopRecord": walked,
    "Event": lambda of: Event("end", 0.0, {"outcome": "arrived", "reason": ""}),
    "DepthCamera": lambda of: DepthCamera(pixels=3),
    "Belief": lambda of: Belief(of["StanceGraph"], 0.003),
    "seven joints": lambda of: robot_spec("mlivr2-iiwa"),
    "three limbs": lambda of: random_state(of["three-limb graph"], np.random.default_rng(0)),
    "StudyDesign": lambda of: StudyDesign("things:row", {"a": (1, 2)}, 1),
    "RunBlock": lambda of: of["StudyDesign"].blocks[0],
    "Box": lambda of: Box.between("bag", "obstacle", (9.0, 9.0, 9.0), (9.1, 9.1, 9.1)),
    "Segment": lambda of: of.map.segments[0],
    "Handrail": lambda of: Handrail("H", "deck", (0.0, 0.0, 0.0), (1.0, 0.1, 0.1)),
}
"""How an instance of each class is made, by the name of the class."""


def row(task, a):
    """What a run of a study of this module does."""
    return {"b": float(task + a)}


FILES = {
    "robot.urdf": lambda of, path: path.write_text(one_arm()),
    "robot.xml": lambda of, path: path.write_text(mjcf_by_mujoco(robot_spec("mlivr2-ur10e"))),
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
"""How a file of each kind is written, by its name."""
