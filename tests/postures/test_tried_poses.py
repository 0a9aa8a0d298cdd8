"""Numbers of base poses against the postures that have them."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym import Settings, stance_graph
from mlivr_gym.postures.tried_poses import IN_PLACE, NO_POSE, bases_at, numbers_of
from mlivr_gym.stances.random_states import random_state


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3", "mlivr4"])
def test_a_number_tells_the_base_pose_of_a_node_as_it_was(jem, robot):
    graph, rng = stance_graph(jem, robot, Settings()), np.random.default_rng(4)
    stances = np.array([random_state(graph, rng).stance for _ in range(60)])
    postures = graph.nodes(stances)
    where = postures.base_position, postures.base_rotation
    numbers = numbers_of(jem, graph.robot, stances, *where)
    assert NO_POSE not in numbers
    assert len(set(numbers.tolist())) > 3
    for found, expected in zip(bases_at(jem, graph.robot, stances, numbers), where, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-12, rtol=0)
    for stance, number, position in zip(stances.tolist(), numbers.tolist(), where[0], strict=True):
        tried, _ = graph.solver.poses_tried(stance)
        apart = np.linalg.norm(tried - position, axis=1)
        # Heights run fastest in numbers, rolls in the list of the solver.
        rolls = len(graph.robot.rolls)
        place = number % IN_PLACE
        if len(tried) == rolls * len(graph.robot.heights):
            heights = len(graph.robot.heights)
            assert apart[place % heights * rolls + place // heights] < 1e-6
        assert apart.min() < 1e-6


def test_poses_found_among_boxes_are_counted_apart(jem):
    """They do not rest on rounded figures: points are moved here by less than those tell."""
    rng = np.random.default_rng(0)
    moved = replace(jem, positions=jem.positions + rng.uniform(-4e-8, 4e-8, jem.positions.shape))
    graph = stance_graph(moved, "mlivr4")
    stances = np.array([random_state(graph, rng).stance for _ in range(120)])
    postures = graph.nodes(stances)
    where = postures.base_position, postures.base_rotation
    numbers = numbers_of(moved, graph.robot, stances, *where)
    assert NO_POSE not in numbers
    assert 0 < (numbers >= IN_PLACE).sum() < len(numbers)
    for found, expected in zip(bases_at(moved, graph.robot, stances, numbers), where, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-12, rtol=0)
    off = where[0] + 1e-3
    assert (numbers_of(moved, graph.robot, stances, off, where[1]) == NO_POSE).all()
