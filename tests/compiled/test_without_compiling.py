"""The same kernels as plain Python, where a debugger can stop in them and coverage sees them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import config

from mlivr_gym import jem_map, stance_graph
from mlivr_gym.planners import Planner

ROOT = Path(__file__).parent.parent.parent

QUICK = (
    "compiled/test_kernels.py::test_in_parallel_covers_every_item_once",
    "kinematics/test_poses.py",
    "collisions/test_base_path.py",
    "kinematics/test_families.py::test_inverse_kinematics_of_axis_aligned_tools_has_all_eight_branches",
    "transitions/test_rule.py",
)

NAMED_LIKE_NUMPY = ("compiled/test_records.py",)

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled anyway")


def run_plainly(*command):
    """Output of a Python command with compilation switched off."""
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    how = {"env": environment, "cwd": ROOT, "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, *command], **how)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_kernels_pass_their_tests_as_plain_python():
    """In one process, those whose records have fields that are called like NumPy's among them."""
    files = [f"tests/{file}" for file in QUICK + NAMED_LIKE_NUMPY]
    run_plainly("-m", "pytest", "-q", "-p", "no:cacheprovider", *files)


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
    plain, compiled = json.loads(run_plainly(__file__)), json.loads(json.dumps(walk()))
    assert plain.pop("stances") == compiled.pop("stances")
    assert len(compiled["joints"]) > 1
    for name, values in compiled.items():
        np.testing.assert_allclose(plain[name], values, atol=1e-8)


if __name__ == "__main__":
    print(json.dumps(walk()))
