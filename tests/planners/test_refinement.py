"""Plans refined: the same footholds, less translation, still possible."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym.cli.main import main
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Planner, refinement
from mlivr_gym.planners.refinement import _Footholds, varied
from mlivr_gym.stances.checked_steps import join


@pytest.fixture(autouse=True)
def few_rounds(monkeypatch):
    """What holds after each round holds after a few as after all."""
    monkeypatch.setattr(refinement, "ROUNDS", 2)
    monkeypatch.setattr(refinement, "VARIATIONS", 8)


def plans(graph, number, cost="steps", seed=0):
    """Plans of two to five steps between random stances."""
    rng, planner, found = np.random.default_rng(seed), Planner(graph), []
    while len(found) < number:
        start, goal = sample_task(graph, rng, 1.0)
        plan = planner.plan(start, goal, cost).plan
        if plan is not None and 2 <= len(plan.steps) <= 5:
            found.append(plan)
    return found


def with_short_steps(graph, plan):
    """The plan with its base poses varied for less base translation."""
    return varied(graph, plan, lambda path: path.base_chord)


@pytest.mark.parametrize("refine", [lambda *of: Planner(of[0]).refined(of[1]), with_short_steps])
@pytest.mark.parametrize("cost", ["steps", "base"])
def test_footholds_start_and_goal_region_stay_and_thresholds_hold(
    small_checked_graph, cost, refine
):
    graph, shorter = small_checked_graph, 0
    for plan in plans(graph, 3, cost):
        new = refine(graph, plan)
        assert Plan.from_dict(new.to_dict(), graph.grasp_map).stances == new.stances
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


def test_the_last_pose_moves_in_the_goal_region_and_stays_where_there_is_none(small_checked_graph):
    """A walk that ends elsewhere keeps the pose that it ends in."""
    graph, moved = small_checked_graph, 0.0
    for plan in plans(graph, 3, "base"):
        last = plan.motion.base_positions[-1]
        moved += np.linalg.norm(Planner(graph).refined(plan).motion.base_positions[-1] - last)
        astray = replace(plan, query=replace(plan.query, goal=(9.0, 9.0, 9.0)))
        new = Planner(graph).refined(astray)
        np.testing.assert_allclose(new.motion.base_positions[-1], last, atol=1e-12)
    assert moved > 0.01


def test_a_plan_that_costs_more_is_proved_to_be_optimal_up_to_a_larger_factor(
    small_checked_graph,
):
    """The steps cost the less the longer they are; a file states the new cost, and is checked."""
    graph, longer = small_checked_graph, 0
    for plan in plans(graph, 3, "base"):
        new = varied(graph, plan, lambda path: -path.base_chord)
        assert new.statistics.bound == pytest.approx(new.base_translation / plan.cost)
        assert Plan.from_dict(new.to_dict(), graph.grasp_map).cost == new.base_translation
        longer += new.statistics.bound > 1.01
    assert longer


def least_of(graph, walk, layers):
    """Least translation over all combinations of postures, each step asked of `transition`."""
    least = np.inf

    def go_on(state, here, spent):
        nonlocal least
        k = len(here) - 1
        if k + 1 == len(layers):
            least = min(least, spent)
            return
        for row in range(len(layers[k + 1].w_b)):
            there = layers[k + 1].take(slice(row, row + 1))
            moved = np.linalg.norm(there.base_position - here[-1].base_position)
            if spent + moved < least:
                after = graph.state_after(state, walk.stances[k + 1], join(here[-1], there))
                if after is not None:
                    go_on(after, [*here, there], spent + moved)

    go_on(walk.start._replace(pose=None), [layers[0]], 0.0)
    return least


@pytest.mark.parametrize("seed", range(3))
def test_a_round_finds_the_least_translation(small_checked_graph, monkeypatch, seed):
    monkeypatch.setattr(refinement, "STEP_BATCH", 2)
    graph, rng = small_checked_graph, np.random.default_rng(seed)
    for plan in plans(graph, 4, "base", seed):
        walk = _Footholds(graph, plan)
        known = walk.search(walk.layers(walk.candidate_poses())).postures
        # Far samples, without the poses that are known to do: many steps are not possible.
        tried = [(p[:30], r[:30]) for p, r in walk.samples(known, rng, 1.5)]
        layers = walk.layers(tried, known)
        for k, layer in enumerate(layers):
            if len(layer.w_b) > 3:
                layers[k] = layer.take(slice(1, None))
        found, least = walk.search(layers), least_of(graph, walk, layers)
        if found is None:
            assert least == np.inf
            continue
        moved = np.diff(found.postures.base_position, axis=0)
        assert np.linalg.norm(moved, axis=1).sum() == pytest.approx(least, abs=1e-12)


def test_the_same_seed_gives_the_same_plan(small_checked_graph):
    (plan,) = plans(small_checked_graph, 1)
    first, second = (Planner(small_checked_graph).refined(plan, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.motion.base_positions, second.motion.base_positions)
    first, second = (with_short_steps(small_checked_graph, plan) for _ in range(2))
    np.testing.assert_array_equal(first.motion.base_positions, second.motion.base_positions)


def test_the_command_writes_the_refined_plan(tmp_path, capsys):
    file = tmp_path / "plan.json"
    task = ["--start", "D2a:4", "D2b:4", "--goal", "6.0", "0", "0.42", "--cost", "steps"]
    assert main(["plan", *task, "--refined", "--out", str(file)]) == 0
    said = capsys.readouterr().out
    told = float(said.split("refined: ")[1].split(" m")[0])
    assert Plan.load(file).base_translation == pytest.approx(told, abs=5e-4)
