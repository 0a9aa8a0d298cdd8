"""Base poses of stances: their axes, which are in reach, nodes, and relabelled limbs."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from compiled import called
from hypothesis import given, settings
from hypothesis import strategies as st
from paper import NO_COLLISIONS
from random_steps import neighbouring_points
from scipy.spatial.transform import Rotation
from stance_axes import axes_of
from unequal_robots import unequal
from wrist_arms import Lengths

from mlivr_gym import GraspMap, Settings, robot_spec, stance_graph
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.base_poses import bases_at, first_limb
from mlivr_gym.postures.postures import FIELDS
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.limb import link_frames
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


def test_stances_have_the_same_postures_alone_as_with_others(jem):
    """Those of the same relative geometry share one, also where a box changes it."""
    graph = stance_graph(jem, "mlivr3")
    stances = neighbouring_points(graph, 100, 0)
    stances = np.concatenate([stances, np.roll(stances, 1, axis=1)])
    # Points along a rail have the same surroundings, or others.
    stances = np.concatenate([stances, np.minimum(stances + 1, len(jem) - 1)])
    together = graph.solver.solve(stances)
    for k in range(0, len(stances), 3):
        alone = PostureSolver(jem, graph.robot, graph.settings).solve(stances[[k]])
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(together, name)[k], getattr(alone, name)[0])
    assert (together.branch_sets > 0).all(axis=1).sum() > 30


def test_counts_agree_with_the_independent_calculation(jem):
    """43,540 ordered pairs within 2.4 m, 27,010 in reach by heights alone, no opposite walls."""
    graph = stance_graph(
        jem,
        replace(robot_spec("mlivr2"), rolls=(0.0,)),
        Settings(collisions=False, manipulability=False, transitions=False),
    )
    assert graph.listed.counts["considered"] == 43540
    normals = jem.normals[graph.points]
    opposed = (normals[:, 0] * normals[:, 1]).sum(axis=1) < -0.5
    assert (~opposed).sum() == 27010
    kept = (graph.w_m.min(axis=1) >= 0.1) & (graph.w_b >= 0.001) & ~opposed
    assert abs(kept.sum() - 20842) < 0.01 * 20842


@pytest.mark.parametrize(
    ("robot", "rules"),
    [("mlivr2", {}), ("mlivr3", {"manipulability": False}), ("mlivr4", {"collisions": False})],
)
def test_nodes_are_those_of_the_postures(small_map, robot, rules):
    graph, again = (stance_graph(small_map, robot, Settings(**rules)) for _ in range(2))
    rng = np.random.default_rng(0)
    rows = np.array([rng.permutation(len(small_map))[: graph.limbs] for _ in range(300)])
    rows = rows[[graph.compatible[np.ix_(row, row)].sum() == graph.limbs**2 - graph.limbs
                 for row in rows]]  # fmt: skip
    nodes, postures = graph.nodes(rows), again.postures(rows)
    node = again.is_node(postures)
    np.testing.assert_array_equal(graph.is_node(nodes), node)
    # Solved on request afterwards, rejected stances have the results of a fresh graph.
    for found, kept in ((nodes, node), (graph.postures(rows), slice(None))):
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(found, name)[kept], getattr(postures, name)[kept])
    assert 0 < node.sum() < len(rows)


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
