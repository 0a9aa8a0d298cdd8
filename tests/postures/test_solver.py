import numpy as np

from mlivr_gym import Settings, robot_spec, stance_graph


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
