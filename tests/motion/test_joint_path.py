"""Joint paths: supports hold on lines and splines, and both stay close to what was checked."""

from functools import cache

import mujoco
import numpy as np
import pytest
from random_steps import random_walk

from mlivr_gym import jem_map, robot_spec, stance_graph
from mlivr_gym.motion.commitment import committed_motion
from mlivr_gym.motion.joint_path import HOLD_TOLERANCE, JointPath, PathSegment
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.motion.straight_base import path_of, support_joints
from mlivr_gym.simulation.scene import scene_spec, set_configuration

ROBOT = robot_spec("mlivr2")

NORMAL_TOLERANCE = 2e-4
"""How far a gripper may be off the normal of its point [m]."""

PLACES = np.array([0.0, 0.13, 0.37, 0.5, 0.81])
"""Where lines and splines are looked at between two knots."""


@cache
def walks(limbs):
    """The graph of a robot, and motions of random steps that it takes."""
    graph, rng, motions = stance_graph(jem_map(), f"mlivr{limbs}"), np.random.default_rng(limbs), []
    while len(motions) < 4:
        motions.append(committed_motion(graph, random_walk(graph, rng, 3)).motion)
    return graph, motions


@pytest.fixture(scope="module", autouse=True)
def walks_go_with_this_file():
    yield
    walks.cache_clear()


@pytest.fixture(params=[2, 3, 4])
def steps(request):
    """The graph of a robot, and stance, stance after, joint path and number of random steps."""
    graph, motions = walks(request.param)
    return graph, [
        (*motion.stances[k : k + 2], motion.joint_path(graph.robot, k), (motion, k))
        for motion in motions
        for k in range(len(motion.steps))
    ]


class Judge:
    """MuJoCo's kinematics of a robot on a map."""

    def __init__(self, graph):
        self.map = graph.grasp_map
        self.model = scene_spec(self.map, graph.robot).compile()
        self.data = mujoco.MjData(self.model)

    def grippers(self, path, joints):
        """Positions and z axes of all grippers, shape (k, N, 2, 3)."""
        places, turns = path.base(joints)
        out = np.empty((len(joints), joints.shape[1], 2, 3))
        for k, q in enumerate(joints):
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, turns[k].ravel())
            set_configuration(self.model, self.data, places[k], quaternion, q)
            for limb in range(len(q)):
                site = self.data.site(f"limb{limb}/grasp")
                out[k, limb] = site.xpos, site.xmat.reshape(3, 3)[:, 2]
        return out

    def off(self, path, stance, joints):
        """Largest distance of a support's gripper from its point, and of its axis."""
        held = [self.map.index(stance[limb]) for limb in path.supports]
        found = self.grippers(path, joints)[:, path.supports]
        truth = np.stack([self.map.positions[held], -self.map.normals[held]], axis=1)
        return np.linalg.norm(found - truth, axis=-1).max()


def between(path):
    """Joint angles on the lines and on the spline at `PLACES` between all knots."""
    share = PLACES[:, None, None]
    lines = path.knots[:-1, None] + share * np.diff(path.knots, axis=0)[:, None]
    sigmas = path.sigmas[:-1, None] + np.diff(path.sigmas)[:, None] * PLACES
    number = sigmas.ravel().astype(int)
    splines = [
        path.segments[k].joints_at(np.array([sigma - k]))[0]
        for k, sigma in zip(number, sigmas.ravel(), strict=True)
    ]
    return lines.reshape(-1, *path.knots.shape[1:]), np.array(splines)


def test_supports_hold_their_points_at_knots_on_lines_and_on_splines(steps):
    """By MuJoCo: exactly at knots, and within 0.2 mm on lines and on splines."""
    graph, every = steps
    judge, slips = Judge(graph), []
    for before, _, path, _ in every:
        assert judge.off(path, before, path.knots) < 1e-6
        assert path.slips(path.knots).max() < 1e-9
        lines, splines = between(path)
        slips.append([judge.off(path, before, joints) for joints in (lines, splines)])
        np.testing.assert_array_less(path.slips(lines), HOLD_TOLERANCE)
    assert np.max(slips) < HOLD_TOLERANCE


