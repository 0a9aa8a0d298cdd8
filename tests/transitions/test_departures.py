"""Departures: on the normal at knots and near it between them, inside the windows, both ways."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from random_steps import neighbouring_points

from mlivr_gym import Limb, robot_spec, stance_graph
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.rigid import rigid
from mlivr_gym.transitions.departures import OFF_NORMAL, Departure, departure_of

SHARES = np.linspace(0.0, 1.0, 11)


def departures(graph, count, seed):
    """Limb, base, grasp, and the knots and flips of a departure on every branch of random nodes."""
    points = neighbouring_points(graph, count, seed)
    postures = graph.postures(points)
    nodes = np.flatnonzero(graph.is_node(postures))
    for s in nodes:
        for limb in range(graph.limbs):
            grasp, base = graph.solver.grasps[points[s, limb]], postures.base_rows[s]
            for branch in range(8):
                if int(postures.branch_sets[s, limb]) >> branch & 0x101:
                    to = Departure.row()
                    flips = departure_of(graph.checks.robots, limb, base, grasp, branch, to)
                    yield limb, base, grasp, to["knots"]["q"][: int(to["pieces"]) + 1], int(flips)


def flange_in_world(spec, limb, base, q):
    """Frame of a limb's flange in the world, shape (4, 4)."""
    mount = rigid(spec.mount_rotations[limb], spec.mount_positions[limb])
    frame = rigid(base["rotation"], base["position"])
    return frame @ mount @ link_frames(spec.every_limb[limb], q)[6]


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3", "mlivr2-iiwa"])
def test_a_limb_departs_along_the_normal(small_map, robot):
    """By forward kinematics, at samples of each piece; the flange keeps its direction at knots."""
    graph, done = stance_graph(small_map, robot), 0
    for limb, base, grasp, knots, flips in departures(graph, 400, 1):
        if not flips:
            continue
        flange, lift = grasp["flange"], graph.robot.lift
        start, normal = flange["position"], flange["rotation"][:, 2]
        for k, q in enumerate(knots):
            frame = flange_in_world(graph.robot, limb, base, q)
            there = start - lift * k / (len(knots) - 1) * normal
            np.testing.assert_allclose(frame[:3, 3], there, atol=1e-8)
            np.testing.assert_allclose(frame[:3, 2], normal, atol=1e-8)
        for first, last in pairwise(knots):
            assert np.abs(last - first).max() < 1.0
            for s in SHARES:
                frame = flange_in_world(graph.robot, limb, base, first + s * (last - first))
                away = frame[:3, 3] - start
                across = away - (away @ normal) * normal
                assert np.linalg.norm(across) <= 1.02 * OFF_NORMAL
        done += 1
        if done == 60:
            return
    assert done > 20


def test_knots_stay_in_the_windows_with_each_flip_that_is_kept(small_map):
    """Narrow windows of all joints; flip 1 turns joint 6 by half a turn on every knot."""
    limits = ((-2.0, 2.0),) * 6
    limb = Limb(joint_limits=limits, window_starts=(-2.0,) * 6)
    graph = stance_graph(small_map, replace(robot_spec("mlivr2"), limb=limb))
    told = {0: 0, 1: 0, 2: 0}
    for _, _, _, knots, flips in departures(graph, 600, 2):
        kept = []
        for flip in range(2):
            turned = knots + np.array([0, 0, 0, 0, 0, np.pi * flip])
            wound = turned + 2.0 * np.pi * np.arange(-2, 3)[:, None, None]
            if (np.abs(wound) <= 2.0 + 1e-6).all(axis=1).any(axis=0).all():
                kept.append(flip)
        assert [flip for flip in range(2) if flips >> 8 * flip & 0xFF] == kept
        told[len(kept)] += 1
    assert min(told[1], told[2]) > 0
