"""How long a step takes, and which limit decides it."""

from dataclasses import replace

import numpy as np
import pytest
from pinocchio_loads import loads_of
from scipy.spatial.transform import Rotation

from mlivr_gym.errors import TimingError
from mlivr_gym.motion.time_scaling import Durations, duration_of, quintic, stretch
from mlivr_gym.motion.trajectory import trajectory
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import CONTROLLERS, Limits
from mlivr_gym.simulation.path_dynamics import TIME_SAMPLES, SegmentDynamics, segment_dynamics
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.time_optimal import (
    RATIOS,
    SquaredLoads,
    reduce_squares,
    time_optimal_scaling,
    time_optimal_squared_rates,
)
from mlivr_gym.simulation.timing import step_trajectory, timed_path


@pytest.fixture(scope="module")
def paths(walk):
    return [walk.joint_path(index) for index in range(len(walk.steps))]


def rows_of(path, limits):
    return [segment_dynamics(path, segment, limits) for segment in path.segments]


def bindings(timed, limits):
    """What decides how long each piece of a step has to take by its time scaling."""
    rows = rows_of(timed.path, limits)
    return [row.binding(scaling) for row, scaling in zip(rows, timed.time_scalings, strict=True)]


def test_derivatives_of_a_piece_are_those_of_finite_differences(paths):
    """Of joints and of the base, which follows from the leader by forward kinematics."""
    h, at = 1e-4, np.linspace(0.01, 0.99, 57)
    for path in paths[:2]:
        for segment in path.segments:
            before, here, after = (segment.joints_at(at + k * h) for k in (-1, 0, 1))
            (p0, r0), (p1, r1), (p2, r2) = map(path.base, (before, here, after))
            turns = [
                Rotation.from_matrix(a.swapaxes(1, 2) @ b).as_rotvec()
                for a, b in ((r0, r1), (r1, r2))
            ]
            values = [
                np.column_stack([p2 - p0, turns[0] + turns[1]]),
                np.column_stack([p2 - 2.0 * p1 + p0, turns[1] - turns[0]]),
            ]
            for order, base in enumerate(values, 1):
                curve = segment.curve(at, order)
                difference = after - before if order == 1 else after - 2.0 * here + before
                scale = 2.0 * h if order == 1 else h**2
                truth = np.column_stack([base, difference.reshape(len(at), -1)]) / scale
                most = np.abs(truth).max() + 1e-5  # rounding of second differences
                np.testing.assert_allclose(curve, truth, atol=(2e-4, 2e-2)[order - 1] * most)


def test_the_simulation_asks_for_what_the_rows_say(checked_graph, walk, paths):
    """The largest torque, force and speed of each step, as MuJoCo measures them."""
    limits = Limits(profile="quintic")
    simulation = Setup(limits, CONTROLLERS["feedforward"]).simulation(
        checked_graph.grasp_map, checked_graph.robot
    )
    execution = execute(checked_graph, walk, limits, simulation=simulation)
    assert execution.failure is None
    most = {"torque": 0.0, "grasp_force": 0.0, "grasp_torque": 0.0}
    for path in paths:
        for rows in rows_of(path, limits):
            loads, _ = rows.loads(quintic(rows.binding(quintic(1.0)).duration))
            most["torque"] = max(most["torque"], loads[:, :12].max())
            most["grasp_force"] = max(most["grasp_force"], loads[:, 12].max())
            most["grasp_torque"] = max(most["grasp_torque"], loads[:, 13].max())
    torque = execution.peaks.joint_torque / (0.8 * np.array([150.0] * 3 + [28.0] * 3))
    assert torque.max() == pytest.approx(most["torque"], rel=0.05)
    assert execution.peaks.grasp_force.max() / 60.0 == pytest.approx(most["grasp_force"], rel=0.1)
    assert execution.peaks.grasp_torque.max() / 30.0 == pytest.approx(most["grasp_torque"], rel=0.1)


@pytest.mark.parametrize("profile", ["quintic", "fastest"])
def test_clocks_are_as_short_as_the_limits_allow_and_no_shorter(paths, profile):
    limits = Limits(profile=profile)
    for path in paths:
        timed = timed_path(path, limits)
        for rows, scaling in zip(rows_of(path, limits), timed.time_scalings, strict=True):
            loads, speeds = rows.loads(scaling)
            assert max(loads.max(), speeds.max()) == pytest.approx(1.0, abs=1e-6)
            times = np.linspace(0.0, duration_of(scaling), 500)
            assert (np.diff(scaling(times)) > -1e-9).all()
            ends = np.array([0.0, duration_of(scaling)])
            np.testing.assert_allclose(scaling(ends), [0.0, 1.0], atol=1e-9)
            np.testing.assert_allclose(scaling(ends, 1), 0.0, atol=1e-6)
            slower, faster = stretch(scaling, 2.0), stretch(scaling, 0.5)
            np.testing.assert_allclose(rows.loads(slower)[0], loads / 4.0, atol=1e-9)
            np.testing.assert_allclose(rows.loads(faster)[1], 2.0 * speeds, atol=1e-9)


