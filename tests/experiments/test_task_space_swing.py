"""Swings in task space against MuJoCo's forward kinematics and the distances of shapes."""

import importlib

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.motion.clocks import Durations
from mlivr_gym.motion.regrasp import PHASES, RegraspPath, planned_regrasp
from mlivr_gym.motion.trajectory import trajectory
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.scene import scene_spec, set_configuration
from mlivr_gym.simulation.timing import step_trajectory, timed_path

PERIOD = 0.05


@pytest.fixture(scope="module")
def module(experiments):
    return importlib.import_module("task_space_swing")


@pytest.fixture(scope="module")
def plan(checked_graph):
    return Planner(checked_graph).plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()


@pytest.fixture(scope="module")
def tried(module, checked_graph, plan):
    """Each step as planned, with its swings in task space."""
    regrasps = [planned_regrasp(checked_graph, plan, k) for k in range(len(plan.steps))]
    return [(regrasp, module.attempts(checked_graph, regrasp)) for regrasp in regrasps]


@pytest.fixture(scope="module")
def followed(tried):
    """A swing of every step that has one, and every swing of the first step."""
    chosen = [
        (index, regrasp, next(attempt for attempt in found if attempt.followed))
        for index, (regrasp, found) in enumerate(tried)
        if any(attempt.followed for attempt in found)
    ]
    regrasp, found = tried[0]
    chosen += [(0, regrasp, attempt) for attempt in found if attempt.followed]
    assert {attempt.half_turn for _, _, attempt in chosen} == {False, True}
    return [
        (*entry, trajectory(timed_path(entry[2].path, Durations()), PERIOD)) for entry in chosen
    ]


@pytest.fixture(scope="module")
def grasps(jem, plan):
    """Grasp frames of a limb along a trajectory, by MuJoCo."""
    model = scene_spec(jem, plan.world.robot).compile()
    data = mujoco.MjData(model)

    def along(found, limb, samples):
        positions, rotations = [], []
        for k in samples:
            pose = found.base_positions[k], found.base_quaternions[k], found.joint_positions[k]
            set_configuration(model, data, *pose)
            site = data.site(f"limb{limb}/grasp")
            positions.append(site.xpos.copy())
            rotations.append(site.xmat.reshape(3, 3).copy())
        return np.array(positions), np.array(rotations)

    return along


