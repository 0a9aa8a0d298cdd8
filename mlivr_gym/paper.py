"""The four cases of the paper's Table I, and the relations between them."""

from __future__ import annotations

from collections.abc import Mapping, Sized
from dataclasses import dataclass
from typing import Any, Protocol

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.files import FileError, load
from mlivr_gym.schema import NAME, Anything, Fields, Listed, Place, Tuples, Whole
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.values import LONGEST
from mlivr_gym.world.grasp_map import GraspMap, jem_map

SETUP = asset_path("table1_setup.json")
"""Start, goal and seed of the sparse map, written by `experiments/calibrate_start_goal.py`."""

SETUP_DATA = Fields(
    {
        "start": Listed(NAME, 2, 2),
        "goal": Tuples((3,), most=LONGEST, unit="m"),
        "sparse_seed": Whole(0, 1 << 63),
    },
    {"source": Anything()},
)
"""Fields of that file."""


@dataclass(frozen=True)
class Case:
    """One case of the table.

    Attributes:
        manipulability: Whether the thresholds hold.
        cost: Name of the cost.
        sparse: Whether the map is the sparse one.
        title: Heading of its picture.
    """

    manipulability: bool
    cost: str
    sparse: bool
    title: str


CASES = {
    1: Case(False, "base", False, "Case 1: no manipulability thresholds, base cost"),
    2: Case(True, "base", False, "Case 2: thresholds, base cost"),
    3: Case(True, "steps", False, "Case 3: thresholds, step cost"),
    4: Case(True, "base", True, "Case 4: thresholds, base cost, sparse map"),
}

PAPER: dict[int, dict[str, float]] = {
    1: {
        "expanded": 172,
        "base_translation": 4.4,
        "steps": 6,
        "w_m_min": 0.07,
        "w_b_min": 0.0008,
        "time": 1.2,
    },
    2: {
        "expanded": 386,
        "base_translation": 4.5,
        "steps": 7,
        "w_m_min": 0.10,
        "w_b_min": 0.0015,
        "time": 1.8,
    },
    3: {
        "expanded": 40,
        "base_translation": 4.7,
        "steps": 5,
        "w_m_min": 0.12,
        "w_b_min": 0.0018,
        "time": 0.2,
    },
    4: {
        "expanded": 72,
        "base_translation": 5.0,
        "steps": 7,
        "w_m_min": 0.12,
        "w_b_min": 0.0020,
        "time": 0.2,
    },
}
"""Imai, Uno, Kuwahara, Yoshida: Table I, on an Intel i9-12900H."""


class PlanFigures(Protocol):
    """The figures of a plan that Table I gives."""

    @property
    def steps(self) -> Sized:
        """Steps of the plan."""

    @property
    def base_translation(self) -> float:
        """Length of the base path [m]."""

    @property
    def w_m_min(self) -> float:
        """Least limb manipulability."""

    @property
    def w_b_min(self) -> float:
        """Least base manipulability."""


def default_setup() -> dict[str, Any]:
    """The calibrated start (point ids), goal [m] and seed."""
    return load(SETUP, "setup of Table I", FileError, _setup)


def _setup(data: dict[str, Any]) -> dict[str, Any]:
    return SETUP_DATA.read(data, Place("", FileError))


def case_map(case: int, setup: dict[str, Any]) -> GraspMap:
    """Map of a case.

    The sparse map has half the points, and no deck point between start and goal.
    """
    full = jem_map()
    if not CASES[case].sparse:
        return full
    start = tuple(setup["start"])
    x = full.positions[[full.index(point) for point in start], 0].mean()
    return full.sparse(
        int(setup["sparse_seed"]), keep=start, clear_deck=(float(x), float(setup["goal"][0]))
    )


def case_graph(case: int, setup: dict[str, Any], collisions: bool = False) -> PairGraph | LazyGraph:
    """Stance graph of a case; the paper does not look at collisions."""
    settings = Settings(manipulability=CASES[case].manipulability, collisions=collisions)
    return stance_graph(case_map(case, setup), settings=settings)


def relations(plans: Mapping[int, PlanFigures]) -> dict[str, bool]:
    """Whether the relations between the paper's cases hold.

    Args:
        plans: Plans by case; what cannot be told from those given is not in the result.
    """
    default = Settings().thresholds(2)
    out = {}

    def meets(plan: PlanFigures) -> bool:
        return plan.w_m_min >= default[0] and plan.w_b_min >= default[1]

    if 1 in plans:
        out["Case 1 goes below at least one threshold"] = not meets(plans[1])
    for case in (2, 3, 4):
        if case in plans:
            out[f"Case {case} meets both thresholds"] = meets(plans[case])
    length = {case: round(plan.base_translation, 9) for case, plan in plans.items()}
    if 1 in plans and 2 in plans:
        out["Case 2 is no shorter than Case 1"] = length[2] >= length[1]
    if 2 in plans and 3 in plans:
        out["Case 3 has fewer steps than Case 2"] = len(plans[3].steps) < len(plans[2].steps)
        out["Case 3 has no less translation than Case 2"] = length[3] >= length[2]
    if 2 in plans and 4 in plans:
        out["Case 4 is no shorter than Case 2"] = length[4] >= length[2]
    for case, plan in plans.items():
        row = PAPER[case]
        similar = abs(plan.base_translation / row["base_translation"] - 1.0) <= 0.15
        out[f"Case {case}: base translation within 15 % of the paper's"] = similar
        out[f"Case {case}: steps within one of the paper's"] = (
            abs(len(plan.steps) - row["steps"]) <= 1
        )
    return out