def test_the_gripper_stays_on_the_normal_and_ends_at_its_points(steps):
    graph, every = steps
    judge = Judge(graph)
    for before, after, path, _ in every:
        lines, splines = between(path)
        sigmas = (path.sigmas[:-1, None] + np.diff(path.sigmas)[:, None] * PLACES).ravel()
        for point, chosen, end in (
            (before[path.limb], sigmas < 1.0, 0),
            (after[path.limb], sigmas > path.sigmas[-1] - 1.0, -1),
        ):
            k = graph.grasp_map.index(point)
            place, normal = graph.grasp_map.positions[k], graph.grasp_map.normals[k]
            for joints in (path.knots[[end]], lines[chosen], splines[chosen]):
                found = judge.grippers(path, joints)[:, path.limb] - [place, -normal]
                heights = found[:, 0] @ normal
                off = np.linalg.norm(found[:, 0] - heights[:, None] * normal, axis=1)
                assert off.max() < NORMAL_TOLERANCE
                assert np.linalg.norm(found[:, 1], axis=1).max() < 2.0 * NORMAL_TOLERANCE
                assert (heights > -1e-6).all()
                assert (heights < graph.robot.lift + 1e-6).all()
            np.testing.assert_allclose(
                judge.grippers(path, path.knots[[end]])[0, path.limb, 0], place, atol=1e-6
            )


def test_lines_and_splines_stay_close_to_what_was_checked(steps):
    """Base and grippers, by MuJoCo, against inverse kinematics at the same base parameter.

    How far the spline is off the lines is what a check of the lines does not see of an execution: a
    few tenths of a millimetre, and never a twentieth of the clearance.
    """
    graph, every = steps
    judge, away = Judge(graph), []
    for _, _, path, (motion, number) in every:
        lines, splines = between(path)
        gap = judge.grippers(path, lines) - judge.grippers(path, splines)
        away.append(np.linalg.norm(gap[:, :, 0], axis=-1).max())
        ends = StepEnds.of(graph, motion, number)
        s = np.linspace(0.0, 1.0, 4001)
        exact = support_joints(graph, ends, path_of(ends), s, ends.joints[0])
        for joints in (path.knots, splines):  # somewhere on the base path there is such a posture
            for q in joints[::7, path.leader]:
                near = np.abs(exact[:, path.leader] - q).max(axis=1)
                assert near.min() < 2e-3
    assert max(away) < 1e-3
    assert np.median(away) < 5e-4


def test_the_base_path_is_as_long_as_the_base_travels(steps):
    _, every = steps
    for _, _, path, (motion, k) in every:
        chord = np.linalg.norm(np.diff(motion.base_positions[k : k + 2], axis=0))
        moved = path.samples(400).base_positions
        assert path.base_chord == pytest.approx(chord, abs=1e-6)
        assert path.base_length >= path.base_chord - 1e-9
        length = np.linalg.norm(np.diff(moved, axis=0), axis=1).sum()
        assert path.base_length == pytest.approx(length, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("count", [2, 6])
def test_a_segment_is_smooth_and_no_joint_passes_its_knots(count):
    """Of random knots; at a place where acceleration jumps, its differences would not shrink."""
    rng = np.random.default_rng(count)
    knots = rng.uniform(-1.0, 1.0, (count, 2, 6))
    path = JointPath(ROBOT, 1, 0, np.zeros(3), np.eye(3), knots, ())
    segment, jumps = PathSegment.of(path, 1, knots), []
    for samples in (4001, 8001):
        joints = segment.joints_at(np.linspace(0.0, 1.0, samples))
        second = np.diff(joints, 2, axis=0) * (samples - 1) ** 2
        jumps.append(np.abs(np.diff(second, axis=0)).max(initial=0.0))
        assert (joints <= knots.max(axis=0) + 1e-9).all()
        assert (joints >= knots.min(axis=0) - 1e-9).all()
    np.testing.assert_allclose(joints[[0, -1]], knots[[0, -1]], atol=1e-12)
    assert jumps[1] < 0.6 * jumps[0] + 1e-3
