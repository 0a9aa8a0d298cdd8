import numpy as np
import pytest
from branches import angles_on, arm_of
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import flange, pinocchio_arm
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, Settings, robot_spec, stance_graph
from mlivr_gym.kinematics.manipulability import base_manipulability, limb_manipulability
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.stances.implicit_graph import ImplicitGraph


def truth(graph, postures, k, stance, branch):
    """Return `w_m` of each limb and `w_b` of a posture by Pinocchio and their definition."""
    robot = graph.robot
    arm = pinocchio_arm(robot.limb)
    jacobians, grasps, w_m = [], [], []
    for i, point in enumerate(stance):
        mount = postures.base_rotation[k] @ robot.mount_rotations[i]
        origin = postures.base_position[k] + postures.base_rotation[k] @ robot.mount_positions[i]
        pose = np.eye(4)
        pose[:3, :3] = mount.T @ graph.solver.grasps[point]["flange"]["rotation"]
        pose[:3, 3] = mount.T @ (graph.solver.grasps[point]["flange"]["position"] - origin)
        q = angles_on(arm_of(robot.limb), pose[:3, 3], pose[:3, :3], int(branch[i]))
        assert q is not None
        found, jacobian = flange(arm, q)
        np.testing.assert_allclose(found, pose, atol=1e-6)
        w_m.append(limb_manipulability(jacobian, robot.characteristic_length))
        tip = robot.tool_length * found[:3, 2]
        jacobian = jacobian.copy()
        jacobian[:3] += np.cross(jacobian[3:].T, tip).T
        jacobians.append(np.kron(np.eye(2), robot.mount_rotations[i]) @ jacobian)
        grasps.append(
            postures.base_rotation[k].T
            @ (graph.grasp_map.positions[point] - postures.base_position[k])
        )
    return w_m, base_manipulability(
        np.array(jacobians), np.array(grasps), robot.characteristic_length
    )


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_postures_have_the_manipulability_they_claim(jem, limbs):
    graph = ImplicitGraph(
        jem, robot_spec(f"mlivr{limbs}"), Settings(collisions=False, manipulability=False)
    )
    rng = np.random.default_rng(limbs)
    stances = []
    while len(stances) < 200:
        first = int(rng.integers(len(jem)))
        rest = rng.choice(graph.partners(first), limbs - 1, replace=False)
        stances.append((first, *rest.tolist()))
    postures = graph.postures(np.array(stances))
    found = np.flatnonzero(postures.reachable & (postures.w_m.min(axis=1) > 0.01))
    assert len(found) > 10
    for k in found[:25]:
        w_m, w_b = truth(graph, postures, k, stances[k], postures.branch[k])
        np.testing.assert_allclose(postures.w_m[k], w_m, rtol=1e-4)
        assert postures.w_b[k] == pytest.approx(w_b, rel=1e-3)


@given(st.integers(0, 10**6))
@settings(max_examples=15, deadline=None)
def test_postures_move_with_the_grasps(seed):
    """A map that is rotated and shifted as a whole has the same postures, rotated and shifted."""
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.uniform(-3, 3, 3)
    rows = []
    for k in range(12):
        normal = Rotation.random(rng=rng).as_matrix()
        rows.append((f"P{k}", rng.uniform(-0.8, 0.8, 3), normal))

    def build(moved):
        points = []
        for name, position, frame in rows:
            p, f = (turn @ position + shift, turn @ frame) if moved else (position, frame)
            points.append(
                {
                    "id": name,
                    "face": "deck",
                    "position": p.tolist(),
                    "normal": f[:, 2].tolist(),
                    "rail": f[:, 0].tolist(),
                }
            )
        return GraspMap.from_dict({"points": points})

    pairs = np.array([(i, j) for i in range(12) for j in range(12) if i != j])
    here, there = (
        PostureSolver(
            build(moved), robot_spec("mlivr2"), Settings(collisions=False, manipulability=False)
        ).solve(pairs)
        for moved in (False, True)
    )
    np.testing.assert_allclose(here.w_m, there.w_m, atol=1e-4)
    same = (here.w_m.min(axis=1) > 0.01) & (here.branch == there.branch).all(axis=1)
    np.testing.assert_allclose(
        here.base_position[same] @ turn.T + shift, there.base_position[same], atol=1e-4
    )


def test_body_faces_away_from_a_wall_and_lies_on_the_line_of_the_grasps(graph):
    rng = np.random.default_rng(2)
    for s in rng.integers(0, len(graph), 100):
        a, b = graph.points[s]
        normal = graph.grasp_map.normals[[a, b]].mean(axis=0)
        assert graph.base_rotation[s][:, 2] @ normal > 0.5
        line = graph.grasp_map.positions[a] - graph.grasp_map.positions[b]
        np.testing.assert_allclose(
            graph.base_rotation[s][:, 0], line / np.linalg.norm(line), atol=1e-6
        )


def test_stances_between_opposite_walls_have_a_posture(kinematic_graph):
    faces = np.array(kinematic_graph.grasp_map.faces)[kinematic_graph.points]
    opposed = (faces[:, 0] == "deck") & (faces[:, 1] == "overhead")
    assert opposed.sum() > 100
    assert (kinematic_graph.w_m[opposed] > 0.0).all()


def test_counts_agree_with_the_independent_calculation(jem):
    """43,540 ordered pairs within 2.4 m, 27,010 in reach by heights alone, no opposite walls."""
    from dataclasses import replace

    graph = stance_graph(
        jem,
        replace(robot_spec("mlivr2"), rolls=(0.0,)),
        Settings(collisions=False, manipulability=False, transitions=False),
    )
    assert graph.considered == 43540
    normals = jem.normals[graph.points]
    opposed = (normals[:, 0] * normals[:, 1]).sum(axis=1) < -0.5
    assert (~opposed).sum() == 27010
    kept = (graph.w_m.min(axis=1) >= 0.1) & (graph.w_b >= 0.001) & ~opposed
    assert abs(kept.sum() - 20842) < 0.01 * 20842
