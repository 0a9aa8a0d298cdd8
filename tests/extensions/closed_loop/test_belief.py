"""The robot believes in what it sees beside the map, and in nothing else."""

import numpy as np
import pytest
from scipy.optimize import brentq

from mlivr_gym import Box
from mlivr_gym.collisions import box_distances
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.hits import CUBE, MARGINS
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


def test_where_the_robot_is_there_is_nothing_else(graph, seen, plan, jem):
    state = graph.state(plan.stances[0])
    rotation = graph.posture_of(state).base_rotation[0]
    # Capsules that contain the body keep the clearance of 0.02 m.
    side = 0.5 * np.sqrt(2.0) * graph.robot.body_edges[1] + 0.025
    for axis, sign in ((1, 1.0), (1, -1.0), (2, 1.0)):
        shift = np.zeros(3)
        shift[axis] = sign * (side + 0.1)
        centre = plan.motion.base_positions[0] + rotation @ shift
        close = Box("close", "obstacle", tuple(centre), (0.1, 0.1, 0.1), Box.rows(rotation))
        assert seen(close).graph.state(plan.stances[0]).stance == tuple(
            jem.index(p) for p in plan.stances[0]
        )


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


def test_what_is_refused_is_not_taken_in_at_all(seen):
    """Neither other hits of a look nor a point that the map lacks."""
    belief, hits = seen(times=0), np.full((6, 3), (4.0, 0.0, 0.0))
    for wrong in (np.vstack([hits, [4.0, np.nan, 0.0]]), 1000.0 * hits):
        with pytest.raises(SettingError, match="hits"):
            belief.add_hits(wrong)
    with pytest.raises(MlivrError, match="graspable point"):
        belief.refuse(-1)
    with pytest.raises(SettingError, match="noise"):
        Belief(belief.graph, -0.001)
    assert not belief.refused
    belief.add_hits(np.zeros((0, 3)))  # all rays hit nothing
    assert not belief.boxes()


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


def test_what_was_believed_leaves_the_graph(seen):
    belief = seen(Box.between("wall", "obstacle", (3.2, -1.0, -0.9), (3.5, 1.0, 0.3)), times=1)
    belief.refuse(7)
    known = Box.between("known", "obstacle", (-2.0, 0.5, -0.2), (-1.8, 0.7, 0.2))
    belief.graph.add_obstacles([known])
    assert len(belief.graph.obstacles) > 1
    belief.withdraw()
    assert belief.graph.obstacles == (known,)
    assert not belief.graph.occupied
