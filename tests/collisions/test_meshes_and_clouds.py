"""Meshes and point clouds as obstacles: the clearance seen of them, against coal's distances.

Obstacles of both kinds are covered by boxes. Never more clearance may be seen than coal measures
from the triangles or the points themselves, and less by no more than the excess that is stated.
"""

import coal
import numpy as np
import pytest
from coal_ruler import apart, capsule, sampled
from compiled import called
from limb_motions import ROBOT
from scipy.spatial.transform import Rotation

from mlivr_gym.collisions.against_boxes import GraspSurface, compare_with_grid
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.contacts import box_distances, capsule_ends
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.planners import Planner
from mlivr_gym.stances.obstacles import OBSTACLE_CELL_EDGE
from mlivr_gym.world.covering_boxes import point_cloud_boxes
from mlivr_gym.world.mesh_boxes import largest_excess, mesh_boxes

trimesh = pytest.importorskip("trimesh")

SHAPES = LimbShapes(ROBOT)
ROUNDING = 1e-5
"""Error of coal's distances, whose solver is iterative [m]."""
CLEARANCE = 0.02
START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)
NAMES = [
    f"limb{i}/{name}/{SHAPES.names[:c].count(name)}"
    for i in range(2)
    for c, name in enumerate(SHAPES.names)
]
"""Names of the capsules of both limbs."""


def random_mesh(rng, centre):
    """Triangles of a few shapes and loose slivers about a place, in one mesh."""
    ball = trimesh.creation.icosphere(1, rng.uniform(0.05, 0.3))
    ball.vertices *= rng.uniform(0.3, 1.0, 3)
    slab = trimesh.creation.box(rng.uniform(0.01, 0.6, 3))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.random(rng=rng).as_matrix()
    slab.apply_transform(turn)
    loose = rng.normal(scale=0.2, size=(5, 1, 3)) + rng.normal(scale=0.1, size=(5, 3, 3))
    parts = [ball, slab, trimesh.creation.box(rng.uniform(0.01, 0.4, 3))]
    for part in parts:
        part.apply_translation(rng.normal(scale=0.2, size=3))
    triangles = np.concatenate([*(part.triangles for part in parts), loose]) + centre
    return trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def random_cloud(rng, centre):
    """Points on a few patches and astray, about a place."""
    flat = rng.uniform(-0.25, 0.25, (150, 3)) * [1.0, 1.0, 0.0]
    turned = flat @ Rotation.random(rng=rng).as_matrix()
    return np.concatenate([turned, 0.25 * rng.normal(size=(20, 3))]) + centre


def solid_of(triangles):
    """Triangles as coal has them."""
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), 3 * len(triangles))
    for a, b, c in triangles:
        model.addTriangle(a, b, c)
    model.endModel()
    return model, coal.Transform3s()


class MeshTruth:
    """A mesh as coal has it: triangles."""

    def __init__(self, rng, centre, folder):
        mesh = random_mesh(rng, centre)
        path = folder / "part.ply"
        mesh.export(path)
        # The vertices as the file has them, in single precision.
        vertices = mesh.vertices.astype(np.float32).astype(float)
        self.resolution = rng.uniform(0.03, 0.12)
        self.boxes = mesh_boxes(path, self.resolution)
        self.solid = solid_of(vertices[mesh.faces])


class CloudTruth:
    """A cloud as coal has it: a tiny triangle at each point."""

    def __init__(self, rng, centre, folder):
        points = random_cloud(rng, centre)
        self.resolution = rng.uniform(0.03, 0.12)
        self.boxes = point_cloud_boxes(points, self.resolution)
        self.solid = solid_of(points[:, None] + 1e-7 * np.eye(3))


KINDS = (MeshTruth, CloudTruth)


def away(shape, truth):
    """Coal's distance of a shape from an obstacle."""
    return apart(shape, truth.solid)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_clearance_of_limbs_is_never_more_than_coal_has_and_less_by_the_excess_at_most(
    kind, seed, tmp_path
):
    """For the plain definition and compiled code, with limbs in random postures close by."""
    rng, compared = np.random.default_rng(seed), 0
    truth = kind(rng, np.zeros(3), tmp_path)
    grid, nothing = box_grid(truth.boxes, OBSTACLE_CELL_EDGE), GraspSurface.row()
    excess = largest_excess(truth.resolution)

    def answer(ends, around):
        """Whether compiled code finds an axis clear of the obstacle by a distance."""
        axis = tuple(map(tuple, ends))
        return called(compare_with_grid)(axis, around, (0.0, 0.0), grid, nothing, False) == CLEAR

    while compared < 60:
        turn = Rotation.random(rng=rng).as_quat(scalar_first=True)
        here = 0.5 * rng.normal(size=3), turn, rng.uniform(-np.pi, np.pi, (2, 6))
        seen = dict.fromkeys(NAMES, np.inf)
        for name, _, gap in box_distances(ROBOT, truth.boxes, here, 1.0):
            seen[name] = min(gap, seen.get(name, np.inf))
        ends = capsule_ends(ROBOT, SHAPES, here).reshape(-1, 2, 3)
        for name, axis, radius in zip(NAMES, ends, np.tile(SHAPES.radii, 2), strict=True):
            true = away(capsule(radius, *axis), truth)
            if not 1e-3 < true < 0.5:
                continue
            compared += 1
            assert true - excess - ROUNDING <= seen[name] <= true + ROUNDING
            assert not answer(axis, radius + true + ROUNDING)
            if true > excess + ROUNDING:
                assert answer(axis, radius + true - excess - ROUNDING)


@pytest.mark.parametrize("kind", KINDS)
def test_all_along_plans_coal_finds_the_clearance_of_meshes_and_clouds(
    kind, checked_graph, tmp_path
):
    """They lie where a limb swings in the plan without them, so that another one is taken."""
    graph, planner, gaps = checked_graph, Planner(checked_graph), []
    free = planner.plan(START, GOAL, "steps").unwrap()
    before = sampled(graph, free, 12)
    for swing in (81, 90, 99):  # samples of the second step
        hand = capsule_ends(ROBOT, SHAPES, before[swing][0])[free.steps[1].limb, -1, 0]
        truth = kind(np.random.default_rng(2), hand, tmp_path)
        graph.add_obstacles(truth.boxes)
        try:
            along = sampled(graph, planner.plan(START, GOAL, "steps").unwrap(), 12)
        finally:
            graph.remove_obstacles()
        assert any(distance_of_robot(here, truth) < 0.0 for here, _ in before[65:])
        gaps.append(min(distance_of_robot(here, truth) for here, _ in along))
    # One comes so close that the clearance is decisive.
    assert CLEARANCE - ROUNDING <= min(gaps) < CLEARANCE + largest_excess(truth.resolution)


def distance_of_robot(here, truth):
    """Coal's distance of body and limbs from an obstacle."""
    turn = Rotation.from_quat(here[1], scalar_first=True).as_matrix()
    body = coal.Box(*ROBOT.body_edges), coal.Transform3s(turn, here[0])
    ends = capsule_ends(ROBOT, SHAPES, here).reshape(-1, 2, 3)
    radii = np.tile(SHAPES.radii, 2)
    limbs = [capsule(radius, *axis) for radius, axis in zip(radii, ends, strict=True)]
    return min(away(shape, truth) for shape in (body, *limbs))
