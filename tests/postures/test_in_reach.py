"""Sets of points in reach, compared with every order of the limbs and every candidate base pose."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from paper import NO_COLLISIONS
from random_steps import neighbouring_points
from unequal_robots import unequal
from wrist_arms import Lengths

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.robot.limb import link_frames


@pytest.fixture(scope="module", params=["mlivr3", 4])
def graph(request):
    """Of limbs that are alike, and, by their number, of limbs that differ."""
    robot = request.param if isinstance(request.param, str) else unequal(request.param)
    return stance_graph(robot=robot, settings=NO_COLLISIONS)


def w_m_of(q, limb, scale):
    """Return `w_m` by the Jacobian of the joint axes, for joint angles of shape (..., 6)."""
    frames = link_frames(limb, q)[..., 1:, :, :]
    turns = frames[..., :3, 2]
    jacobians = np.concatenate([np.cross(frames[..., :3, 3], turns), turns], axis=-1)
    with np.errstate(invalid="ignore"):  # angles of branches that do not exist are NaN
        return np.abs(np.linalg.det(jacobians)) / scale**3


def least_w_m(graph, stances):
    """Return the best `w_m` of the worst limb at each candidate base pose of some stances."""
    candidates = [graph.solver.candidate_poses(stance) for stance in stances]
    positions, rotations = (np.concatenate(part) for part in zip(*candidates, strict=True))
    bases = Pose.rows(len(positions))
    bases["position"], bases["rotation"] = positions, rotations
    counts = [len(places) for places, _ in candidates]
    geometry = graph.solver.grasps[np.repeat(np.array(stances), counts, axis=0)]
    best, out = np.zeros(geometry.shape), Angles.rows(*geometry.shape)
    for branch in range(8):
        held_angles(graph.solver.shapes.rows, bases, geometry, np.full(geometry.shape, branch), out)
        for i, limb in enumerate(graph.robot.every_limb):
            w_m = w_m_of(out["q"][:, i], limb, graph.robot.characteristic_length)
            best[:, i] = np.fmax(best[:, i], w_m)
    return best.min(axis=1), positions


def test_a_set_is_in_reach_if_some_order_of_the_limbs_reaches_it(graph):
    """The base may be anywhere, or close to a target; values within rounding may go either way."""
    sets = np.sort(neighbouring_points(graph, 100 if graph.limbs == 3 else 180, 0), axis=1)
    found, asked = graph.solver.in_reach(sets), graph.solver.thresholds[0]["w_m"]
    target = graph.grasp_map.positions.mean(axis=0)
    nearby = graph.solver.in_reach(sets, target, 1.0)
    some = 0
    for points, anywhere, there in zip(sets, found, nearby, strict=True):
        w_m, places = least_w_m(graph, [*permutations(points)])
        away = np.linalg.norm(places - target, axis=1)
        inside = np.where(away <= 1.0, w_m, 0.0)
        for least, said in ((w_m.max(), anywhere), (inside.max(), there)):
            if abs(least - asked) > 1e-5:
                assert said == (least >= asked)
                some += said
    assert 10 < found.sum() < 130
    assert some > found.sum()


def test_sets_between_opposite_walls_are_reached_from_their_own_rolls_and_heights():
    """Two points on the deck and two overhead, at the best of their candidate base poses."""
    graph = stance_graph(
        robot="mlivr4", settings=Settings(collisions=False, limb_threshold=0.02)
    )  # more of them are in reach
    faces, rng = np.array(graph.grasp_map.faces), np.random.default_rng(3)
    deck, overhead = (np.flatnonzero(faces == name) for name in ("deck", "overhead"))
    sets = []
    while len(sets) < 60:
        points = [*rng.choice(deck, 2, False), *rng.choice(overhead, 2, False)]
        if all(graph.compatible[a, b] for a, b in permutations(points, 2)):
            sets.append(sorted(points))
    assert (
        np.linalg.norm(graph.grasp_map.normals[np.array(sets)].mean(axis=1), axis=1) < 0.2
    ).all()
    asked, inside = graph.limb_threshold, 0
    for points in sets:
        w_m, base = least_w_m(graph, [*permutations(points)])
        best = int(w_m.argmax())
        if abs(w_m[best] - asked) > 1e-5:
            found = graph.solver.in_reach(np.array([points]), base[best], 1e-3)[0]
            assert found == (w_m[best] >= asked)
            inside += found
    assert inside > 3


def first_joint_held(limbs, settings):
    """A robot of iiwas with an offset along axis 2 whose first joint is locked."""
    robot = robot_spec("mlivr2-iiwa")
    limb = Lengths(d2=0.15).limb(robot.limb.joint_limits, 1, 0.4)
    robot = replace(
        robot, limbs=limbs, limb=limb, folds=limb.default_folds, capsules=None, apart=()
    )
    return robot, replace(settings, limb_threshold=0.03, base_threshold=1e-5)


@pytest.mark.parametrize("collisions", [True, False])
def test_every_node_is_in_reach(collisions):
    """Every node is in reach at its own base, also where its first posture touches something."""
    settings = Settings(collisions=collisions)
    for robot in (("mlivr4", settings), (unequal(3), settings), first_joint_held(3, settings)):
        graph = stance_graph(None, *robot)
        stances = neighbouring_points(graph, 4000, 1)
        postures = graph.nodes(stances)
        nodes = np.flatnonzero(graph.is_node(postures))
        assert len(nodes) > 30
        assert graph.solver.in_reach(np.sort(stances[nodes], axis=1)).all()
        for k in nodes[:30]:
            assert graph.solver.in_reach(stances[k : k + 1], postures.base_position[k], 1e-6)[0]
