"""Boxes from files stand where they should; what boxes and own shapes take away is what touches."""

import json
from collections import Counter
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from coal_ruler import Ruler, grasps_of, obstacles
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, Capsule, GraspMap, Settings, robot_spec, stance_graph
from mlivr_gym.collisions.collision_model import CollisionModel
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.collisions.distances import CLEAR, OBSTACLE
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.link_capsules import EVERY, against_boxes
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.scene import scene_spec
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_steps import DIRECT, PAIR_BITS, edge_entry
from mlivr_gym.stances.stance_graph import State
from mlivr_gym.world.boxes import load_obstacles

ROBOT = robot_spec("mlivr2")
CLEARANCE = 0.02
vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)
halves = st.lists(st.floats(0.05, 0.5), min_size=3, max_size=3).map(np.array)


@given(vectors, halves, vectors, vectors)
@examples(max_examples=60, deadline=None)
def test_a_box_is_what_it_was_after_a_file(tmp_path_factory, centre, half, turn, point):
    """Its fields, where MuJoCo puts it, and which points the compiled check finds in it."""
    rotation = Rotation.from_rotvec(turn).as_matrix()
    box = Box("crate", "obstacle", tuple(centre), tuple(half), Box.rows(rotation))
    path = tmp_path_factory.getbasetemp() / "crate.json"
    path.write_text(json.dumps({"boxes": [box.to_dict()]}))
    (loaded,), _ = load_obstacles(path)
    assert loaded == box
    assert Box.from_dict(box.to_dict()) == box
    np.testing.assert_allclose(loaded.rotation, rotation, atol=1e-15)
    model = scene_spec(FLOOR, ROBOT, (loaded,)).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = model.geom("box/crate").id
    np.testing.assert_allclose(data.geom_xmat[geom].reshape(3, 3), rotation, atol=1e-7)
    np.testing.assert_allclose(data.geom_xpos[geom], centre, atol=1e-12)
    # A speck at a place in the box's own axes, inside or outside.
    local = 1.2 * half * np.clip(point, -1.0, 1.0)
    inside = bool((np.abs(local) < half).all())
    place = np.repeat((centre + rotation @ local)[None, None], 2, axis=1)
    world = CollisionModel(SHAPES, (loaded,), 0.0).arrays[4]
    speck, nowhere = np.array([1e-9]), np.zeros(3)
    still = np.zeros((1, 2))
    answer, _ = against_boxes(place, still, EVERY, 1, speck, world, 1, nowhere, nowhere, 0.0)
    assert answer == (OBSTACLE if inside else CLEAR)


FLOOR = GraspMap.from_dict(
    {
        "segments": [
            {
                "id": "R",
                "face": "deck",
                "start": [-0.4, 0, 0],
                "end": [0.4, 0, 0],
                "normal": [0, 0, 1],
            }
        ]
    }
)
SHAPES = LimbShapes(ROBOT)


def test_a_step_is_the_same_in_both_directions(small_map):
    """Asked for in one graph forwards, and in another, that does not know it yet, backwards."""
    first, second = stance_graph(small_map), stance_graph(small_map)
    rng, found = np.random.default_rng(0), Counter()
    for _ in range(800):
        s, held = int(rng.integers(len(first))), int(rng.integers(2))
        other = int(rng.choice(first.row(held, s)))
        forth, back = (
            edge_entry(held, s, other, first.edges),
            edge_entry(held, other, s, second.edges),
        )
        found["possible" if forth & 0xFFFF else "blocked"] += 1
        if not forth & DIRECT:
            assert forth == back
            continue
        # The branches before and after the swing change places.
        before, after = divmod(forth >> PAIR_BITS & 63, 8)
        assert forth - (forth >> PAIR_BITS << PAIR_BITS) == back - (back >> PAIR_BITS << PAIR_BITS)
        assert back >> PAIR_BITS == 8 * after + before
        found["swapped"] += before != after
    assert min(found.values()) > 5
    assert len(found) == 3


