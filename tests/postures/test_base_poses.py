"""Base poses of stances: their axes by definition, and poses by number."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stance_axes import axes_of

from mlivr_gym import stance_graph
from mlivr_gym.postures.base_poses import bases_at
from mlivr_gym.stances.random_states import random_state

YAWS = np.linspace(-np.pi, np.pi, 20_001)
SEEDS = st.integers(0, 2**32 - 1)


def unit(v):
    return v / np.linalg.norm(v)


def rejected(v, axis):
    """Return the part of a vector that is perpendicular to a unit axis, by a projection matrix."""
    return (np.eye(3) - np.outer(axis, axis)) @ v


def drawn(rng, limbs):
    """Return grasps relative to their centroid, normals on one side, and a rail on the first."""
    grasps = rng.normal(size=(limbs, 3))
    normals = np.array([unit(n) for n in rng.normal(size=(limbs, 3)) * 0.4 + [0.0, 0.0, 1.0]])
    return grasps - grasps.mean(axis=0), normals, unit(rejected(rng.normal(size=3), normals[0]))


@given(SEEDS)
def test_two_limbs_lie_along_the_line_of_their_grasps_under_their_normals(seed):
    grasps, normals, rail = drawn(np.random.default_rng(seed), 2)
    axes, out, line, opposed = axes_of(grasps, normals, rail)
    along = unit(grasps[0] - grasps[1])
    above = rejected(normals.mean(axis=0), along)
    if opposed:
        assert np.linalg.norm(above) < 0.2
        return
    np.testing.assert_allclose(line, along, atol=1e-9)
    np.testing.assert_allclose(out, unit(above), atol=1e-9)
    expected = np.stack([along, np.cross(unit(above), along), unit(above)], axis=1)
    np.testing.assert_allclose(axes, expected, atol=1e-9)


@pytest.mark.parametrize("limbs", [3, 4])
@given(seed=SEEDS)
def test_the_yaw_of_more_limbs_fits_their_mounts_best(limbs, seed):
    """Compared with all yaws on a grid, about the mean normal and, in reverse order, against it."""
    grasps, normals, rail = drawn(np.random.default_rng(seed), limbs)
    axes, out, _, opposed = axes_of(grasps, normals, rail)
    if opposed:
        return
    np.testing.assert_allclose(out, unit(normals.mean(axis=0)), atol=1e-12)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    angles = 2.0 * np.pi * np.arange(limbs) / limbs
    mounts = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    best = {}
    for sign in (1.0, -1.0):
        first = unit(rejected([1.0, 0.1, 0.3], out))
        second = np.cross(sign * out, first)
        x = np.cos(YAWS)[:, None] * first + np.sin(YAWS)[:, None] * second
        y = np.cross(sign * out, x)
        best[sign] = (mounts[:, 0] @ (grasps @ x.T) + mounts[:, 1] @ (grasps @ y.T)).max()
    fit = (mounts * (grasps @ axes[:, :2])).sum()
    assert fit == pytest.approx(max(best.values()), rel=1e-6)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    if abs(best[1.0] - best[-1.0]) > 1e-6:
        np.testing.assert_allclose(axes[:, 2], out if best[1.0] > best[-1.0] else -out, atol=1e-12)


def test_between_opposite_walls_the_robot_stands_off_across_the_line():
    """Towards the part of the rail across the line, or, if the rail lies along it, of the wall."""
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    grasps = np.array([[0.1, 0.0, -1.0], [-0.1, 0.0, 1.0]])
    line, rail = unit(grasps[0]), np.array([1.0, 0.0, 0.0])
    _, out, _, opposed = axes_of(grasps, normals, rail)
    assert opposed
    np.testing.assert_allclose(out, unit(rejected(rail, line)), atol=1e-12)
    grasps = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    _, out, _, opposed = axes_of(grasps, normals, rail)
    assert opposed
    np.testing.assert_allclose(out, np.cross(normals[0], rail), atol=1e-12)


def test_a_limb_over_the_centroid_has_the_rail_for_its_line():
    """Of three grasps the first lies in the middle of the others."""
    grasps = np.array([[0.0, 0.0, 0.0], [0.5, 0.2, 0.0], [-0.5, -0.2, 0.0]])
    normals, rail = np.tile([0.0, 0.0, 1.0], (3, 1)), np.array([0.0, 1.0, 0.0])
    _, _, line, _ = axes_of(grasps, normals, rail)
    np.testing.assert_array_equal(line, rail)


@pytest.mark.parametrize(("robot", "moved"), [("mlivr2", 0.0), ("mlivr2", 4e-8), ("mlivr4", 4e-8)])
def test_a_number_determines_the_base_pose_of_a_node_to_the_last_bit(small_map, robot, moved):
    """Also with points moved by less than the rounded coordinates resolve."""
    rng = np.random.default_rng(4)
    places = small_map.positions + rng.uniform(-moved, moved, small_map.positions.shape)
    graph = stance_graph(replace(small_map, positions=places), robot)
    stances = np.array([random_state(graph, rng).stance for _ in range(15)])
    postures = graph.nodes(stances)
    assert len(set(postures.pose_number.tolist())) > 3
    position, rotation = bases_at(graph.grasp_map, graph.robot, stances, postures.pose_number)
    np.testing.assert_array_equal(position, postures.base_position)
    np.testing.assert_array_equal(rotation, postures.base_rotation)
    for stance, number, base in zip(
        stances.tolist(), postures.pose_number.tolist(), postures.base_position, strict=True
    ):
        pose_number, _ = graph.solver.candidate_poses(stance)
        apart = np.linalg.norm(pose_number - base, axis=1)
        assert apart[number] < 1e-6
