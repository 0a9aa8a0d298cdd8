"""Environments of three and four limbs with the table of all nodes, and without."""

import gymnasium
import numpy as np
import pytest
from small_tables import small_table

from mlivr_gym.stances import node_table_file
from mlivr_gym.stances.table_files import key_of


@pytest.mark.parametrize("limbs", [3, 4])
def test_episodes_are_the_same_with_the_table(limbs, monkeypatch):
    graph, table = small_table(limbs)
    made, seen = {"robot": f"mlivr{limbs}", "map": graph.grasp_map}, []
    for known in ({}, {key_of(graph): table}):
        monkeypatch.setattr(node_table_file, "_cached", known)
        env, episodes = gymnasium.make("MLIVR-JEM-v0", goal_tolerance=0.05, **made), []
        assert (env.unwrapped.graph.table is table) == bool(known)
        rng = np.random.default_rng(1)
        for seed in range(3):
            _, info = env.reset(seed=seed)
            for _ in range(8):
                episodes.append((info["stance"], info["action_mask"].tolist()))
                able = np.flatnonzero(info["action_mask"])
                if not len(able):
                    break
                _, _, done, _, info = env.step(rng.choice(able))
                if done:
                    break
        seen.append(episodes)
    assert seen[0] == seen[1]
    assert len(seen[0]) > 9
