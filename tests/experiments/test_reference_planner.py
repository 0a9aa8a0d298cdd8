"""The plain reference finds the same stances as the package, and breaks no rule of its own."""

import numpy as np

from mlivr_gym import Settings, stance_graph


def test_stances_of_the_plain_reference_are_those_of_the_graph(small_map):
    from reference_planner import ReferencePlanner

    settings = Settings(transitions=False, collisions=False)
    graph = stance_graph(small_map, settings=settings)
    reference = ReferencePlanner(small_map, graph.robot, settings)
    rng = np.random.default_rng(0)
    rows = graph.points[rng.choice(len(graph), 8, replace=False)]
    found = [reference.evaluate(tuple(row)) for row in rows.tolist()]
    # Its inverse kinematics is numerical: it finds one branch of many, or none at all, and so may
    # prefer another of the base poses that both try, or know no stance.
    held = [k for k, base in enumerate(found) if base is not None]
    assert len(held) >= 6
    for k in held:
        tried, _ = graph.solver.candidate_poses(rows[k].tolist())
        assert np.linalg.norm(tried - found[k], axis=1).min() < 1e-9
    same = [np.allclose(found[k], graph.base_position[graph.find(tuple(rows[k].tolist()))])
            for k in held]  # fmt: skip
    assert any(same)
