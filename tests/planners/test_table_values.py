"""Cost-to-go over step tables, against the planner's table and Bellman's equation."""

import numpy as np
import pytest

from mlivr_gym.planners import Planner
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.table_values import TableValues, in_goal_region


def values_to(env, cost, risk=None, most=np.inf):
    tables = env.table_moves().tables
    goals = in_goal_region(tables, env.goal[None], 0.2)
    return TableValues(tables, goals, Cost.named(cost), risk, most)


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_table_values_are_the_planners_cost_to_go(env, cost):
    planner = Planner(env.graph)
    for seed in range(3):
        env.reset(seed=seed)
        table = planner.cost_to_go(env.goal.tolist(), cost)
        ours = values_to(env, cost)
        held = (env.graph.branch_sets > 0).all(axis=1)
        np.testing.assert_allclose(ours.of_stances(0)[held], table.values[held], atol=1e-9)
        rng = np.random.default_rng(seed)
        for _ in range(10):
            steps = env.successors()
            s = np.array([env.moves.stance_at[env.state.stance]], dtype=np.int64)
            got = ours.of_actions(
                s, np.array([env.state.branch_sets]), np.zeros(1, np.int64), len(env._mask)
            )[0]
            actions = steps.limb * len(env.graph.grasp_map) + steps.point
            np.testing.assert_allclose(
                got[actions], table.action_values(env.state, steps), atol=1e-9
            )
            best = actions[table.best(env.state, steps)]
            assert got[best] == pytest.approx(got.min(), abs=1e-9)
            assert np.isfinite(got).sum() <= len(actions)
            env.step(int(rng.choice(actions)))


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_expected_costs_solve_the_bellman_equation(env, cost):
    """Each stance's expected cost against one sweep of the equation with failures written out.

    A failed grasp costs a step, or the displacement there and back, and the stance stays.
    """
    risk = np.random.default_rng(0).uniform(0.0, 0.6, len(env.graph.grasp_map))
    env.reset(seed=3)
    tables = env.table_moves().tables
    values = values_to(env, cost, risk)
    checked = 0
    for s in np.random.default_rng(1).permutation(len(tables.points))[:40]:
        for held in range(2):
            for b in range(16):
                mine = values.values[0, s, held, b]
                if values.is_goal[0, s] or not np.isfinite(mine):
                    continue
                best = np.inf
                for e in range(tables.start[2 * s + 1 - held], tables.start[2 * s + 2 - held]):
                    if tables.kept[e] >> b & 1:
                        after = tables.after[e]
                        rest = values.values[0, after, held, b]
                        if tables.releasable[after, held] >> b & 1:
                            rest = min(rest, values.grasped[0, after, 1 - held])
                        p = risk[tables.points[after, 1 - held]]
                        d = np.linalg.norm(tables.base_position[after] - tables.base_position[s])
                        one, two = (1.0, 1.0) if cost == "steps" else (d, 2.0 * d)
                        # V = p (two + V) + (1 - p) (one + rest)
                        best = min(best, (p * two + (1.0 - p) * (one + rest)) / (1.0 - p))
                assert mine == pytest.approx(best, abs=1e-6)
                checked += 1
    assert checked > 100


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_costs_up_to_a_limit_are_all_costs_below_it(env, cost):
    env.reset(seed=0)
    every = values_to(env, cost).values
    known = every[np.isfinite(every) & (every > 0.0)]
    for most in (0.0, np.quantile(known, 0.3) + 1e-6, known.max()):
        some = values_to(env, cost, most=float(most)).values
        found = np.isfinite(some)
        np.testing.assert_allclose(some[found], every[found], atol=1e-7)
        assert found[every <= most - 1e-7].all()
        assert not found[every > most + 1e-7].any()
