"""Robots and modules that the controller does not know."""

from dataclasses import fields, replace

import numpy as np
import pytest

from mlivr_gym.simulation.disturbances import ALL, DisturbanceRanges, robot_body_ids
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import CONTROLLERS, PACES, ControllerParameters
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.simulator import Simulation


def test_draws_stay_within_their_sizes_and_fill_them():
    drawn = [ALL.draw(seed, 17, 2, 50) for seed in range(1, 400)]
    for name, size, least in (
        ("friction", ALL.friction, 0.0), ("damping", ALL.damping, 0.0),
        ("encoder_bias", ALL.encoder_bias, -ALL.encoder_bias), ("payload", ALL.payload, 0.0),
        ("masses", 1.2, 0.8), ("stiffness", np.log(3.0), -np.log(3.0)),
        ("point_turns", ALL.point_angle, 0.0),
    ):  # fmt: skip
        values = np.concatenate([np.ravel(getattr(one, name)) for one in drawn])
        if name == "stiffness":
            values = np.log(values)
        if name == "point_turns":
            values = np.linalg.norm(values.reshape(-1, 3), axis=1)
        assert values.min() >= least - 1e-12
        assert values.max() <= size + 1e-12
        assert values.max() - values.min() > 0.97 * (size - least)
        assert values.mean() == pytest.approx(0.5 * (size + least), abs=0.05 * (size - least))
    gravity = np.linalg.norm([one.gravity for one in drawn], axis=1)
    np.testing.assert_allclose(gravity, 9.80665e-3)
    offsets = np.concatenate([one.point_offsets for one in drawn])
    assert np.linalg.norm(offsets, axis=1).max() <= 0.005
    # Half the volume of a ball lies beyond 0.794 of its radius.
    assert np.median(np.linalg.norm(offsets, axis=1)) == pytest.approx(0.794 * 0.005, rel=0.02)
    assert np.abs(offsets.mean(axis=0)).max() < 3e-4


def test_one_disturbance_does_not_move_the_others():
    whole = ALL.draw(3, 17, 2, 50)
    for field in fields(DisturbanceRanges):
        one = DisturbanceRanges(**{field.name: getattr(ALL, field.name)})
        alone = one.draw(3, 17, 2, 50)
        if hasattr(whole, field.name):
            np.testing.assert_array_equal(getattr(alone, field.name), getattr(whole, field.name))
    turned = DisturbanceRanges(point_angle=ALL.point_angle).draw(3, 17, 2, 50)
    np.testing.assert_array_equal(turned.point_turns, whole.point_turns)


def test_a_disturbance_changes_the_model_as_it_says(jem, plan):
    setup = Setup(disturbances=ALL)
    simulation = setup.simulation(jem, plan.world.robot, seed=5)
    known = Setup().simulation(jem, plan.world.robot)
    drawn, model, plain = simulation.disturbance, simulation.model, known.model
    parts = robot_body_ids(model)
    expected = plain.body_mass[parts] * drawn.masses
    expected[0] += drawn.payload
    np.testing.assert_allclose(model.body_mass[parts], expected)
    inertias = plain.body_inertia[parts] * drawn.masses[:, None]
    np.testing.assert_allclose(model.body_inertia[parts], inertias)
    np.testing.assert_allclose(model.opt.gravity, drawn.gravity)
    np.testing.assert_allclose(model.dof_damping[6:], drawn.damping.ravel())
    np.testing.assert_allclose(model.dof_frictionloss[6:], drawn.friction.ravel())
    for limb in range(2):
        name = f"limb{limb}/grasp/x"
        ratio = model.actuator(name).biasprm[1:3] / plain.actuator(name).biasprm[1:3]
        np.testing.assert_allclose(ratio, drawn.stiffness[limb])
    # MuJoCo's inverse weights follow the masses.
    assert not np.allclose(model.dof_invweight0, plain.dof_invweight0)


def test_points_that_are_off_are_found_by_the_guided_limb_alone(checked_graph, plan):
    """5 mm off, every point: a limb that follows the map comes to rest as far from its point."""
    robot, points = plan.world.robot, len(checked_graph.grasp_map)
    drawn = DisturbanceRanges(point_position=0.005).draw(2, 17, 2, points)
    away = drawn.point_offsets / np.linalg.norm(drawn.point_offsets, axis=1, keepdims=True)
    drawn = replace(drawn, point_offsets=0.005 * away)
    found = {}
    for name, controller in (
        ("guided", ControllerParameters()),
        ("blind", CONTROLLERS["feedforward"]),
    ):
        simulation = Simulation(
            checked_graph.grasp_map, robot, controller=controller, disturbance=drawn
        )
        done = execute(checked_graph, plan, PACES["gentle"], simulation=simulation)
        assert done.failure is None
        found[name] = done.captures[0].distance
    assert found["blind"] == pytest.approx(0.005, abs=5e-4)
    assert found["guided"] < 0.0015


def test_a_grasp_misses_where_its_tolerance_is_tiny(checked_graph, plan):
    setup = Setup.of(controller=CONTROLLERS["feedforward"], physics={"capture_distance": 1e-9})
    simulation = setup.simulation(checked_graph.grasp_map, plan.world.robot)
    failure = execute(checked_graph, plan, PACES["gentle"], simulation=simulation).failure
    assert (failure.kind, failure.step, failure.phase) == ("missed grasp", 0, "approach")
    assert failure.limb == plan.steps[0].limb
    assert failure.values["distance_m"] > failure.values["allowed_distance_m"] == 1e-9


def test_a_grasp_is_refused_as_often_as_stated(checked_graph, plan):
    ranges = DisturbanceRanges(refusal=0.3)
    simulation = Setup(disturbances=ranges).simulation(checked_graph.grasp_map, plan.world.robot)
    refusals = np.array([simulation.refuses(3) for _ in range(10_000)])
    assert refusals.mean() == pytest.approx(0.3, abs=4.0 * np.sqrt(0.21 / 10_000))
    assert (refusals[:-1] & refusals[1:]).mean() == pytest.approx(0.09, abs=0.02)  # independent
    never = Setup().simulation(checked_graph.grasp_map, plan.world.robot)
    assert not any(never.refuses(k) for k in range(50))
    simulation = Simulation(checked_graph.grasp_map, plan.world.robot)
    simulation.refuses = lambda _: True
    failure = execute(checked_graph, plan, PACES["gentle"], simulation=simulation).failure
    assert (failure.kind, failure.step, failure.phase) == ("refused grasp", 0, "approach")


def test_a_seed_gives_one_walk_and_another_seed_another(checked_graph, plan):
    setup, errors = Setup(PACES["gentle"], disturbances=ALL), []
    for seed in (9, 10, 9):
        simulation = setup.simulation(checked_graph.grasp_map, plan.world.robot, (), seed)
        walk = execute(checked_graph, plan, setup.timing, simulation=simulation)
        errors.append(walk.peaks.base_error)
    assert errors[0] == errors[2] != errors[1]
