"""The same kernels as plain Python, where a debugger can stop in them and coverage sees them."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import config
from processes import printed

from mlivr_gym import jem_map, stance_graph
from mlivr_gym.planners import Planner

PLAINLY = {
    "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path),
    "cwd": Path(__file__).parent.parent.parent,
}  # fmt: skip
"""Compilation is switched off."""

DISTANCES, STEPS = "collisions/test_distances.py::test_", "transitions/test_steps.py::test_a_limb_"
QUICK = (
    "compiled/test_kernels.py::test_in_parallel_covers_every_item_once",
    "kinematics/test_poses.py",
    "kinematics/test_families.py::test_inverse_kinematics_of_axis_aligned_tools_has_all_eight_branches",
    f"{DISTANCES}a_base_path_is_slerp_on_a_line",
    f"{DISTANCES}the_way_back_is_the_way_there",
    f"{DISTANCES}a_departure_moves_the_base_into_the_surface",
    f"{STEPS}may_move_if_it_may_be_on_a_branch_on_which_it_can_be_released",
    f"{STEPS}that_holds_keeps_the_branches_that_it_may_be_on_and_the_edge_serves",
)

NAMED_LIKE_NUMPY = ("compiled/test_records.py",)

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled anyway")


def test_kernels_pass_their_tests_as_plain_python():
    """In one process, those whose records have fields that are called like NumPy's among them."""
    files = [f"tests/{file}" for file in QUICK + NAMED_LIKE_NUMPY]
    printed("-m", "pytest", "-q", "-p", "no:cacheprovider", *files, **PLAINLY)


def walk():
    """A plan on four points and the costs of going on, of all that is compiled for it."""
    points = ("F3a:2", "F3a:4", "F3b:2", "F3b:4")
    full = jem_map()
    graph = stance_graph(full.subset(np.isin(full.ids, points), "four points"))
    goal = graph.base_position[-1].tolist()
    start, planner = graph.ids(graph.points[0]), Planner(graph)
    plan = planner.plan(start, goal, goal_tolerance=0.05).unwrap()
    values = planner.cost_to_go(goal, goal_tolerance=0.05).values.tolist()
    return {
        "stances": plan.stances,
        "cost": plan.cost,
        "joints": plan.motion.joint_positions.tolist(),
        "values": values,
        "branch_sets": graph.branch_sets.tolist(),
        "bases": graph.base_position.tolist(),
    }


@pytest.mark.slow
def test_a_plan_of_plain_python_is_that_of_compiled_code():
    plain, compiled = json.loads(printed(__file__, **PLAINLY)[-1]), json.loads(json.dumps(walk()))
    assert plain.pop("stances") == compiled.pop("stances")
    assert len(compiled["joints"]) > 1
    for name, values in compiled.items():
        np.testing.assert_allclose(plain[name], values, atol=1e-8)


if __name__ == "__main__":
    print(json.dumps(walk()))
