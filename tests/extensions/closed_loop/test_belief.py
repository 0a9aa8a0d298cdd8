"""The robot believes in what it sees beside the map, and in nothing else: in cubes of hits."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from mlivr_gym import Box
from mlivr_gym.collisions import box_distances
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.hits import (
    CUBE,
    LEAST_GROWTH,
    MARGINS,
    HitCubes,
    unexplained,
)
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.timing import step_trajectory

CAMERA = DepthCamera()


@pytest.fixture
def seen(graph, jem, plan):
    """A function that looks round several times among unknown boxes and returns the belief."""
    points = [jem.index(point) for point in plan.stances[0]]
    configuration = graph.configuration(graph.state(points))

    def look(*unknown, times=3):
        graph.remove_obstacles()
        simulation = Setup().simulation(jem, graph.robot, unknown)
        simulation.reset(*configuration, points)
        belief, rng = Belief(graph, CAMERA.noise), np.random.default_rng(5)
        for _ in range(times):
            belief.add_hits(CAMERA.measure(simulation.model, simulation.data, graph.robot, rng))
        belief.update_graph(graph.state(points))
        return belief

    yield look
    graph.remove_obstacles()


def gaps(points, box):
    """Distances of points from a box."""
    beyond = np.abs(points - np.array(box.centre)) - np.array(box.half)
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1)


def test_what_is_believed_covers_the_seen_face_of_a_box_and_little_more(seen, plan):
    wall = Box.between("wall", "obstacle", (3.2, -1.0, -0.9), (3.5, 1.0, 0.3))
    belief = seen(wall)

    def farthest(boxes):
        """Distance of the farthest corner of boxes from the wall."""
        corners = [np.stack(np.meshgrid(*box.bounds.T), axis=-1).reshape(-1, 3) for box in boxes]
        return gaps(np.concatenate(corners), wall).max()

    boxes = belief.boxes()
    assert boxes == belief.graph.obstacles
    # The extent of hits, which are noise away from the box at most, and the margin.
    assert MARGINS[0] < farthest(boxes) <= np.sqrt(3.0) * MARGINS[0] + 5.0 * CAMERA.noise
    assert belief.relax()
    assert not belief.relax()
    assert belief.update_graph(belief.graph.state(plan.stances[0]))
    assert farthest(belief.graph.obstacles) <= 5.0 * CAMERA.noise + MARGINS[1]
    here = plan.motion.base_positions[0]
    face = np.array([[3.2, y, z] for y in np.arange(-0.4, 0.41, 0.1) for z in (-0.4, -0.2, 0.0)])
    covered = np.min([gaps(face, box) for box in boxes], axis=0)
    assert here[0] < 3.2
    assert np.median(covered) < CUBE
    assert covered.max() < 3.0 * CUBE


def test_a_path_is_blocked_by_what_was_seen_since_the_graph_was_told(seen, plan, jem):
    """The first step of the plan, and a box at the place to which its gripper moves."""
    belief = seen(times=0)
    trajectory = step_trajectory(belief.graph, plan, 0, Durations())
    last = len(trajectory.times) - 1
    point = jem.index(plan.steps[0].to_point)
    hand, normal = jem.positions[point], jem.normals[point]
    places = hand + 0.12 * normal + 0.01 * np.random.default_rng(1).normal(size=(300, 3))
    state = belief.graph.state(plan.stances[0])
    assert not belief.is_blocked(trajectory, 0)
    belief.add_hits(places)
    assert belief.is_blocked(trajectory, 0)
    assert belief.update_graph(state)
    assert belief.graph.obstacles
    assert not belief.is_blocked(trajectory, 0)  # the next one is planned among what the graph has
    assert not belief.update_graph(state)
    with pytest.raises(SettingError, match="sample is -1; it must be a whole number from 0"):
        belief.is_blocked(trajectory, -1)
    belief.add_hits(places + np.array([0.0, 0.0, 4.0]))
    assert not belief.is_blocked(trajectory, last)  # far away
    belief.add_hits(places + 0.05 * normal)
    assert belief.is_blocked(trajectory, 0)


@pytest.mark.parametrize(("share", "is_blocked"), [(0.95, True), (1.05, False)])
def test_a_path_is_blocked_by_what_is_nearer_than_the_clearance(seen, plan, share, is_blocked):
    """A hit above the highest place of the body on its way, by the distance of a box."""
    belief = seen(times=0)
    trajectory = step_trajectory(belief.graph, plan, 0, Durations())
    clearance = belief.graph.settings.clearance
    samples = np.arange(0, len(trajectory.times), 5)
    at = trajectory.at(samples)
    places = list(zip(at.base_positions, at.base_quaternions, at.joint_positions, strict=True))

    def distance(place):
        """Least distance of a place and the margin about it from the robot on its way."""
        box = Box.between("cube", "obstacle", place - MARGINS[0], place + MARGINS[0])
        least = np.inf
        for configuration in places:
            pairs = box_distances(belief.graph.robot, [box], configuration, 1.0)
            least = min([least, *(one for *_, one in pairs)])
        return least

    middle = trajectory.base_positions[len(trajectory.times) // 2]
    up, aim = np.array([0.0, 0.0, 1.0]), share * clearance
    height = brentq(lambda z: distance(middle + z * up) - aim, 0.2, 0.9, xtol=1e-4)
    belief.add_hits(np.tile(middle + height * up, (2, 1)))
    assert belief.is_blocked(trajectory, 0) == is_blocked


def test_two_hits_are_an_obstacle(seen, plan):
    belief = seen(times=0)
    once, twice = np.array([[4.0, 0.5, 0.5]]), np.array([[4.0, 0.0, 0.0]])
    belief.add_hits(np.concatenate([once, twice, twice]))
    belief.update_graph(belief.graph.state(plan.stances[0]))
    (box,) = belief.graph.obstacles
    np.testing.assert_allclose(
        box.bounds, twice + np.array([[-MARGINS[0]], [MARGINS[0]]]), atol=1e-12
    )
    assert belief.occupancy().sum() == 1


def test_what_is_at_the_robot_itself_is_no_obstacle_of_the_graph(seen, plan):
    """No part of a cube with it that is nearer than the clearance."""
    belief, rng = seen(times=0), np.random.default_rng(9)
    state, clearance = belief.graph.state(plan.stances[0]), belief.graph.settings.clearance
    here = belief.graph.configuration(state)
    near = here[0] + rng.normal(0.0, 0.3, (4000, 3))
    belief.add_hits(np.repeat(near, 2, axis=0))
    belief.update_graph(state)
    assert belief.graph.obstacles

    def nearest(boxes):
        """Least distance of the robot from boxes."""
        return min(one for *_, one in box_distances(belief.graph.robot, boxes, here, 0.1))

    assert nearest(belief.boxes()) < 0.0
    assert nearest(belief.graph.obstacles) >= clearance
    assert belief.graph.state(plan.stances[0]).stance == state.stance


BOUNDS = np.array([[-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]])


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
def test_a_hit_belongs_to_a_box_up_to_five_deviations_from_it(noise):
    """And a tenth of a millimetre for rounding; its distance from the face is exact."""
    rng, turn = np.random.default_rng(5), Rotation.random(random_state=5).as_matrix()
    half, centre = np.array([0.3, 0.2, 0.4]), np.array([0.1, -0.1, 0.2])
    box = Box("box", "rack", tuple(centre), tuple(half), tuple(map(tuple, turn)))
    far, most = Box("far", "rack", (9.0, 0.0, 0.0), (0.1, 0.1, 0.1)), 5.0 * noise + 1e-4
    axis, sign = rng.integers(3, size=200), rng.choice([-1.0, 1.0], 200)
    on = rng.uniform(-half, half, (200, 3))
    for share, count in ((0.99, 0), (1.01, 200)):
        on[np.arange(200), axis] = sign * (half[axis] + share * most)
        assert len(unexplained(centre + on @ turn.T, [far, box], noise)) == count
    np.testing.assert_array_equal(unexplained(on, [], noise), on)


def test_cubes_are_those_of_the_hits_counted_one_by_one():
    rng, cubes, all_hits = np.random.default_rng(3), HitCubes(BOUNDS), []
    for _ in range(4):
        hits = rng.uniform(-0.3, 0.3, (500, 3))
        cubes.add(np.vstack([hits, [[5.0, 0.0, 0.0]]]))  # the last one is outside the grid
        all_hits += hits.tolist()
    by_cell = {}
    for hit in np.array(all_hits):
        by_cell.setdefault(tuple(np.floor((hit - BOUNDS[0]) / CUBE).astype(int)), []).append(hit)
    assert len(cubes.cells) == len(by_cell)
    for cell, count, extent in zip(cubes.cells, cubes.count, cubes.extent, strict=True):
        own = np.array(by_cell[tuple(cell)])
        assert count == len(own)
        np.testing.assert_array_equal(extent, [-own.min(axis=0), own.max(axis=0)])


def test_boxes_contain_the_hits_and_no_place_in_a_cube_without_any():
    rng, cubes = np.random.default_rng(2), HitCubes(BOUNDS)
    hits = rng.uniform((-0.2, -0.2, 0.0), (0.2, 0.2, 0.04), (3000, 3))
    hits = hits[np.linalg.norm(hits[:, :2], axis=1) > 0.1]  # a plate with a hole
    cubes.add(hits)
    chosen = np.flatnonzero(cubes.is_solid)
    whole, merged, inside = cubes.whole(chosen), cubes.merged(chosen), np.zeros(len(hits), bool)
    for box in merged:
        low, high = box.bounds
        inside |= ((hits >= low) & (hits <= high)).all(axis=1)
        cells = np.floor((np.array([low + MARGINS[0], high - MARGINS[0]]) - BOUNDS[0]) / CUBE)
        for cell in np.ndindex(*(cells[1] - cells[0] + 1).astype(int)):
            assert (cubes.cells[chosen] == cells[0] + cell).all(axis=1).any()
    assert inside.all()
    assert len(merged) < len(whole) == len(chosen)
    for box, cell in zip(whole, cubes.cells[chosen], strict=True):
        middle = BOUNDS[0] + CUBE * (cell + 0.5)
        np.testing.assert_allclose(box.centre, middle)
        np.testing.assert_allclose(box.half, 0.5 * CUBE + MARGINS[0])
    assert cubes.merged(chosen[:0]) == ()


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("margin", MARGINS)
def test_a_cube_is_news_if_it_has_grown_by_the_margin_or_half_a_centimetre(side, margin):
    for share in (0.98, 1.02):
        cubes, middle = HitCubes(BOUNDS), np.full((2, 3), 0.5 * CUBE)
        cubes.margin = margin
        cubes.add(middle[:1])
        assert not cubes.is_new.any()  # one hit may be noise
        cubes.add(middle[:1])
        assert cubes.is_new.all()
        cubes.told[:] = cubes.extent
        assert not cubes.is_new.any()
        cubes.add(middle[:1] + side * share * max(margin, LEAST_GROWTH) * np.array([0.0, 1.0, 0.0]))
        assert cubes.is_new.tolist() == [share > 1.0]
