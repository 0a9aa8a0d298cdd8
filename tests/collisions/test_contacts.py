import itertools
import json
from dataclasses import replace

import coal
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, Capsule, GraspMap, RobotSpec, Settings, robot_spec, stance_graph
from mlivr_gym.collisions.collision_model import CollisionModel
from mlivr_gym.collisions.contacts import capsule_ends, contacts
from mlivr_gym.collisions.distances import CLEAR, segment_box_apart, segments_apart, stays_away
from mlivr_gym.collisions.limb_shapes import NEVER_NEARER, LimbShapes
from mlivr_gym.collisions.swept_swing import swing_free
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import SettingError, ShapeError, StanceError
from mlivr_gym.kinematics.base_path import STRAIGHT
from mlivr_gym.kinematics.holding import base_path, quaternion
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.motion.sampling import sampled_line
from mlivr_gym.motion.swings import SwingFinder
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation.scene import scene_spec, set_configuration
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_steps import edge_entry, turned
from mlivr_gym.stances.stance_graph import State
from mlivr_gym.world.boxes import load_obstacles

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)
ROBOT = robot_spec("mlivr2")
SHAPES = LimbShapes(ROBOT)


def vectors(low=-1.0, high=1.0):
    return st.lists(st.floats(low, high), min_size=3, max_size=3).map(np.array)


def coal_capsule(radius, start, end):
    along = end - start
    length = float(np.linalg.norm(along))
    turn = (
        Rotation.align_vectors([along / length], [[0.0, 0.0, 1.0]])[0].as_matrix()
        if length > 1e-6
        else np.eye(3)
    )
    return coal.Capsule(float(radius), length), coal.Transform3s(turn, 0.5 * (start + end))


def apart(first, second):
    result = coal.DistanceResult()
    return coal.distance(first[0], first[1], second[0], second[1], coal.DistanceRequest(), result)


@given(vectors(), vectors(), vectors(0.05, 0.6))
@examples(max_examples=300, deadline=None)
def test_segment_to_box_agrees_with_coal(start, end, half):
    if np.linalg.norm(end - start) < 1e-3:
        return
    ours = np.sqrt(segment_box_apart(tuple(start), tuple(end - start), tuple(half)))
    theirs = apart(
        coal_capsule(1e-3, start, end), (coal.Box(*(2.0 * half)), coal.Transform3s.Identity())
    )
    assert ours == pytest.approx(max(theirs + 1e-3, 0.0), abs=2e-4)


@given(vectors(), vectors(), vectors(), vectors())
@examples(max_examples=300, deadline=None)
def test_segment_to_segment_agrees_with_coal(a, b, c, d):
    if min(np.linalg.norm(b - a), np.linalg.norm(d - c)) < 1e-3:
        return
    ours = np.sqrt(segments_apart(tuple(a), tuple(b - a), tuple(c), tuple(d - c)))
    theirs = apart(coal_capsule(1e-3, a, b), coal_capsule(1e-3, c, d)) + 2e-3
    assert ours == pytest.approx(max(theirs, 0.0), abs=2e-4)


@given(
    st.booleans(),
    vectors(),
    vectors(),
    vectors(),
    vectors(),
    st.floats(0.01, 0.8),
    st.floats(0.01, 0.8),
)
@examples(max_examples=300, deadline=None)
def test_an_axis_is_compared_with_a_length_that_changes_along_it(
    box, start, end, first, second, at_start, at_end
):
    """Told apart as samples tell it, but for what rounding or the number of places leaves open."""
    shape = np.abs(first) + 0.05 if box else first
    answer = stays_away(
        box, tuple(shape), tuple(second - first), tuple(start), tuple(end - start), at_start, at_end
    )
    t = np.linspace(0.0, 1.0, 2001)
    points = start + t[:, None] * (end - start)
    if box:
        distance = np.linalg.norm(np.maximum(np.abs(points) - shape, 0.0), axis=1)
    else:
        along = second - first
        share = np.clip((points - first) @ along / max(along @ along, 1e-14), 0.0, 1.0)
        distance = np.linalg.norm(points - first - share[:, None] * along, axis=1)
    spare = (distance - at_start - t * (at_end - at_start)).min()
    if answer:
        assert spare >= -1e-9
    elif spare > 0.0:
        assert spare < 0.01