def quintic(times):
    """The polynomial through the six conditions at both ends, solved for."""
    powers = np.arange(6)
    at = [np.zeros(6), np.zeros(6), np.zeros(6)]
    at[0][0], at[1][1], at[2][2] = 1.0, 1.0, 2.0
    ends = [np.ones(6), powers.astype(float), powers * (powers - 1.0)]
    coefficients = np.linalg.solve(np.array(at + ends), [0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    return np.polynomial.Polynomial(coefficients)(times)


def ends_of(graph, regrasp):
    """Where the gripper is above its points, from the map."""
    points = [regrasp.before[regrasp.limb], regrasp.to_point]
    return (
        graph.grasp_map.positions[points]
        + graph.robot.lift * graph.grasp_map.normals[points]
    )  # fmt: skip


def test_the_gripper_is_on_the_quintic_between_the_points_above(checked_graph, followed, grasps):
    for _, regrasp, _, found in followed:
        samples = np.flatnonzero(found.phase == PHASES.index("swing"))[::25]
        positions, _ = grasps(found, regrasp.limb, samples)
        share = quintic((found.times[samples] - 10.0) / 30.0)[:, None]
        first, last = ends_of(checked_graph, regrasp)
        np.testing.assert_allclose(positions, first + share * (last - first), atol=1e-6)


def test_the_gripper_turns_by_slerp(followed, grasps):
    """About one axis, by an angle that goes with the quintic, no farther than it has to."""
    for _, regrasp, attempt, found in followed:
        samples = np.flatnonzero(found.phase == PHASES.index("swing"))[::25]
        _, rotations = grasps(found, regrasp.limb, samples)
        _, (first, last) = grasps(found, regrasp.limb, [0, len(found.times) - 1])
        whole = Rotation.from_matrix(first.T @ last).as_rotvec()
        turned = Rotation.from_matrix(first.T @ rotations)
        angles = quintic((found.times[samples] - 10.0) / 30.0) * attempt.turn
        np.testing.assert_allclose(turned.magnitude(), angles, atol=1e-6)
        assert np.linalg.norm(whole) == pytest.approx(attempt.turn, abs=1e-6)
        if attempt.turn < 3.0:  # the axis of a half turn has two signs
            np.testing.assert_allclose(
                turned.as_rotvec(), angles[:, None] / attempt.turn * whole
                if attempt.turn > 1e-6 else 0.0 * turned.as_rotvec(), atol=1e-5,
            )  # fmt: skip


def test_a_swing_starts_and_ends_where_the_gripper_grasps(checked_graph, followed, grasps):
    grasp_map = checked_graph.grasp_map
    for _, regrasp, _, found in followed:
        ends = [0, len(found.times) - 1]
        positions, rotations = grasps(found, regrasp.limb, ends)
        points = [regrasp.before[regrasp.limb], regrasp.to_point]
        np.testing.assert_allclose(positions, grasp_map.positions[points], atol=1e-6)
        np.testing.assert_allclose(rotations[:, :, 2], -grasp_map.normals[points], atol=1e-6)
        rails = grasp_map.rotations[points][:, :, 0]
        across = np.abs((rotations[:, :, 0] * rails).sum(axis=1))
        np.testing.assert_allclose(across, across[0], atol=1e-6)


def test_on_the_plans_branch_it_starts_as_the_plan_does(checked_graph, plan, followed):
    """In the same joint angles, departure included, with base and holding limb as planned."""
    seen = 0
    for index, regrasp, attempt, found in followed:
        planned = step_trajectory(checked_graph, plan, index, Durations(), PERIOD)
        if attempt.branch == regrasp.branches[regrasp.limb]:
            departed = found.phase == PHASES.index("departure")
            np.testing.assert_allclose(
                found.joint_positions[departed], planned.joint_positions[departed], atol=1e-9
            )
            seen += 1
        path = RegraspPath(checked_graph, regrasp)
        share = quintic(np.clip((found.times - 10.0) / 30.0, 0.0, 1.0))
        np.testing.assert_allclose(found.base_positions, path.base(share)[0], atol=1e-9)
        held = 1 - regrasp.limb
        np.testing.assert_allclose(
            found.joint_positions[:, held], path.supports(share)[:, held], atol=1e-9
        )
    assert seen


def test_a_swing_that_is_followed_is_smooth_and_inside_the_limits(checked_graph, followed):
    limits = checked_graph.robot.limb.limits
    for _, regrasp, _, found in followed:
        joints = found.joint_positions[:, regrasp.limb]
        assert (joints >= limits[:, 0] - 1e-6).all()
        assert (joints <= limits[:, 1] + 1e-6).all()
        assert np.abs(np.diff(joints, axis=0)).max() < 0.3
        speeds = found.joint_velocities[:, regrasp.limb]
        ends = np.flatnonzero(np.diff(found.phase))
        assert np.abs(speeds[[0, -1, *ends]]).max() < 0.01


def closest(graph, regrasp, attempt):
    """Least distance at places along a swing, as far as it is below the clearance."""
    share, clearance = np.linspace(0.0, 1.0, 41), graph.settings.clearance
    path, least = attempt.path, np.inf
    _, joints = path.swing(0, share)
    positions, rotations = path.base(share)
    everything = path.supports(share)
    everything[:, regrasp.limb] = joints
    held = 1 - regrasp.limb
    point = regrasp.before[held]
    grasp = held, graph.grasp_map.positions[point], graph.grasp_map.normals[point]
    for position, rotation, angles in zip(positions, rotations, everything, strict=True):
        turned = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        where = position, turned, angles
        found = contacts(graph.robot, graph.grasp_map.boxes, where, clearance, [grasp])
        least = min([least, *(contact.distance for contact in found)])
    return least


def test_what_is_free_keeps_the_clearance_and_what_is_too_close_does_not(checked_graph, tried):
    outcomes = []
    for regrasp, found in tried[:3]:
        for outcome in ("free", "too close"):
            for attempt in [attempt for attempt in found if attempt.outcome == outcome][:2]:
                least = closest(checked_graph, regrasp, attempt)
                # Looked at in places, against what is proved all along: a hair is allowed.
                assert (least < checked_graph.settings.clearance) == (outcome == "too close")
                outcomes.append(outcome)
    assert set(outcomes) == {"free", "too close"}


def test_what_cannot_be_followed_has_no_path(tried):
    for _, found in tried:
        assert len(found) <= 16
        for attempt in found:
            assert attempt.followed == (attempt.outcome in ("free", "too close"))
    assert any(not attempt.followed for _, found in tried for attempt in found)


def whole(attempt):
    """Joint angles of the limb that moves along a whole step, at the places that are looked at."""
    share = np.linspace(0.0, 1.0, 401)
    path = attempt.path
    return np.concatenate([path.departure(share), path.swing(0, share)[1], path.approach(share)])


def test_a_joint_that_leaves_its_limits_is_told(module, checked_graph, tried, monkeypatch):
    """Limits narrower by what the middle one of the swings that can be followed has to spare."""
    limits = checked_graph.robot.limb.limits
    regrasp, found = tried[0]
    spare = {
        (attempt.branch, attempt.half_turn): np.minimum(
            whole(attempt) - limits[:, 0], limits[:, 1] - whole(attempt)
        ).min()
        for attempt in found
        if attempt.followed
    }
    middle = float(np.median(list(spare.values()))) + 1e-4
    monkeypatch.setattr(module, "LIMIT_TOLERANCE", -middle)
    again = module.attempts(checked_graph, regrasp)
    told = {(a.branch, a.half_turn): a.outcome == "joint limit" for a in again}
    assert {key: told[key] for key in spare} == {k: v < middle for k, v in spare.items()}
    assert len(set(told.values())) == 2


def test_a_jump_is_told(module, checked_graph, tried, monkeypatch):
    """Where more than the middle one of the largest changes counts as one."""
    regrasp, found = tried[0]
    largest = {
        (attempt.branch, attempt.half_turn): np.abs(np.diff(whole(attempt), axis=0)).max()
        for attempt in found
        if attempt.followed
    }
    middle = float(np.median(list(largest.values()))) - 1e-6
    monkeypatch.setattr(module, "LARGEST_JUMP", middle)
    again = module.attempts(checked_graph, regrasp)
    told = {(a.branch, a.half_turn): a.outcome == "jump" for a in again}
    assert {key: told[key] for key in largest} == {k: v > middle for k, v in largest.items()}
    assert len(set(told.values())) == 2


def test_the_best_is_free_then_on_the_branch_then_of_the_least_turn(module):
    def attempt(branch, outcome, turn):
        return module.Attempt(branch, False, turn, outcome, None)

    found = [
        attempt(3, "too close", 0.0),
        attempt(5, "free", 1.0),
        attempt(3, "free", 3.0),
        attempt(3, "free", 2.0),
        attempt(3, "joint limit", 0.0),
    ]
    assert module.best(found, 3) == found[3]
    assert module.best(found, 5) == found[1]
    assert module.best(found[:1] + found[4:], 5) == found[0]
