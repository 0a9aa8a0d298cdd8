"""Plans refined: the same footholds, less translation, still possible."""

from itertools import product

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import PlanError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Planner
from mlivr_gym.planners.refinement import _Footholds
from mlivr_gym.simulation.execution import execute
from mlivr_gym.stances.checked_steps import join


def plans(graph, number, cost="steps", seed=0):
    """Plans of two to five steps between random stances."""
    rng, planner, found = np.random.default_rng(seed), Planner(graph), []
    while len(found) < number:
        start, goal = sample_task(graph, rng, 1.0)
        plan = planner.plan(start, goal, cost).plan
        if plan is not None and 2 <= len(plan.steps) <= 5:
            found.append(plan)
    return found


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_footholds_start_and_goal_region_stay_and_thresholds_hold(small_checked_graph, cost):
    graph, shorter = small_checked_graph, 0
    for plan in plans(graph, 3, cost):
        new = Planner(graph).refined(plan)
        assert new.stances == plan.stances
        np.testing.assert_array_equal(new.motion.base_positions[0], plan.motion.base_positions[0])
        np.testing.assert_allclose(
            new.motion.joint_positions[0], plan.motion.joint_positions[0], atol=1e-9
        )
        away = np.linalg.norm(new.motion.base_positions[-1] - np.array(plan.query.goal))
        assert away <= plan.query.goal_tolerance
        assert new.w_m_min >= graph.limb_threshold
        assert new.w_b_min >= graph.base_threshold
        assert new.base_translation <= plan.base_translation
        assert new.cost == pytest.approx(plan.cost if cost == "steps" else new.base_translation)
        shorter += new.base_translation < 0.999 * plan.base_translation
    assert shorter


def test_a_refined_plan_is_carried_out(small_checked_graph):
    graph = small_checked_graph
    plan = Planner(graph).refined(plans(graph, 1)[0])
    assert execute(graph, plan).failure is None


def test_a_round_finds_the_least_translation_that_the_steps_allow(small_checked_graph):
    """Against every combination of a few poses, each step asked of `transition`."""
    graph, rng, looked = small_checked_graph, np.random.default_rng(1), 0
    for plan in plans(graph, 4):
        walk = _Footholds(graph, plan)
        tried = [
            tuple(part[rng.permutation(len(part))[:8]] for part in poses)
            for poses in walk.poses_tried()
        ]
        tried = [(p, r) if k % 2 else (p[:3], r[:3]) for k, (p, r) in enumerate(tried)]
        layers = walk.layers(tried)
        found = walk.search(layers)
        least = np.inf
        for choice in product(*(range(len(layer.w_b)) for layer in layers)):
            postures = [
                layer.take(slice(c, c + 1)) for layer, c in zip(layers, choice, strict=True)
            ]
            places = np.concatenate([posture.base_position for posture in postures])
            length = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
            if length >= least:
                continue
            state = walk.start._replace(pose=None)
            for k, stance in enumerate(walk.stances[1:]):
                state = graph.transition(state, stance, join(postures[k], postures[k + 1]))
                if state is None:
                    break
            least = least if state is None else length
            looked += 1
        moved = np.diff(found.postures.base_position, axis=0)
        assert np.linalg.norm(moved, axis=1).sum() == pytest.approx(least, abs=1e-12)
    assert looked > 20


def test_the_same_seed_gives_the_same_plan(small_checked_graph):
    (plan,) = plans(small_checked_graph, 1)
    first, second = (Planner(small_checked_graph).refined(plan, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.motion.base_positions, second.motion.base_positions)


def test_a_plan_of_another_map_is_refused(small_checked_graph, jem):
    (plan,) = plans(small_checked_graph, 1)
    other = stance_graph(jem.subset(np.arange(len(jem)) % 3 == 0, "another"))
    with pytest.raises(PlanError, match="was made on map"):
        Planner(other).refined(plan)


def test_the_command_writes_the_refined_plan(tmp_path, capsys):
    file = tmp_path / "plan.json"
    task = ["--start", "D2a:4", "D2b:4", "--goal", "6.0", "0", "0.42", "--cost", "steps"]
    assert main(["plan", *task, "--refined", "--out", str(file)]) == 0
    said = capsys.readouterr().out
    told = float(said.split("refined: ")[1].split(" m")[0])
    assert Plan.load(file).base_translation == pytest.approx(told, abs=5e-4)
