import csv

import mujoco
import numpy as np
import pytest
import yaml
from scipy.spatial import cKDTree

from mlivr_gym import Settings, stance_graph
from mlivr_gym.motion.joint_path import PHASES
from mlivr_gym.motion.time_scaling import Durations, duration_of, quintic
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.motion.trajectory_files import save_csv, save_npz, save_ros
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.scene import scene_spec, set_configuration
from mlivr_gym.simulation.timing import plan_trajectory, step_trajectory


@pytest.fixture(scope="module")
def walk(checked_graph, plan):
    return plan_trajectory(checked_graph, plan, Durations(), period=0.01)


@pytest.fixture(scope="module")
def scene(jem, plan):
    model = scene_spec(jem, plan.world.robot).compile()
    return model, mujoco.MjData(model)


def grasp(scene, trajectory, k, limb):
    model, data = scene
    base = trajectory.base_positions[k], trajectory.base_quaternions[k]
    set_configuration(model, data, *base, trajectory.joint_positions[k])
    site = data.site(f"limb{limb}/grasp")
    return site.xpos.copy(), site.xmat.reshape(3, 3).copy()


def test_quintic_starts_and_ends_at_rest_without_acceleration():
    s = np.linspace(0.0, 1.0, 6)
    polynomial = np.polynomial.Polynomial.fit(s, quintic(1.0)(s), 5)
    for order, ends in ((0, (0.0, 1.0)), (1, (0.0, 0.0)), (2, (0.0, 0.0))):
        derivative = polynomial.deriv(order) if order else polynomial
        np.testing.assert_allclose(derivative(np.array([0.0, 1.0])), ends, atol=1e-9)
    assert (np.diff(quintic(1.0)(np.linspace(0.0, 1.0, 100))) > 0).all()
    times = np.linspace(0.0, 7.0, 50)
    np.testing.assert_allclose(quintic(7.0)(times), quintic(1.0)(times / 7.0), atol=1e-12)


def test_a_walk_passes_through_the_stances_of_its_plan_at_rest(plan, walk):
    for k in range(len(plan.stances)):
        at = round(k * 50.0 / 0.01)
        np.testing.assert_allclose(
            walk.joint_positions[at], plan.motion.joint_positions[k], atol=1e-6
        )
        np.testing.assert_allclose(
            walk.base_positions[at], plan.motion.base_positions[k], atol=1e-9
        )
        np.testing.assert_allclose(
            abs(walk.base_quaternions[at] @ plan.motion.base_quaternions[k]), 1.0, atol=1e-12
        )
    assert len(walk.times) == 5 * len(plan.steps) * 1000 + 1
    assert walk.times[-1] == pytest.approx(50.0 * len(plan.steps))
    for second in (0.0, 10.0, 40.0, 50.0, 60.0, 90.0):
        assert np.abs(walk.joint_velocities[round(second / 0.01)]).max() < 1e-5


@pytest.mark.parametrize("period", [0.001, 0.37, 1e4])
def test_a_coarser_walk_has_the_samples_of_its_grid_and_the_last_one(walk, period):
    coarse, stride = walk.every(period), max(round(period / 0.01), 1)
    assert coarse.times[-1] == walk.times[-1]
    np.testing.assert_allclose(coarse.times[:-1], np.arange(len(coarse.times) - 1) * stride * 0.01)
    assert 0.0 < coarse.times[-1] - coarse.times[-2] <= stride * 0.01 + 1e-9
    at = np.searchsorted(walk.times, coarse.times - 1e-9)
    np.testing.assert_array_equal(coarse.joint_positions, walk.joint_positions[at])


