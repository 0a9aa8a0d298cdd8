"""The frozen test set is what its description says."""

import json

import pytest

from mlivr_gym.agents.test_set import SPLITS, held_out_goals, load_test_set
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError


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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda data: data["worlds"][2].update(split="hard"), r"worlds\[2\]\.split is 'hard'"),
        (lambda data: data["worlds"][0]["tasks"][1].pop("goal"), r"tasks\[1\]\.goal is missing"),
        (lambda data: data["worlds"][0]["tasks"][1].update(goal=3), r"tasks\[1\]\.goal is 3"),
        (lambda data: data.update(worlds=7), r"worlds is 7; it must be a list"),
        (lambda data: data.update(rules=[1]), r"made by rules \[1\]"),
    ],
)
def test_a_faulty_test_set_is_named(tmp_path, change, words):
    data = json.loads(asset_path("test_set.json").read_text())
    change(data)
    path = tmp_path / "tasks.json"
    path.write_text(json.dumps(data))
    with pytest.raises(MlivrError, match=rf"^test set '.*tasks\.json': .*{words}"):
        load_test_set(path)
