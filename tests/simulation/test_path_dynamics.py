"""What a piece asks for, and how long it takes, against a simulation and by brute force."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym.errors import TimingError
from mlivr_gym.motion.time_scaling import Durations, duration_of, quintic, stretch
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import CONTROLLERS, Limits
from mlivr_gym.simulation.path_dynamics import TIME_SAMPLES, segment_dynamics
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.time_optimal import time_optimal_squared_rates
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
