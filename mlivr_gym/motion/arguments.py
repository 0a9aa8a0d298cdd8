"""Schemas of the arguments that functions on plans and motions have in common."""

from __future__ import annotations

from mlivr_gym.arguments import FileName, Function, InstanceOf, Validators
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Integer, ListOf, OrNone, Text, Tuples
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

MAX_PERIOD = 60.0
"""Upper bound of the sampling period of a trajectory [s]."""

ARGUMENTS: Validators = {
    "graph": InstanceOf(StanceGraph),
    "grasp_map": InstanceOf(GraspMap),
    "robot": InstanceOf(RobotSpec),
    "obstacles": ListOf(InstanceOf(Box)),
    "plan": InstanceOf(Plan),
    "index": Integer(0, 10**6),
    "trajectory": InstanceOf(Trajectory),
    "period": Tuples((), 1e-12, MAX_PERIOD, "s"),
    "path": FileName(),
    "title": Text(0),
    "progress": OrNone(Function()),
}
"""Validator of each argument, by the name that the argument has in all of these functions."""