def test_capsules_lie_where_mujoco_has_them(jem):
    model = scene_spec(jem, ROBOT).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(5):
        turn = Rotation.random(rng=rng).as_quat(scalar_first=True)
        here = (
            rng.uniform(-1, 1, 3),
            turn if turn[0] > 0 else -turn,
            rng.uniform(-np.pi, np.pi, (2, 6)),
        )
        set_configuration(model, data, *here)
        ends = capsule_ends(ROBOT, SHAPES, here)
        for i in range(2):
            for c, name in enumerate(SHAPES.names):
                geom = model.geom(f"limb{i}/{name}/0").id
                axis = data.geom_xmat[geom].reshape(3, 3)[:, 2] * model.geom_size[geom, 1]
                found = np.stack([data.geom_xpos[geom] - axis, data.geom_xpos[geom] + axis])
                order = np.argsort(np.linalg.norm(found - ends[i, c, 0], axis=1))
                np.testing.assert_allclose(found[order], ends[i, c], atol=1e-7)
                assert model.geom_size[geom, 0] == pytest.approx(SHAPES.arrays[2][c])


def test_links_that_are_not_compared_never_meet():
    """Of links two joints apart that are left out no posture brings two nearer than touching; neighbours are joined."""
    left_out = {tuple(sorted((a, b))) for a, b in NEVER_NEARER}
    compared = {tuple(SHAPES.arrays[0][[i, j]].tolist()) for i, j in SHAPES.arrays[3]}
    rng = np.random.default_rng(1)
    least = dict.fromkeys(left_out, np.inf)
    for _ in range(3000):
        here = (np.zeros(3), np.array([1.0, 0, 0, 0]), rng.uniform(-np.pi, np.pi, (2, 6)))
        ends = capsule_ends(ROBOT, SHAPES, here)[0]
        for i, j in itertools.combinations(range(len(SHAPES)), 2):
            pair = tuple(SHAPES.arrays[0][[i, j]].tolist())
            if pair in left_out and pair not in compared:
                gap = np.sqrt(
                    segments_apart(
                        tuple(ends[i, 0]),
                        tuple(ends[i, 1] - ends[i, 0]),
                        tuple(ends[j, 0]),
                        tuple(ends[j, 1] - ends[j, 0]),
                    )
                )
                least[pair] = min(least[pair], gap - SHAPES.arrays[2][i] - SHAPES.arrays[2][j])
    assert min(least.values()) > 0.0


def penetrating(model, data, own):
    """Names of a pair that overlaps, grippers with the track they hold left out."""
    mujoco.mj_forward(model, data)
    for k in range(data.ncon):
        a, b = (model.geom(g).name for g in data.contact.geom[k])
        if data.contact.dist[k] < -1e-6 and (a, b) not in own and (b, a) not in own:
            return a, b
    return None


def tracks(graph, stance):
    return {
        (f"limb{i}/gripper/0", "box/" + graph.grasp_map.ids[p].split(":")[0])
        for i, p in enumerate(stance)
    }


def test_free_stances_penetrate_nothing_in_mujoco(checked_graph):
    graph = checked_graph
    model = scene_spec(graph.grasp_map, graph.robot).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    for s in rng.choice(len(graph), 300, replace=False):
        stance = tuple(graph.points[s].tolist())
        masks = (
            1 << int(rng.choice([b for b in range(16) if m >> b & 1]))
            for m in graph.mask[s].tolist()
        )
        set_configuration(model, data, *graph.configuration(State(stance, tuple(masks))))
        assert penetrating(model, data, tracks(graph, stance)) is None


def test_every_stance_left_out_touches_something(checked_graph, graph):
    """The best posture of a stance that only collisions keep out lies nearer than the clearance, pair by pair."""
    rng = np.random.default_rng(3)
    missing = [s for s in range(len(graph)) if checked_graph.find(graph.points[s].tolist()) < 0]
    assert len(missing) == sum(checked_graph.removed.values())
    for s in rng.choice(missing, 60, replace=False):
        a, b = graph.points[s].tolist()
        masks = tuple(1 << int(branch) for branch in graph.branch[s])
        here = graph.configuration(graph.state((a, b))._replace(masks=masks))
        grasps = [(i, graph.solver.points[p], graph.solver.normals[p]) for i, p in ((0, a), (1, b))]
        assert contacts(graph.robot, graph.grasp_map.boxes, here, 0.02, grasps)


