"""A robot of many limbs is the same robot after a cyclic relabelling of its limbs."""

import numpy as np
import pytest
from compiled import called
from hypothesis import given, settings
from hypothesis import strategies as st
from random_steps import neighbouring_points
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, Settings, stance_graph
from mlivr_gym.postures.base_poses import first_limb


@pytest.mark.parametrize(("limbs", "collisions"), [(3, True), (4, False)])
def test_postures_turn_with_the_limbs(jem, limbs, collisions):
    """Pose, manipulability and branches are those of the stance, whichever limb comes first."""
    graph = stance_graph(jem, f"mlivr{limbs}", Settings(collisions=collisions))
    stances = neighbouring_points(graph, 1000 if limbs == 3 else 6000, limbs)
    found = graph.nodes(stances)
    geometry = graph.is_node(found)
    assert geometry.sum() > 40
    stances, found = stances[geometry], found.take(geometry)
    for relabelling in range(1, limbs):
        other = graph.nodes(np.roll(stances, -relabelling, axis=1))
        assert graph.is_node(other).all()
        np.testing.assert_allclose(other.base_position, found.base_position, atol=1e-12)
        yaw = Rotation.from_rotvec([0.0, 0.0, 2.0 * np.pi * relabelling / limbs]).as_matrix()
        np.testing.assert_allclose(other.base_rotation, found.base_rotation @ yaw, atol=1e-12)
        np.testing.assert_allclose(other.w_b, found.w_b, rtol=1e-9)
        for name in ("w_m", "branch", "branch_sets"):
            ours, theirs = getattr(other, name), np.roll(getattr(found, name), -relabelling, axis=1)
            np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def random_map(rng, count):
    """Return a map of points at small integers, of which some stances are images of themselves."""
    places = np.unique(rng.integers(0, 4, (4 * count, 3)), axis=0)
    places = places[rng.permutation(len(places))[:count]]
    return map_of([f"p{k}" for k in range(count)], places)


def map_of(ids, places):
    """Return a map of points on one face."""
    points = [
        {"id": name, "face": "deck", "position": p, "normal": [0, 0, 1], "rail": [1, 0, 0]}
        for name, p in zip(ids, places.tolist(), strict=True)
    ]
    return GraspMap.from_dict({"points": points})


def first_limbs(grasp_map, stances):
    """Return the first limb of each stance."""
    keys = np.empty((5, stances.shape[1]))
    return np.array([called(first_limb)(grasp_map.positions, stance, keys) for stance in stances])


def first_by_definition(positions):
    """Return the first limb of a stance, from the points that its limbs hold, by sorting."""
    limbs = len(positions)
    away = np.linalg.norm(positions - positions.mean(axis=0), axis=1)
    apart = np.linalg.norm(np.roll(positions, -1, axis=0) - positions, axis=1)
    keys = [*np.rint(np.array([away, apart]) / 1e-7), *positions.T]
    return min(range(limbs), key=lambda i: [np.roll(key, -i).tolist() for key in keys])


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), limbs=st.integers(3, 5))
def test_the_first_limb_is_that_of_the_definition_and_the_same_point_after_a_turn(seed, limbs):
    """Also in stances that are images of themselves, and for any numbering of the points."""
    rng = np.random.default_rng(seed)
    grasp_map = random_map(rng, 12)
    stances = np.array([rng.choice(12, limbs, replace=False) for _ in range(30)])
    first = first_limbs(grasp_map, stances)
    expected = [first_by_definition(grasp_map.positions[stance]) for stance in stances]
    assert first.tolist() == expected
    point = stances[np.arange(30), first]
    positions = grasp_map.positions[stances]
    away = np.linalg.norm(positions - positions.mean(axis=1, keepdims=True), axis=2)
    np.testing.assert_allclose(away[np.arange(30), first], away.min(axis=1), atol=1e-6)
    for relabelling in range(1, limbs):
        there = np.roll(stances, -relabelling, axis=1)
        np.testing.assert_array_equal(there[np.arange(30), first_limbs(grasp_map, there)], point)
    order = rng.permutation(12)
    shuffled = map_of([grasp_map.ids[k] for k in order], grasp_map.positions[order])
    number = {name: k for k, name in enumerate(shuffled.ids)}
    theirs = np.vectorize(lambda p: number[grasp_map.ids[p]])(stances)
    ids = [shuffled.ids[p] for p in theirs[np.arange(30), first_limbs(shuffled, theirs)]]
    assert ids == [grasp_map.ids[p] for p in point]
