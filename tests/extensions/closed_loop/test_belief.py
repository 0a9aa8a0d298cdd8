"""The robot believes in what it sees beside the map, and in nothing else."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym import Box
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.hit_cubes import CAUTIONS, CUBE, outermost
from mlivr_gym.extensions.closed_loop.path_check import HORIZON, robot_axes, robot_radii
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.simulation.scene import set_configuration
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
            hits, _ = CAMERA.measure(simulation.model, simulation.data, graph.robot, rng)
            belief.add_hits(hits, configuration)
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
    margin = CAUTIONS[0].margin
    assert margin < farthest(boxes) <= np.sqrt(3.0) * margin + 5.0 * CAMERA.noise
    state, loose = belief.graph.state(plan.stances[0]), boxes
    for before, caution in pairwise(CAUTIONS):
        assert belief.tighten()
        belief.update_graph(state)
        tight = belief.graph.obstacles
        if caution.hits == before.hits:  # the same cubes are obstacles
            assert (len(tight) == len(loose)) == caution.is_merged
        loose = tight
        # Of the outermost hits, which vary more in single cubes, as these have fewer.
        deviations = (1.5 if caution.is_merged else 2.5) if caution.is_denoised else 5.0
        assert farthest(tight) <= np.sqrt(3.0) * caution.margin + deviations * CAMERA.noise
    assert not belief.tighten()
    here = plan.motion.base_positions[0]
    face = np.array([[3.2, y, z] for y in np.arange(-0.4, 0.41, 0.1) for z in (-0.4, -0.2, 0.0)])
    covered = np.min([gaps(face, box) for box in boxes], axis=0)
    assert here[0] < 3.2
    assert np.median(covered) < CUBE
    assert covered.max() < 3.0 * CUBE


def test_at_last_what_is_believed_does_not_fill_a_narrow_gap(seen, plan):
    """Hits on two things, between which the gap is 5 cm, and behind a step 8 cm."""
    rng, belief = np.random.default_rng(4), seen(times=0)
    low = Box.between("low", "obstacle", (3.5, 0.0, 0.16), (4.0, 0.4, 0.36))
    step = Box.between("step", "obstacle", (3.5, 0.0, 0.36), (4.0, 0.2, 0.39))
    high = Box.between("high", "obstacle", (3.5, 0.0, 0.44), (4.0, 0.4, 0.7))
    hits = []
    for box in (low, step, high):
        on = rng.uniform(-1.0, 1.0, (20_000, 3))
        axis = rng.integers(3, size=len(on))
        on[np.arange(len(on)), axis] = rng.choice([-1.0, 1.0], len(on))
        hits.append(on * box.half + box.centre)
    hits = np.concatenate(hits)
    belief.add_hits(hits + rng.normal(0.0, CAMERA.noise, hits.shape), plan.configuration(0))
    gap = rng.uniform((3.5, 0.2, 0.36), (4.0, 0.4, 0.44), (2000, 3))
    gap = gap[np.min([gaps(gap, box) for box in (low, step, high)], axis=0) > 0.015]
    filled = [np.min([gaps(gap, box) for box in belief.boxes()], axis=0) == 0.0]
    while belief.tighten():
        pass
    filled.append(np.min([gaps(gap, box) for box in belief.boxes()], axis=0) == 0.0)
    covered = np.min([gaps(hits[::10], box) for box in belief.boxes()], axis=0)
    assert filled[0].mean() > 0.3
    assert not filled[1].any()
    assert covered.max() < 4.0 * CAMERA.noise


@pytest.mark.parametrize("count", [1, 10, 300, 5000])
def test_the_outermost_of_many_hits_lies_outside_by_this_much_in_the_mean(count):
    drawn = np.random.default_rng(count).standard_normal((2000, count)).max(axis=1)
    assert outermost(count) == pytest.approx(drawn.mean(), abs=4.0 * drawn.std() / np.sqrt(2000))


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


def test_points_to_which_paths_were_blocked_are_free_again_once(seen):
    belief = seen()
    assert not belief.reconsider()
    belief.refuse(7)
    for again in (True, False):
        belief.avoid(8)
        assert belief.graph.occupied == {7, 8}
        assert belief.reconsider() == again
        assert belief.graph.occupied == ({7} if again else {7, 8})
    belief.graph.vacate()


def test_a_path_is_blocked_by_what_was_seen_since_it_was_planned(seen, plan, jem):
    """The first step of the plan, and a box at the place to which its gripper moves."""
    belief, there = seen(times=0), step_trajectory(seen(times=0).graph, plan, 0, Durations())
    hand = jem.positions[jem.index(plan.steps[0].to_point)]
    normal = jem.normals[jem.index(plan.steps[0].to_point)]
    places = hand + 0.12 * normal + 0.01 * np.random.default_rng(1).normal(size=(300, 3))
    here, last = plan.configuration(0), len(there.times) - 1
    assert not belief.is_blocked(there, 0)
    belief.add_hits(places, here)
    # The graph may be told of it during a step, and the path is blocked all the same.
    belief.update_graph(belief.graph.state(plan.stances[0]))
    assert belief.graph.obstacles
    assert belief.is_blocked(there, 0)
    assert not belief.is_blocked(there, 0)  # seen before
    with pytest.raises(SettingError, match="first is -1; it must be a whole number from 0"):
        belief.is_blocked(there, -1)
    again = there.at(np.arange(last + 1))
    assert not belief.is_blocked(again, 0)  # it was planned among what the graph has
    belief.add_hits(places + 0.05 * normal, here)
    assert belief.is_blocked(again, 0)
    belief.add_hits(places + np.array([0.0, 0.0, 4.0]), here)
    assert not belief.is_blocked(again, last)  # far away


def test_two_hits_are_an_obstacle_as_long_as_there_is_a_plan(seen, plan):
    belief = seen(times=0)
    state = belief.graph.state(plan.stances[0])
    twice, often = np.array([[4.0, 0.0, 0.0]]), np.array([[4.0, 0.5, 0.5]])
    hits = np.concatenate([*[twice] * 2, *[often] * 3])
    belief.add_hits(hits, plan.configuration(0))
    belief.update_graph(state)
    for caution in CAUTIONS:
        held = [box.bounds for box in belief.graph.obstacles]
        for place, count in ((twice, 2), (often, 3)):
            is_held = any(((low <= place[0]) & (place[0] <= high)).all() for low, high in held)
            assert is_held == (count >= caution.hits)
        assert belief.tighten() == (caution != CAUTIONS[-1])
        belief.update_graph(state)


def test_a_robot_beside_its_trajectory_will_touch_what_mujoco_finds_there(graph, plan, jem):
    """The first swing among random boxes, with a robot that is off by some centimetres."""
    rng = np.random.default_rng(3)
    trajectory = step_trajectory(graph, plan, 0, Durations())
    base = trajectory.base_positions[0]
    first = int(0.4 * len(trajectory.times))
    ahead = first + np.arange(0.0, HORIZON + 0.05, 0.1) / trajectory.period
    boxes, found = [], {True: 0, False: 0}
    for k in range(20):
        centre, half = base + rng.uniform(-0.8, 0.8, 3), rng.uniform(0.05, 0.3, 3)
        boxes.append(Box.between(f"thing{k}", "obstacle", centre - half, centre + half))
    simulation = Setup().simulation(jem, graph.robot, boxes)
    for box in boxes:
        graph.add_obstacles([box])
        belief = Belief(graph, CAMERA.noise)
        shift, turn = rng.uniform(-0.025, 0.025, 3), Rotation.from_rotvec(rng.normal(0.0, 0.005, 3))
        bend = rng.normal(0.0, 0.005, (2, 6))

        def beside(sample, shift=shift, turn=turn, bend=bend):
            at = trajectory.at(np.array([int(sample)]))
            rotation = turn * Rotation.from_quat(at.base_quaternions[0], scalar_first=True)
            quaternion = rotation.as_quat(scalar_first=True)
            return at.base_positions[0] + shift, quaternion, at.joint_positions[0] + bend

        thing, touches = simulation.model.geom(f"box/{box.id}").id, False
        for sample in ahead:
            set_configuration(simulation.model, simulation.data, *beside(sample))
            if touches := bool((simulation.data.contact.geom == thing).any()):
                break
        assert belief.will_touch(trajectory, first, beside(first)) == touches
        found[touches] += 1
        graph.remove_obstacles()
    assert min(found.values()) >= 5
    count = len(trajectory.times)
    with pytest.raises(SettingError, match=f"sample is {count}; the trajectory has {count} sampl"):
        belief.will_touch(trajectory, count, beside(count - 1))


def test_what_is_refused_is_not_taken_in_at_all(seen, plan):
    """Neither other hits of a look nor a point that the map lacks."""
    belief, here, hits = seen(times=0), plan.configuration(0), np.full((6, 3), (4.0, 0.0, 0.0))
    for wrong in (np.vstack([hits, [4.0, np.nan, 0.0]]), 1000.0 * hits):
        with pytest.raises(SettingError, match="hits"):
            belief.add_hits(wrong, here)
    for part in range(3):
        present = list(here)
        present[part] = np.full_like(present[part], np.nan)
        with pytest.raises(SettingError):
            belief.add_hits(hits, present)
    for take in (belief.refuse, belief.avoid):
        with pytest.raises(MlivrError, match="graspable point"):
            take(-1)
    with pytest.raises(SettingError, match="noise"):
        Belief(belief.graph, -0.001)
    assert not belief.refused | belief.avoided
    assert belief.add_hits(np.zeros((0, 3)), here) == 0  # all rays hit nothing
    assert not belief.boxes()


def test_what_is_at_the_robot_itself_is_no_obstacle(seen, plan):
    """Up to half the diagonal of a cube, the margin and the clearance from its capsules."""
    belief, here, rng = seen(times=0), plan.configuration(0), np.random.default_rng(9)
    shapes = LimbShapes(belief.graph.robot)
    axes = robot_axes(belief.graph.robot, shapes, here)
    begin, end, radii = axes[:, 0], axes[:, 1], robot_radii(shapes)
    near = begin[rng.integers(len(axes), size=4000)] + rng.normal(0.0, 0.12, (4000, 3))
    belief.add_hits(np.repeat(near, 2, axis=0), here)
    solid = belief._seen.is_solid
    centres = belief._seen.middles(belief._seen.rows["cell"])
    share = np.linspace(0.0, 1.0, 400)[:, None, None]
    samples = (begin + share * (end - begin)).reshape(-1, 3)
    away = np.linalg.norm(centres[:, None] - samples, axis=2) - np.tile(radii, 400)
    excess = away.min(axis=1) - (0.5 * np.sqrt(3.0) * CUBE + 0.01 + 0.02)
    there = belief._apart_from(here)
    clear = np.abs(excess) > 1e-4
    assert (there == (solid & (excess > 0.0)))[clear].all()
    assert (solid & (np.abs(excess) < 0.01)).sum() > 20