@pytest.mark.parametrize(("robot", "seed"), [("mlivr2", 0), ("mlivr2", 1), ("mlivr3", 0)])
def test_plans_penetrate_nothing_in_mujoco(jem, checked_graph, robot, seed):
    graph = checked_graph if robot == "mlivr2" else stance_graph(jem, robot)
    model = scene_spec(jem, graph.robot).compile()
    data = mujoco.MjData(model)
    start, goal = sample_task(graph, np.random.default_rng(seed), 0.2)
    plan = Planner(graph).plan(start.stance, goal, "weighted", regrasp_price=0.2).unwrap()
    for k, step in enumerate(plan.steps):
        assert step.swing in ("direct", "over", "folded", "sampled")
        motion = step_motion(graph, plan, k, 12)
        own = set().union(*(tracks(graph, graph.indices(plan.stances[n])) for n in (k, k + 1)))
        np.testing.assert_allclose(
            motion.joint_positions[0], plan.motion.joint_positions[k], atol=1e-6
        )
        np.testing.assert_allclose(
            motion.joint_positions[-1], plan.motion.joint_positions[k + 1], atol=1e-6
        )
        for n in range(len(motion.phase)):
            set_configuration(
                model,
                data,
                motion.base_positions[n],
                motion.base_quaternions[n],
                motion.joint_positions[n],
            )
            assert penetrating(model, data, own) is None


angles = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array)


@given(angles, angles, vectors(-0.9, 0.9), st.floats(0.0005, 0.05))
@examples(max_examples=100, deadline=None)
def test_no_thin_plate_is_skipped(q0, q1, centre, half):
    """A swing called clear of a plate of a millimetre keeps its clearance at every one of many samples."""
    plate = Box("plate", "obstacle", tuple(centre), (0.2, half, 0.2))
    shapes, gripper, hand, fixed, world, clearance, body = CollisionModel(
        SHAPES, (plate,), 0.02
    ).arrays
    here = (
        np.zeros(3),
        np.eye(3),
        np.array([0.3, 0.1, -0.2]),
        Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix(),
    )
    path = (*here, STRAIGHT, np.zeros(3))
    mount = ROBOT.mount_rotations[0], ROBOT.mount_positions[0]
    answer = swing_free(
        0, path, 0.0, 1.0, q0, q1, ROBOT.limb.lengths, *mount, np.empty((0, len(SHAPES), 2, 3)),
        shapes, fixed, world, clearance,
        True, body,
    )  # fmt: skip
    least = np.inf
    where, turned = base_path(*path, np.linspace(0.0, 1.0, 80))
    for k, s in enumerate(np.linspace(0.0, 1.0, 80)):
        joints = np.array([q0 + s * (q1 - q0), np.zeros(6)])
        found = contacts(ROBOT, (plate,), (where[k], quaternion(turned[k]), joints), 0.02)
        own = [c for c in found if c.first.startswith("limb0") and c.second[:6] not in ("limb1/",)]
        least = min([least, *(c.distance for c in own)])
    if answer == CLEAR:
        assert least >= 0.02 - 1e-9


def test_whole_graph_and_lazy_graph_agree(small_map, small_checked_graph):
    graph = small_checked_graph
    lazy = LazyGraph(small_map, graph.robot, graph.settings)
    rng = np.random.default_rng(5)
    looked = 0
    for s in rng.permutation(len(graph)):
        stance = tuple(graph.points[s].tolist())
        ours, theirs = graph.successors(graph.state(stance)), lazy.successors(lazy.state(stance))
        np.testing.assert_array_equal(ours.limb, theirs.limb)
        np.testing.assert_array_equal(ours.point, theirs.point)
        # The whole graph looks for the branches that serve most and stops there.
        assert not (ours.masks & ~theirs.masks).any()
        looked += 1
        if looked == 6:
            return