def test_swings_that_were_not_checked_are_straight_where_they_can_be(jem, scene):
    """The paper's motion: the gripper and, by a quintic, the base on a line; sampled."""
    graph = stance_graph(jem, settings=Settings(collisions=False, transitions=False))
    plan = Planner(graph).plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "base").unwrap()
    limits, straight = graph.robot.limb.limits, 0
    for index, step in enumerate(plan.steps):
        trajectory = step_trajectory(graph, plan, index, Durations(), period=0.1)
        q = trajectory.joint_positions
        assert (q >= limits[:, 0] - 1e-6).all()
        assert (q <= limits[:, 1] + 1e-6).all()
        assert np.abs(np.diff(q, axis=0)).max() < 0.2
        chosen = np.flatnonzero(trajectory.phase == 1)
        share = quintic(30.0)(trajectory.times[chosen] - 10.0)[:, None]
        first, last = plan.motion.base_positions[index : index + 2]
        base = first + share * (last - first)
        np.testing.assert_allclose(trajectory.base_positions[chosen], base, atol=1e-4)
        places = np.array([grasp(scene, trajectory, k, step.limb)[0] for k in chosen])
        along = (places[-1] - places[0]) / np.linalg.norm(places[-1] - places[0])
        off = (places - places[0]) - np.outer((places - places[0]) @ along, along)
        straight += np.abs(off).max() < 1e-4
    assert straight > 0


