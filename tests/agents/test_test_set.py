"""The frozen test set is what its description says."""

import numpy as np
import pytest

from mlivr_gym import GraspMap
from mlivr_gym.agents.test_set import (
    MIN_START_GOAL_DISTANCE,
    SPLITS,
    HeldOutWorld,
    _draw_tasks,
    freeze_test_set,
    held_out_goals,
    load_test_set,
)
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.planners import Planner


def test_the_test_set_is_as_described(jem):
    worlds = load_test_set()
    sizes = {split: sum(len(w.tasks) for w in worlds if w.split == split) for split in SPLITS}
    assert min(sizes.values()) >= 50
    assert sum(sizes.values()) >= 200
    assert len(held_out_goals()) == sum(sizes.values())
    for world in worlds:
        grasp_map = world.map()
        for task in world.tasks:
            for point in (*task.start, *task.occupied):
                grasp_map.index(point)
            assert not set(task.start) & set(task.occupied)
            grasp_map.check_goal(task.goal)
        assert (world.split == "half") == (len(grasp_map) == len(jem) // 2)
        assert (world.split == "occupied") == all(len(task.occupied) > 60 for task in world.tasks)


@pytest.mark.parametrize("groups", [0, 3])
def test_tasks_are_far_apart_inside_the_cabin_and_have_a_plan(small_map, monkeypatch, groups):
    """As many as asked for, and with groups as many on each set of occupied points."""
    low, high = small_map.cabin.tolist()
    small_map = GraspMap.from_dict(small_map.to_dict() | {"cabin": [low, [2.3, *high[1:]]]})
    monkeypatch.setattr(HeldOutWorld, "map", lambda world: small_map)
    monkeypatch.setattr("mlivr_gym.agents.test_set.MIN_START_GOAL_DISTANCE", 0.7)
    world = _draw_tasks(HeldOutWorld("same", 0.2, None, ()), 12, np.random.default_rng(0), groups)
    assert len(world.tasks) == 12
    sets = [task.occupied for task in world.tasks]
    assert [sets.count(taken) for taken in dict.fromkeys(sets)] == ([4] * 3 if groups else [12])
    env = MlivrEnv(map=small_map)
    low, high = small_map.cabin
    assert ((env.graph.base_position < low) | (env.graph.base_position > high)).any()
    for task in world.tasks:
        assert len(task.occupied) == (int(0.2 * len(small_map)) if groups else 0)
        env.graph.vacate()
        env.graph.occupy(task.occupied)
        _, info = env.reset(options={"start": task.start, "goal": task.goal})
        assert np.linalg.norm(info["base_position"] - task.goal) >= 0.7
        assert (low <= task.goal).all()
        assert (task.goal <= high).all()
        assert Planner(env.graph).plan(task.start, list(task.goal), "steps").plan is not None
    assert MIN_START_GOAL_DISTANCE == 2.0


def test_a_frozen_test_set_is_drawn_again_from_its_seed(small_map, monkeypatch, tmp_path):
    """Sizes are those asked for; a seed gives the same tasks, another seed others."""
    monkeypatch.setattr(HeldOutWorld, "map", lambda world: small_map)
    monkeypatch.setattr("mlivr_gym.agents.test_set.MIN_START_GOAL_DISTANCE", 0.5)
    sizes = {"same": 3, "half": 8, "dense": 2, "occupied": 10}
    seeds = {"a": 1, "b": 1, "c": 2}
    one, again, other = (freeze_test_set(tmp_path / n, k, sizes) for n, k in seeds.items())
    assert load_test_set(tmp_path / "a") == one == again != other
    assert [(w.split, w.spacing, w.sparse_seed, len(w.tasks)) for w in one] == [
        ("same", 0.2, None, 3),
        *(("half", 0.2, seed, 2) for seed in (1, 2, 3, 4)),
        ("dense", 0.1, None, 2),
        ("occupied", 0.2, None, 10),
    ]
    assert (tmp_path / "a").read_text() == (tmp_path / "b").read_text()