def test_whole_graph_and_lazy_graph_keep_the_same_branches(small_map, small_checked_graph):
    """The limb that moves lands on the same; the one that holds keeps some of them, mostly all."""
    graph, rng = small_checked_graph, np.random.default_rng(1)
    lazy = LazyGraph(small_map, graph.robot, graph.settings)
    same = []
    for s in rng.choice(len(graph), 6, replace=False):
        stance = tuple(graph.points[s].tolist())
        ours, theirs = graph.successors(graph.state(stance)), lazy.successors(lazy.state(stance))
        rows, held = np.arange(len(ours.limb)), 1 - ours.limb
        np.testing.assert_array_equal(ours.masks[rows, ours.limb], theirs.masks[rows, theirs.limb])
        mine, whole = ours.masks[rows, held], theirs.masks[rows, held]
        assert (mine > 0).all()
        assert not (mine & ~whole).any()
        same += (mine == whole).tolist()
    assert len(same) > 50
    assert np.mean(same) > 0.5


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_a_plan_goes_round_occupied_points(small_map, small_checked_graph, robot):
    """There is one, it takes hold of none of them, and costs no less."""
    graph = small_checked_graph if robot == "mlivr2" else stance_graph(small_map, robot)
    rng, cost, round_them = np.random.default_rng(2), {"cost": "weighted", "regrasp_price": 0.2}, 0
    for _ in range(4):
        start, goal = sample_task(graph, rng, 0.4)
        plan = Planner(graph).plan(start.stance, goal, **cost).unwrap()
        used = {point for stance in plan.stances for point in stance}
        taken = sorted(used - set(plan.stances[0]))[:1]
        try:
            graph.occupy(taken)
            other = Planner(graph).plan(start.stance, goal, **cost).plan
        finally:
            graph.vacate()
        if other is not None:
            round_them += 1
            assert not any(set(stance) & set(taken) for stance in other.stances)
            assert graph.limbs > 2 or other.cost >= plan.statistics.cost - 1e-9
    assert round_them >= 2


def best_postures(graph, stances):
    """Configuration of each stance in its best posture, and its grasps."""
    for stance in stances:
        s = graph.find(stance)
        masks = tuple(1 << int(branch) for branch in graph.branch[s])
        yield graph.configuration(State(tuple(stance), masks)), grasps_of(graph, enumerate(stance))


def test_a_shelf_and_a_mast_take_away_what_they_touch(ladder):
    """A map's own box, and a capsule across each forearm.

    Stances that are gone touch in their best posture, those that are left keep the clearance.
    """
    settings = Settings(limb_threshold=0.05)
    shelf = Box.between("shelf", "obstacle", (0.3, -0.5, 0.5), (0.6, 0.5, 0.55))
    mast = Capsule("forearm", (-0.2, -0.5, 0.007), (-0.2, 0.5, 0.007), 0.03)
    masted = replace(ROBOT, name="masted", capsules=(*ROBOT.shapes, mast))
    free = stance_graph(ladder, settings=replace(settings, collisions=False))
    shelved = replace(ladder, boxes=(*ladder.boxes, shelf))
    for world, robot in ((shelved, ROBOT), (ladder, masted)):
        graph, ruler = stance_graph(world, robot, settings), Ruler(robot, world.boxes)
        gone = [row for row in free.points.tolist() if graph.find(row) < 0]
        assert len(gone) > 10
        assert len(graph) == len(free) - len(gone) > 100
        for here, grasps in best_postures(free, gone):
            assert contacts(robot, world.boxes, here, CLEARANCE, grasps)
        for here, grasps in best_postures(graph, graph.points.tolist()):
            near = ruler.measured(here, grasps, 2.0 * CLEARANCE)
            assert not near or near[0][0] >= CLEARANCE - 1e-9


@pytest.mark.parametrize(("height", "held"), [(0.001, True), (0.004, False)])
def test_only_what_is_flush_with_a_surface_lies_behind_a_grasp(small_checked_graph, height, held):
    """A block under the gripper that stands out by one millimetre, or by four."""
    graph, rng = small_checked_graph, np.random.default_rng(3)
    for point in rng.choice(np.unique(graph.points), 10, replace=False).tolist():
        turn, middle = graph.grasp_map.rotations[point], graph.solver.points[point]
        middle = middle + (height - 0.01) * graph.solver.normals[point]
        block = Box("block", "obstacle", tuple(middle), (0.02, 0.02, 0.01), Box.rows(turn))
        here = (graph.points == point).any(axis=1)
        before = graph.mask[here].copy()
        with obstacles(graph, block):
            after = graph.mask[here].copy()
        assert np.array_equal(before, after) if held else not after.all(axis=1).any()