def test_plans_among_obstacles_are_optimal(small_checked_graph):
    """The exact table, made by a search of its own, and Dijkstra agree with A* that learns what is blocked."""
    graph, rng = small_checked_graph, np.random.default_rng(6)
    start, goal = sample_task(graph, rng, 0.3)
    planner = Planner(graph)
    for boxes in ((), (Box.between("crate", "obstacle", (1.4, -0.3, -0.9), (1.7, 0.3, -0.4)),)):
        graph.add_obstacles(boxes)
        costs = [
            planner.plan(start.stance, goal, method=method).plan for method in ("astar", "dijkstra")
        ]
        exact = planner.cost_to_go(goal).value(graph.state(start.stance))
        assert all(plan.statistics.cost == pytest.approx(exact) for plan in costs)
    graph.remove_obstacles()


def test_a_larger_clearance_leaves_fewer_stances(small_map):
    sizes = [
        len(stance_graph(small_map, settings=Settings(clearance=c))) for c in (0.0, 0.012, 0.024)
    ]
    assert sizes[0] >= sizes[1] >= sizes[2]
    assert sizes[0] > sizes[2]


def test_obstacles_take_away_and_give_back(checked_graph):
    graph, planner = checked_graph, Planner(checked_graph)
    free = planner.plan(START, GOAL, "steps").unwrap()
    before = graph.successors(graph.state(START))
    box = Box.between("crate", "obstacle", (3.4, -1.0, -1.0), (3.7, 1.0, 0.2))
    graph.add_obstacles([box])
    hindered = planner.plan(START, GOAL, "steps").unwrap()
    assert hindered.cost >= free.cost
    assert hindered.obstacles == (box,)
    for k in range(len(hindered.steps)):
        motion = step_motion(graph, hindered, k, 10)
        for n in range(len(motion.phase)):
            here = (motion.base_positions[n], motion.base_quaternions[n], motion.joint_positions[n])
            assert not contacts(graph.robot, (box,), here, 0.02 - 1e-9)
    assert Plan.from_dict(
        json.loads(json.dumps(hindered.to_dict())), graph.grasp_map
    ).obstacles == (box,)
    graph.remove_obstacles(["crate"])
    after = graph.successors(graph.state(START))
    for ours, theirs in zip(before, after, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert planner.plan(START, GOAL, "steps").unwrap().stances == free.stances


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_occupied_points_are_not_grasped(jem, checked_graph, robot):
    graph = checked_graph if robot == "mlivr2" else stance_graph(jem, robot)
    start, goal = sample_task(graph, np.random.default_rng(0), 0.2)
    cost = {"cost": "weighted", "regrasp_price": 0.2}
    plan = Planner(graph).plan(start.stance, goal, **cost).unwrap()
    held = set(plan.stances[0])
    taken = sorted({point for stance in plan.stances for point in stance} - held)[:2]
    graph.occupy(taken)
    result = Planner(graph).plan(start.stance, goal, **cost)
    if result.plan is not None:
        assert not any(point in taken for stance in result.plan.stances for point in stance)
    graph.occupy([plan.stances[0][0]])
    assert Planner(graph).plan(plan.stances[0], goal).reason == "start infeasible"
    with pytest.raises(StanceError, match="occupied"):
        graph.state(plan.stances[0])
    graph.vacate()
    assert Planner(graph).plan(start.stance, goal, **cost).unwrap().stances == plan.stances


def test_a_sampled_line_is_clear_and_reproducible(checked_graph):
    graph = checked_graph
    s = graph.find(graph.indices(START))
    path = (
        graph.position[s],
        graph.rotation[s],
        graph.position[s],
        graph.rotation[s],
        STRAIGHT,
        graph.position[s],
    )
    finder = SwingFinder(graph, 0, path, [])
    start, end = (np.array([0.0, *fold, 0.0]) for fold in graph.robot.folds[:2])
    way = sampled_line(finder.clear, finder.graph.robot.limb.limits, start, end)
    np.testing.assert_allclose(way[[0, -1]], [start, end])
    np.testing.assert_array_equal(
        way, sampled_line(finder.clear, finder.graph.robot.limb.limits, start, end)
    )
    assert finder.clear(way)


def test_edges_serve_both_directions(checked_graph):
    graph, rng = checked_graph, np.random.default_rng(8)
    for s in rng.choice(len(graph), 10, replace=False):
        for held in range(2):
            for other in graph.row(held, int(s))[:5]:
                back = edge_entry(held, int(other), int(s), graph.edges)
                assert edge_entry(held, int(s), int(other), graph.edges) == turned(back)


def test_own_shapes_and_boxes(ladder, tmp_path):
    """A map's own box and a robot's thicker capsules take stances away."""
    plain = stance_graph(ladder, settings=Settings(limb_threshold=0.05))
    data = {
        "segments": [
            {"id": f"R{k}", "face": "deck", "start": [x, -0.4, 0.0], "end": [x, 0.4, 0.0], "normal": [0, 0, 1]}
            for k, x in enumerate((0.0, 0.9, 1.8))
        ],
        "boxes": [{"id": "shelf", "min": [-0.5, -0.5, 0.45], "max": [2.3, 0.5, 0.55]}],
    }  # fmt: skip
    shelved = GraspMap.from_dict(data)
    assert shelved.fingerprint != ladder.fingerprint
    try:
        left = len(stance_graph(shelved, settings=Settings(limb_threshold=0.05)))
    except ValueError:
        left = 0
    assert left < len(plain)
    thick = tuple(
        replace(c, radius=1.3 * c.radius) if c.link == "forearm" else c for c in ROBOT.shapes
    )
    robot = RobotSpec.from_dict(json.loads(json.dumps(replace(ROBOT, capsules=thick).to_dict())))
    assert robot.shapes == thick
    assert len(stance_graph(ladder, robot, Settings(limb_threshold=0.05))) <= len(plain)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"id": "a", "min": [0, 0, 0], "max": [0, 1, 1]}, "min .* must be below max"),
        ({"id": "a", "min": [0, 0, 0], "max": ["x", 1, 1]}, "must be numbers"),
        ({"id": "a", "centre": [0, 0, 0], "half": [1, -1, 1]}, "half edges"),
        (
            {
                "id": "a",
                "centre": [0, 0, 0],
                "half": [1, 1, 1],
                "rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]],
            },
            "rotation",
        ),
        ({"id": "a", "centre": [0, 0, 0]}, "its place is missing"),
        ({"id": "a", "min": [0, 0, 0], "max": [1, 1, 1], "colour": 1}, "unknown field 'colour'"),
        ({"id": "a", "min": [0, 0, 0], "max": [1, 1, 1], "kind": "cloud"}, "unknown kind 'cloud'"),
        ({"min": [0, 0, 0], "max": [1, 1, 1]}, "'id'"),
        ("box", "'id'"),
    ],
)
def test_faulty_boxes_are_named(entry, message):
    with pytest.raises(ShapeError, match=message):
        Box.from_dict(entry)