LOOSE = Limits(1.0, 1.0, 1e5, 1e5, 10.0)
"""So that a limit that is tightened decides alone."""


@pytest.mark.parametrize("limits", [Limits(), replace(LOOSE, speed=0.05, grasp_force=0.5)])
def test_the_fastest_squares_are_those_of_brute_force(paths, limits):
    """Dynamic programming over a grid of speeds finds no shorter time, and hardly a longer one."""
    rows = rows_of(paths[2], limits)[1]
    nodes = np.arange(0, len(rows.sigmas), 4)
    coarse = replace_rows(rows, nodes)
    squares = time_optimal_squared_rates(coarse)
    step = np.diff(coarse.sigmas)
    time = float((2.0 * step / (np.sqrt(squares[:-1]) + np.sqrt(squares[1:]))).sum())
    levels = np.linspace(0.0, 1.1 * np.sqrt(squares.max()), 180)
    best = np.where(levels == 0.0, 0.0, np.inf)
    for k in range(len(step)):
        before, after = np.meshgrid(levels, levels, indexing="ij")
        change = (after**2 - before**2) / (2.0 * step[k])
        load = np.linalg.norm(
            change[..., None, None] * coarse.load_rates[k, 0]
            + before[..., None, None] ** 2 * coarse.load_rates[k, 1],
            axis=3,
        ).max(axis=2)
        speed = after * np.abs(coarse.speeds[k + 1]).max()
        with np.errstate(divide="ignore"):
            cost = 2.0 * step[k] / (before + after)
        cost[(load > 1.0) | (speed > 1.0)] = np.inf
        best = (best[:, None] + cost).min(axis=0)
    assert time <= best[0] * 1.001
    assert time >= 0.93 * best[0]


def replace_rows(rows, nodes):
    changed = {name: getattr(rows, name)[nodes] for name in ("sigmas", "load_rates", "speeds")}
    return replace(rows, **changed)


def test_a_duration_that_breaks_a_limit_is_refused_with_the_shortest(checked_graph, walk, paths):
    with pytest.raises(TimingError, match=r"a step of 3 s breaks the limit \w+ of .*limb \d") as no:
        timed_path(paths[0], Limits(step_duration=3.0))
    shortest = no.value.shortest
    assert timed_path(paths[0], Limits()).duration == pytest.approx(shortest)
    exact = timed_path(paths[0], Limits(step_duration=shortest))
    assert exact.duration == pytest.approx(shortest)
    assert timed_path(paths[0], Limits(step_duration=50.0)).duration == pytest.approx(50.0)
    with pytest.raises(TimingError) as no:
        timed_path(paths[0], Durations.of_step(3.0))
    longer = Durations.of_step(no.value.shortest * 1.0001)
    found = bindings(timed_path(paths[0], longer), Limits())
    assert max(entry.duration / part for entry, part in zip(
        found, np.diff([0.0, *timed_path(paths[0], longer).ends]), strict=True
    )) == pytest.approx(1.0, abs=1e-3)  # fmt: skip
    assert len(step_trajectory(checked_graph, walk, 0, longer).times) > TIME_SAMPLES


TIGHT = {
    "torque": 0.02, "speed": 0.03, "grasp_force": 0.5, "grasp_torque": 0.2, "surface_speed": 0.01,
}  # fmt: skip
"""Limits that decide for a whole step; the speed of a gripper does near the surface alone."""


def shares_of_limits(grasp_map, walk, limits):
    """The largest share of each limit in each segment of a step, by name, from its positions."""
    path, stances = walk.joint_path(2), walk.stances[2:4]
    timed, robot, limb = timed_path(path, limits), path.robot, path.limb
    moved = trajectory(grasp_map, stances, timed, timed.duration / 6000)
    loads = loads_of(robot, moved, [i for i in range(robot.limbs) if i != limb])
    force, torque = (np.linalg.norm(loads.wrenches[..., k : k + 3], axis=2) for k in (0, 3))
    at_ends = np.isin(moved.phase[1:-1], [0, 2])
    shares = {
        "torque": np.abs(loads.torques / robot.torque_limits.reshape(-1, 6)) / limits.torque,
        "speed": np.abs(loads.speeds / robot.speed_limits.reshape(-1, 6)) / limits.speed,
        "grasp_force": force / limits.grasp_force,
        "grasp_torque": torque / limits.grasp_torque,
        "surface_speed": loads.grippers[:, limb] * at_ends / limits.surface_speed,
    }
    part = np.searchsorted(timed.ends / timed.duration, moved.times[1:-1] / moved.times[-1])
    return {
        name: np.array([values[part == k].max() for k in range(len(path.segments))])
        for name, values in shares.items()
    }


