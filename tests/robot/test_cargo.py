"""Cargo against MuJoCo: its mass and inertia, what it covers, and walks that carry it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mlivr_gym import robot_spec, stance_graph
from mlivr_gym.collisions.limb_shapes import cargo_capsules
from mlivr_gym.extensions.reaction.fastest import step_reactions
from mlivr_gym.extensions.station_load.spectra import station_load
from mlivr_gym.planners import Planner
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.scene import scene_spec, set_configuration
from mlivr_gym.simulation.timing import plan_trajectory

ON_TOP = Cargo(10.0, (0.3, 0.4, 0.2))
BESIDE = Cargo(30.0, (0.45, 0.25, 0.3), (0.02, 0.26, 0.05))
START, GOAL = ("D2a:4", "D2b:4"), (4.0, 0.0, 0.42)


def with_cargo(cargo):
    return replace(robot_spec("mlivr2"), cargo=cargo)


@pytest.fixture(scope="module")
def part(jem):
    """The part of the module in which the walk is."""
    return jem.subset(jem.positions[:, 0] < 5.0)


@pytest.fixture(scope="module")
def graph(part):
    return stance_graph(part, with_cargo(BESIDE))


@pytest.fixture(scope="module")
def plan(graph):
    return Planner(graph).plan(START, GOAL, "steps").unwrap()


@pytest.mark.parametrize("cargo", [ON_TOP, BESIDE])
def test_body_and_cargo_have_the_inertia_that_mujoco_gives_two_boxes(cargo):
    robot, spec = with_cargo(cargo), mujoco.MjSpec()
    both = spec.worldbody.add_body()
    both.add_freejoint()
    box = mujoco.mjtGeom.mjGEOM_BOX
    both.add_geom(type=box, size=[0.1] * 3, mass=20.0)
    place = cargo.centre or (0.0, 0.0, 0.1 + 0.5 * cargo.size[2])
    both.add_geom(type=box, size=0.5 * np.array(cargo.size), pos=place, mass=cargo.mass)
    truth, base = spec.compile(), robot_model(robot)

    def figures(model, body):
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        turn = turn.reshape(3, 3)
        about = turn @ np.diag(model.body_inertia[body]) @ turn.T
        return model.body_mass[body], model.body_ipos[body], about

    for ours, theirs in zip(figures(base, base.body("base").id), figures(truth, 1), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


@pytest.mark.parametrize("cargo", [ON_TOP, BESIDE, Cargo(1.0, 0.2)])
def test_capsules_cover_the_cargo_and_stay_within_the_extent(cargo):
    robot, rng = with_cargo(cargo), np.random.default_rng(1)
    points = robot.cargo_frame[:3, 3] + rng.uniform(-0.5, 0.5, (2000, 3)) * cargo.edges
    ends, radii = cargo_capsules(robot)
    along = ends[:, 1] - ends[:, 0]
    share = ((points[:, None] - ends[:, 0]) * along).sum(axis=2) / (along**2).sum(axis=1).clip(
        1e-12
    )
    nearest = ends[:, 0] + share.clip(0.0, 1.0)[..., None] * along
    inside = np.linalg.norm(points[:, None] - nearest, axis=2) <= radii + 1e-12
    assert inside.any(axis=1).all()
    assert (np.linalg.norm(ends, axis=2) + radii[:, None]).max() <= robot.extent
    beyond = (
        np.abs(ends - robot.cargo_frame[:3, 3]).max(axis=(0, 1)) + radii.max() - 0.5 * cargo.edges
    )
    assert beyond.max() < 0.25 * cargo.edges.max()


def test_no_limb_and_no_box_comes_near_the_cargo_on_a_walk(part, graph, plan):
    """MuJoCo measures distances from the box itself; without cargo the walk would meet it."""
    model = scene_spec(part, graph.robot).compile()
    data, cargo = mujoco.MjData(model), model.geom("cargo").id
    fixed = "limb0/base", "limb1/base", "limb0/shoulder", "limb1/shoulder", "body", "cargo"
    others = [
        g for g in range(model.ngeom)
        if model.geom(g).name and not model.geom(g).name.startswith(fixed) and model.geom(g).contype
    ]  # fmt: skip

    def nearest(walk):
        way, least = plan_trajectory(graph, walk, period=0.1), np.inf
        for k in range(len(way.times)):
            set_configuration(
                model, data, way.base_positions[k], way.base_quaternions[k], way.joint_positions[k]
            )
            for g in others:
                least = min(least, mujoco.mj_geomDistance(model, data, g, cargo, 0.1, None))
        return least

    assert nearest(plan) >= 0.02 - 1e-3
    free = Planner(stance_graph(part)).plan(START, GOAL, "steps").unwrap()
    assert nearest(free) < 0.02


def test_a_walk_with_cargo_is_carried_out_and_heavier_cargo_takes_longer(part, graph, plan):
    execution = execute(graph, plan)
    assert execution.failure is None
    peaks = station_load(execution.recording).peak_forces
    planned = step_reactions(graph, plan)
    for one, peak in zip(planned, peaks, strict=True):
        assert one.peak_force == pytest.approx(peak, rel=0.1)
    heavy = stance_graph(part, with_cargo(replace(BESIDE, mass=100.0)))
    slower = step_reactions(heavy, replace(plan, world=replace(plan.world, robot=heavy.robot)))
    assert sum(one.seconds for one in slower) > 1.1 * sum(one.seconds for one in planned)
