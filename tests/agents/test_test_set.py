"""The frozen test set is what its description says."""

from mlivr_gym.agents.test_set import SPLITS, held_out_goals, load_test_set


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
