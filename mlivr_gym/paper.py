"""The four cases of Table I of the paper, the modes in which they are planned, and their relations.

The paper is Imai, Uno, Kuwahara and Yoshida, "Graph-Based Simultaneous Path and Foothold Planning
for Multi-Limbed Intra-Vehicular Robots in Space Stations".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.files import FileError, load
from mlivr_gym.robot.specification import RobotSpec, robot_spec
from mlivr_gym.schema import NAME, Anything, FieldPath, Fields, Integer, ListOf, Tuples
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.values import MAX_LENGTH
from mlivr_gym.world.grasp_map import GraspMap, jem_map

SETUP = asset_path("table1_setup.json")
"""File with start, goal and seed of the sparse map, written by
`experiments/calibrate_start_goal.py`."""

SETUP_DATA = Fields(
    {
        "start": ListOf(NAME, 2, 2),
        "goal": Tuples((3,), most=MAX_LENGTH, unit="m"),
        "goal_face": NAME,
        "sparse_seed": Integer(0, 1 << 63),
    },
    {"source": Anything()},
)
"""Schema of that file."""


@dataclass(frozen=True)
class Case:
    """One case of Table I."""

    manipulability: bool
    """Whether the manipulability thresholds apply."""
    cost: str
    """Name of the cost."""
    sparse: bool
    """Whether the map is the sparse one."""
    title: str
    """Title of its figure."""


CASES = {
    1: Case(False, "base", False, "Case 1: no manipulability thresholds, base cost"),
    2: Case(True, "base", False, "Case 2: thresholds, base cost"),
    3: Case(True, "steps", False, "Case 3: thresholds, step cost"),
    4: Case(True, "base", True, "Case 4: thresholds, base cost, sparse map"),
}
"""The cases of Table I by number."""

_COLUMNS = ("expanded", "base_translation", "steps", "w_m_min", "w_b_min", "time")
_ROWS = {
    1: (172, 4.4, 6, 0.07, 0.0008, 1.2),
    2: (386, 4.5, 7, 0.10, 0.0015, 1.8),
    3: (40, 4.7, 5, 0.12, 0.0018, 0.2),
    4: (72, 5.0, 7, 0.12, 0.0020, 0.2),
}
PAPER = {case: dict(zip(_COLUMNS, row, strict=True)) for case, row in _ROWS.items()}
"""Results of Table I as published, measured on an Intel i9-12900H: states explored, base
translation [m], steps, minimum w_m and w_b, computing time [s]."""


@dataclass(frozen=True)
class Mode:
    """A mode in which the cases are planned."""

    title: str
    """Name of the mode in tables."""
    transitions: bool
    """Whether steps are checked."""
    collisions: bool
    """Whether stances and steps are checked for collisions."""
    heuristic: str
    """Name of the heuristic."""


MODES = {
    "faithful": Mode("paper-faithful", False, False, "paper"),
    "steps": Mode("steps checked", True, False, "consistent"),
    "collisions": Mode("steps and collisions checked", True, True, "relaxed"),
}
"""Modes by name; `faithful` checks what the paper describes, which is stances only."""


def default_setup() -> dict[str, Any]:
    """Return the calibrated start (point ids), goal [m], goal face and seed of the sparse map.

    Raises a `FileError` if the file cannot be read or is invalid.
    """
    read = SETUP_DATA.read
    return load(
        SETUP, "setup of Table I", FileError, lambda data: read(data, FieldPath("", FileError))
    )


def case_map(case: int, setup: dict[str, Any]) -> GraspMap:
    """Return the map of a case.

    The sparse map has half of the points, and none on the deck between start and goal.
    """
    full = jem_map()
    if not CASES[case].sparse:
        return full
    start = tuple(setup["start"])
    x = full.positions[[full.index(point) for point in start], 0].mean()
    return full.sparse(
        int(setup["sparse_seed"]), keep=start, clear_deck=(float(x), float(setup["goal"][0]))
    )


def case_graph(case: int, setup: dict[str, Any], mode: str) -> StanceGraph:
    """Return the stance graph of a case in one of `MODES`.

    Without checks of the steps the span of the robot is unlimited, as in the paper.
    """
    how, robot = MODES[mode], robot_spec("mlivr2")
    if not how.transitions:
        robot = unlimited(robot)
    settings = Settings(
        manipulability=CASES[case].manipulability,
        transitions=how.transitions,
        collisions=how.collisions,
    )
    graph = stance_graph(case_map(case, setup), robot, settings)
    return graph


def unlimited(robot: RobotSpec) -> RobotSpec:
    """Return the robot with a span beyond the reach of its limbs, which has no effect."""
    return replace(robot, span=2.0 * robot.reach)


Row = Mapping[str, Any]
"""Results of one case: `base_translation` [m], `steps`, `w_m_min`, `w_b_min`, `expanded`,
`backward`, `time` [s]."""

CONSTRUCTION, CALIBRATION, FINDING = "construction", "calibration", "finding"
"""Reasons for a relation: it follows from optimality, start and goal were chosen such that it
holds, or it is a result."""


def relations(rows: Mapping[int, Row]) -> dict[str, dict[str, Any]]:
    """Evaluate the relations between the results of cases 1 to 4, each with its reason.

    Returned are `held` (bool) and `kind` (the reason) by the name of the relation. Relations by
    construction assume optimal searches from one start pose; the heuristic of the paper may violate
    them.
    """
    least_m, least_b = Settings().thresholds(2)
    meets = {k: r["w_m_min"] >= least_m and r["w_b_min"] >= least_b for k, r in rows.items()}
    length = {case: round(row["base_translation"], 9) for case, row in rows.items()}
    steps = {case: row["steps"] for case, row in rows.items()}
    explored = {case: row["expanded"] + row["backward"] for case, row in rows.items()}
    time = {case: row["time"] for case, row in rows.items()}
    out: dict[str, tuple[bool, str]] = {}
    for case in (2, 3, 4):
        out[f"Case {case} meets both thresholds"] = meets[case], CONSTRUCTION
    out |= {
        "Case 2 is no shorter than Case 1": (length[2] >= length[1], CONSTRUCTION),
        "Case 3 has no less translation than Case 2": (length[3] >= length[2], CONSTRUCTION),
        "Case 3 has no more steps than Case 2": (steps[3] <= steps[2], CONSTRUCTION),
        "Case 4 is no shorter than Case 2": (length[4] >= length[2], CONSTRUCTION),
        "Case 1 goes below at least one threshold": (not meets[1], FINDING),
        "Case 3 has fewer steps than Case 2": (steps[3] < steps[2], FINDING),
        "Case 2 explores more than Case 1": (explored[2] > explored[1], FINDING),
        "Case 2 takes longer than Case 1": (time[2] > time[1], FINDING),
        "Case 3 explores less than Case 1": (explored[3] < explored[1], FINDING),
        "Case 4 explores less than Case 2": (explored[4] < explored[2], FINDING),
        "Case 4 is 0.25 m or more longer than Case 2": (length[4] >= length[2] + 0.25, FINDING),
    }
    for case in rows:
        paper = PAPER[case]
        similar = abs(length[case] / paper["base_translation"] - 1.0) <= 0.15
        close = abs(steps[case] - paper["steps"]) <= 1
        out[f"Case {case}: base translation within 15 % of the paper's"] = similar, CALIBRATION
        out[f"Case {case}: steps within one of the paper's"] = close, CALIBRATION
    return {name: {"held": bool(held), "kind": kind} for name, (held, kind) in out.items()}
