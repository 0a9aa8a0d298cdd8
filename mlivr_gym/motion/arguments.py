"""Schemas of the arguments that functions on plans and motions have in common."""

from __future__ import annotations

from mlivr_gym.arguments import Called, FileName, Kinds, Of
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Listed, Maybe, Text, Tuples, Whole
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

MAXIMUM_PERIOD = 60.0
"""Upper bound of the sampling period of a trajectory [s]."""

WALK: Kinds = {
    "graph": Of(StanceGraph),
    "grasp_map": Of(GraspMap),
    "robot": Of(RobotSpec),
    "obstacles": Listed(Of(Box)),
    "plan": Of(Plan),
    "index": Whole(0, 10**6),
    "trajectory": Of(Trajectory),
    "period": Tuples((), 1e-12, MAXIMUM_PERIOD, "s"),
    "path": FileName(),
    "title": Text(0),
    "progress": Maybe(Called()),
}
"""Schema of each argument, by the name that the argument has in all of these functions."""