def test_files_hold_what_the_trajectory_holds(tmp_path, walk):
    coarse = walk.every(1.0)
    save_npz(coarse, tmp_path / "walk.npz")
    with np.load(tmp_path / "walk.npz", allow_pickle=False) as arrays:
        assert all(np.array_equal(arrays[name], array) for name, array in coarse.arrays().items())
        assert tuple(arrays["points"].tolist()) == coarse.point_ids
    save_csv(coarse, tmp_path / "walk.csv")
    with (tmp_path / "walk.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(coarse.times) == 251
    k = 77
    assert float(rows[k]["time_s"]) == pytest.approx(coarse.times[k])
    assert rows[k]["phase"] == PHASES[coarse.phase[k]]
    for name, value in (
        ("limb1/joint3/position_rad", coarse.joint_positions[k, 1, 2]),
        ("limb0/joint6/velocity_rad_s", coarse.joint_velocities[k, 0, 5]),
        ("limb1/joint1/acceleration_rad_s2", coarse.joint_accelerations[k, 1, 0]),
        ("base_y_m", coarse.base_positions[k, 1]), ("base_vz_m_s", coarse.base_velocities[k, 2]),
        ("base_wx_rad_s", coarse.base_velocities[k, 3]),
    ):  # fmt: skip
        assert float(rows[k][name]) == pytest.approx(value, abs=1e-7)
    held = ["" if point == FREE else coarse.point_ids[point] for point in coarse.grasps[k]]
    assert [rows[k]["limb0/grasp"], rows[k]["limb1/grasp"]] == held


def test_a_table_tells_each_grasp_and_release_once(tmp_path, plan, walk):
    save_csv(walk.every(1.0), tmp_path / "walk.csv")
    with (tmp_path / "walk.csv").open() as stream:
        events = "; ".join(row["event"] for row in csv.DictReader(stream) if row["event"])
    told = []
    for step in plan.steps:
        told.append(f"limb{step.limb} releases {step.from_point}")
        told.append(f"limb{step.limb} grasps {step.to_point}")
    assert events.split("; ") == told


def test_a_message_of_ros_2_has_its_fields(tmp_path, walk):
    """trajectory_msgs/msg/JointTrajectory: header, joint_names, points of equal length."""
    coarse = walk.every(2.5)
    save_ros(coarse, tmp_path / "walk.yaml")
    message = yaml.safe_load((tmp_path / "walk.yaml").read_text())
    assert list(message) == ["header", "joint_names", "points"]
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"][7] == "limb1/joint2"
    assert len(message["points"]) == len(coarse.times)
    for time in (point["time_from_start"] for point in message["points"]):
        assert type(time["sec"]) is type(time["nanosec"]) is int  # int32 and uint32
        assert 0 <= time["nanosec"] < 10**9
    for k in (0, 33, len(coarse.times) - 1):
        point = message["points"][k]
        start = point["time_from_start"]
        assert start["sec"] + 1e-9 * start["nanosec"] == pytest.approx(coarse.times[k])
        for kind in ("positions", "velocities", "accelerations"):
            found = getattr(coarse, f"joint_{kind}")[k].ravel()
            np.testing.assert_allclose(point[kind], found, atol=1e-7)
        assert point["effort"] == []


def test_accelerations_are_those_of_finite_differences(walk):
    for speeds, changes in (
        (walk.joint_velocities, walk.joint_accelerations),
        (walk.base_velocities[:, :3], walk.base_accelerations[:, :3]),
        (walk.joint_positions, walk.joint_velocities),
        (walk.base_positions, walk.base_velocities[:, :3]),
    ):
        found = (speeds[2:] - speeds[:-2]) / (2.0 * walk.period)
        # A difference is the mean rate between samples, at which the rate may change its slope.
        off, varies = np.abs(changes[1:-1] - found), np.abs(np.diff(changes, axis=0))
        assert (off <= 1.01 * np.maximum(varies[:-1], varies[1:]) + 1e-6).all()
        assert np.quantile(off, 0.999) < 5e-3 * np.abs(changes).max()


def test_the_windings_of_a_plan_leave_room_for_departure_and_approach(checked_graph):
    """A hold inside the joint limits whose limb left them while it departed, by 0.03 rad."""
    goal = (5.234714283826891, -0.29340000000000005, 0.3656556302831988)
    plan = Planner(checked_graph).plan(("F1a:5", "O1a:0"), goal, "base").unwrap()
    angles = plan_trajectory(checked_graph, plan, Durations(), period=0.1).joint_positions
    limits = checked_graph.robot.limb.limits
    assert (angles >= limits[:, 0] - 1e-6).all()
    assert (angles <= limits[:, 1] + 1e-6).all()


def assert_rates(trajectory):
    """Rates of joints are the differences of what they are the rates of."""
    for name, rate in (("positions", "velocities"), ("velocities", "accelerations")):
        values = getattr(trajectory, f"joint_{name}")
        expected = np.gradient(values, trajectory.times, axis=0)[2:-2]
        found = getattr(trajectory, f"joint_{rate}")[2:-2]
        np.testing.assert_allclose(found, expected, atol=0.02 * np.abs(expected).max())


def test_the_way_back_is_the_way_there_in_reverse(checked_graph, plan):
    slowness = 3
    there = step_trajectory(checked_graph, plan, 0, Durations(), period=0.01)
    back = there.backwards(slowness)
    assert back.period == pytest.approx(there.period)
    assert len(back.times) == slowness * (len(there.times) - 1) + 1
    np.testing.assert_allclose(back.joint_positions[::slowness], there.joint_positions[::-1])
    np.testing.assert_array_equal(back.grasps[::slowness], there.grasps[::-1])
    np.testing.assert_array_equal(back.phase[::slowness], 2 - there.phase[::-1])
    assert_rates(back)
    expected = np.gradient(back.base_positions, back.times, axis=0)[2:-2]
    np.testing.assert_allclose(back.base_velocities[2:-2, :3], expected, atol=1e-4)


@pytest.mark.parametrize(("share", "duration"), [(0.3, 1.0), (0.6, 4.0)])
def test_a_motion_that_turns_back_follows_its_path_to_the_start(
    checked_graph, plan, share, duration
):
    there = step_trajectory(checked_graph, plan, 0, Durations(), period=0.01)
    first = int(share * len(there.times))
    whole = there.turned_back(first, 2, duration)
    for name in ("joint_positions", "joint_velocities", "joint_accelerations", "phase", "grasps"):
        kept = getattr(whole, name)[:first]
        np.testing.assert_array_equal(kept, getattr(there, name)[:first])
    assert_rates(whole)
    # It is on the path all the time, turns, and comes to rest at the start.
    places, taken = (one.joint_positions.reshape(-1, 12) for one in (there, whole))
    away, nearest = cKDTree(places).query(taken[::20], p=np.inf)
    assert away.max() <= np.abs(np.diff(places, axis=0)).max()
    farthest = 20 * int(nearest.argmax())
    assert first < farthest < first + duration / there.period
    assert np.abs(whole.joint_positions[-1] - there.joint_positions[0]).max() < 1e-9
    assert np.abs(whole.joint_velocities[-1]).max() < 1e-6
    np.testing.assert_array_equal(whole.grasps[-1], there.grasps[0])
    assert whole.phase[-1] == len(PHASES) - 1
    assert there.turned_back(len(there.times) - 2, 2, duration) is None


def test_the_segments_of_a_swing_share_its_time():
    found = Durations(5.0, 35.0, 8.0).time_scalings(np.array([2.0, 4.0, 1.0]))
    assert [duration_of(one) for one in found] == pytest.approx([5.0, 10.0, 20.0, 5.0, 8.0])