@pytest.mark.parametrize(
    ("name", "profile"), [*((name, "fastest") for name in TIGHT), ("torque", "quintic")]
)
def test_the_limit_that_decides_is_reached_and_none_is_exceeded(jem, walk, name, profile):
    """By Pinocchio and finite differences of the positions of the trajectory.

    The limits are far below the usual ones, so that a step takes up to a minute, and its
    acceleration rises within a hundredth of it.
    """
    shares = shares_of_limits(jem, walk, replace(LOOSE, profile=profile, **{name: TIGHT[name]}))
    decided = [0, -1] if name == "surface_speed" else slice(None)
    reached = shares.pop(name)[decided]
    assert reached.max() < 1.005
    # Differences over three samples cut off the peak of an acceleration that has just risen.
    assert reached.min() > (0.95 if profile == "fastest" else 0.995)
    for others in shares.values():
        assert others[decided].max() < 0.5
        assert others.max() < 1.005


def segment(speed, load, at_speed=0, at_load=0):
    """One of two limbs with one speed and one load that do not change along it, else none.

    Their numbers are those of the columns: 12 joints and a gripper, 12 joints, force and torque.
    """
    loads, speeds = np.zeros((97, 2, 14, 3)), np.zeros((97, 13))
    loads[:, 0, at_load], speeds[:, at_speed] = load * np.array([0.6, 0.0, 0.8]), -speed
    return SegmentDynamics((1,), 0, np.linspace(0.0, 1.0, 97), loads, speeds)


@pytest.mark.parametrize(
    ("speed", "load", "expected"),
    [(3.0, 0.0, 3.0), (0.0, 2.25, 3.0), (2.0, 2.0, 3.0), (1.0, 2.25, 3.0)],
)
@pytest.mark.parametrize("rise", [0.3, 0.6])
def test_the_shortest_time_is_that_of_the_closed_form(speed, load, expected, rise):
    """A trapezoid of speeds, or a triangle, and the time in which the acceleration rises."""
    scaling = time_optimal_scaling(segment(speed, load, 7, 13), rise)
    assert duration_of(scaling) == pytest.approx(expected + rise, rel=0.02)
    if load:
        rising = scaling(rise * np.array([0.25, 0.5, 0.75, 1.0]), 2) * load
        np.testing.assert_allclose(rising, [0.125, 0.5, 0.875, 1.0], atol=0.06)


@pytest.mark.parametrize(
    ("at_speed", "at_load", "speed", "expected"),
    [
        (5, 0, 9.0, ("speed", 0, 6)), (6, 0, 9.0, ("speed", 1, 1)),
        (12, 0, 9.0, ("surface_speed", 0, 0)), (0, 11, 0.1, ("torque", 1, 6)),
        (0, 12, 0.1, ("grasp_force", 1, 0)), (0, 13, 0.1, ("grasp_torque", 1, 0)),
    ],
)  # fmt: skip
def test_the_limit_that_decides_is_named_with_the_duration_it_asks_for(
    at_speed, at_load, speed, expected
):
    """A quintic goes at 15/8 of its mean speed, and accelerates by 10/sqrt(3) over T squared."""
    found = segment(speed, 4.0, at_speed, at_load).binding(quintic(1.0))
    seconds = 15.0 / 8.0 * speed if speed > 1.0 else np.sqrt(4.0 * 10.0 / np.sqrt(3.0))
    assert found == (pytest.approx(seconds, rel=1e-3), *expected)


def test_between_two_nodes_b_is_the_largest_that_all_loads_allow():
    """One node lies between two whose b is given; the spacing on both sides of it differs."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        u, v = rng.normal(size=(2, 3, 5, 3)) * rng.uniform(0.02, 1.0, size=(2, 1, 5, 1))
        sigmas, squares = np.array([0.0, rng.uniform(0.2, 0.8), 1.0]), np.array([0.02, 40.0, 0.01])
        loads = SquaredLoads((u * u).sum(axis=2), (u * v).sum(axis=2), (v * v).sum(axis=2))
        rates = 0.5 / np.diff(sigmas)
        first, last, largest = squares[0], squares[2], 0.0
        reduce_squares(loads, RATIOS, sigmas, squares)
        for grid in (np.linspace(0.0, 40.0, 4001), np.linspace(0.0, 0.01, 101)):
            b = largest + grid
            start = u[0, :, :, None] * rates[0] * (b - first) + v[0, :, :, None] * first
            end = u[1, :, :, None] * rates[1] * (last - b) + v[1, :, :, None] * b
            both = np.maximum(np.linalg.norm(start, axis=1), np.linalg.norm(end, axis=1))
            largest = b[(both <= 1.0).all(axis=0)].max()
        np.testing.assert_allclose(squares, [0.02, largest, 0.01], atol=2e-4)


def test_a_node_alone_has_the_largest_b_for_which_some_ratio_is_allowed():
    u, v = np.random.default_rng(1).normal(size=(2, 1, 5, 3))
    loads = SquaredLoads((u * u).sum(axis=2), (u * v).sum(axis=2), (v * v).sum(axis=2))
    squares = np.full(1, 1e3)
    reduce_squares(loads, RATIOS, np.zeros(1), squares)
    largest = np.linalg.norm(u[0] * np.linspace(-9, 9, 9001)[:, None, None] + v[0], axis=2).max(1)
    assert 0.9 <= squares[0] * largest.min() <= 1.0 + 1e-6