def test_faulty_capsules_and_obstacles_are_named(checked_graph, graph, tmp_path):
    with pytest.raises(ShapeError, match="unknown link 'hip'"):
        Capsule("hip", (0, 0, 0), (0, 0, 1), 0.1)
    with pytest.raises(ShapeError, match="above 0"):
        Capsule("forearm", (0, 0, 0), (0, 0, 1), 0.0)
    with pytest.raises(ShapeError, match="flange axis"):
        Capsule("gripper", (0, 0.1, 0), (0, 0, 1), 0.1)
    box = Box.between("crate", "obstacle", (0, 0, 0), (1, 1, 1))
    with pytest.raises(ShapeError, match="there already"):
        checked_graph.add_obstacles([box, box])
    with pytest.raises(ShapeError, match="no obstacle 'chair'"):
        checked_graph.remove_obstacles(["chair"])
    with pytest.raises(SettingError, match="collisions=True"):
        graph.add_obstacles([box])
    path = tmp_path / "obstacles.json"
    path.write_text(json.dumps({"boxes": [box.to_dict()], "occupied": ["D3a:4"]}))
    assert load_obstacles(path) == ((box,), ("D3a:4",))
    for text in ("[]", "{", '{"boxes": [], "things": 1}', '{"occupied": [3]}'):
        path.write_text(text)
        with pytest.raises(ShapeError, match=r"obstacles\.json"):
            load_obstacles(path)
    with pytest.raises(SettingError, match="clearance"):
        Settings(clearance=-0.1)
