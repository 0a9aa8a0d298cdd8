"""Cost-to-go and regret in the information, against NetworkX and sums written here."""

import gymnasium
import networkx as nx
import numpy as np
import pytest
from small_tables import small_map as few_points
from small_tables import small_table
from state_graph import reachable, within

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.regret import EpisodeRegret
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.planners.costs import Cost

pytestmark = pytest.mark.usefixtures("cache")


@pytest.fixture(scope="module")
def few(small_map):
    """Half of the points, so that all states are soon known to NetworkX."""
    return small_map.subset(np.arange(len(small_map)) % 2 == 0, "few")


def prices(stances, points):
    """A user's prices, by numbers of points."""
    return 0.1 * (points % 5) + 0.01 * stances.sum(axis=1)


def paid(cost, before, after, metres):
    """What a step costs, in plain words."""
    if cost == "steps":
        return 1.0
    if cost == "base":
        return metres
    (point,) = set(after) - set(before)
    return 0.5 * metres + 0.2 + 0.1 * (point % 5) + 0.01 * sum(after)


def least(net, env, cost):
    """Least cost from the present state to the goal region, by Dijkstra's algorithm."""
    name = f"paid by {REWARDS.index(cost)}"
    for a, b, edge in net.edges(data=True):
        if name not in edge:
            edge[name] = paid(cost, a.stance, b.stance, edge["base"])
    costs = nx.single_source_dijkstra_path_length(net, env.state, weight=name)
    ends = within(net, env.goal, env.goal_tolerance)
    return min((costs[end] for end in ends if end in costs), default=np.inf)


REWARDS = ["steps", "base", Cost.custom(0.5, 0.2, prices)]


@pytest.fixture(scope="module")
def states():
    """All that is reached from the starts so far, whatever the reward."""
    return nx.DiGraph()


@pytest.mark.parametrize("reward", REWARDS)
def test_cost_to_go_and_regret_are_those_of_another_library(few, reward, states):
    env = MlivrEnv(map=few, collisions=False, reward=reward, info_regret=True)
    rng, net, wasted = np.random.default_rng(0), states, 0
    for seed in range(4):
        _, info = env.reset(seed=seed)
        net = reachable(env.graph, env.state, known=net)
        first, spent, longest = least(net, env, reward), 0.0, env.graph.max_displacement
        assert info["optimal_cost"] == pytest.approx(first, abs=1e-9)
        assert info["regret"] == 0.0
        for k in range(6):
            valid = np.flatnonzero(env.action_masks() == (k != 3))
            before, metres = env.state.stance, env.base_translation
            _, _, over, _, info = env.step(int(rng.choice(valid)))
            if k == 3:  # an action that is not valid costs a step of the greatest displacement
                spent += {"steps": 1.0, "base": longest}.get(reward, 0.5 * longest + 0.2)
            else:
                moved = env.base_translation - metres
                spent += paid(reward, before, env.state.stance, moved)
            to_go = least(net, env, reward)
            assert info["optimal_cost"] == pytest.approx(to_go, abs=1e-9)
            assert info["regret"] == pytest.approx(spent + to_go - first, abs=1e-9)
            assert info["regret"] >= -1e-9
            wasted += info["regret"] > 1e-6
            if over:
                break
    assert wasted > 2


@pytest.mark.parametrize(("reward", "failing"), [(REWARDS[1], 0.3), (REWARDS[2], 0.0)])
def test_many_environments_tell_what_single_ones_do(small_map, reward, failing):
    """To the bit, over ends of episodes and resets."""
    how = {"map": small_map, "collisions": False, "reward": reward, "grasp_failure": failing}
    many = MlivrVectorEnv(3, 7, info_regret=True, **how)
    singles = [gymnasium.make("MLIVR-JEM-v0", 7, info_regret=True, **how) for _ in range(3)]
    infos = [one.reset(seed=5 + k)[1] for k, one in enumerate(singles)]
    _, told = many.reset(seed=5)
    rng, ended, resets = np.random.default_rng(1), [False] * 3, 0
    for _ in range(30):
        for name in ("optimal_cost", "regret"):
            assert told[name].tolist() == [info[name] for info in infos]
            assert told[f"_{name}"].all()
        actions = [int(rng.choice(np.flatnonzero(info["action_mask"]))) for info in infos]
        actions[0] = int(rng.integers(many.single_action_space.n))
        _, _, terminated, truncated, told = many.step(np.array(actions))
        for k, one in enumerate(singles):
            if ended[k]:
                infos[k], resets = one.reset()[1], resets + 1
            else:
                infos[k] = one.step(actions[k])[4]
        ended = (terminated | truncated).tolist()
    assert resets > 5


def test_an_unreachable_goal_and_a_changed_world_are_told(small_map):
    env = MlivrEnv(map=small_map, collisions=False, info_regret=True)
    _, info = env.reset(seed=1)
    assert 0.0 < info["optimal_cost"] < np.inf
    held = set(env.state.stance)
    env.graph.occupy([p for p in range(len(small_map)) if p not in held])
    _, _, _, _, info = env.step(int(env.action_masks().argmin()))
    assert info["optimal_cost"] == info["regret"] == np.inf
    env.graph.vacate()
    _, _, _, _, info = env.step(int(env.action_masks().argmin()))
    assert info["regret"] == 2.0


@pytest.mark.parametrize("has_table", [True, False])
def test_more_limbs_have_a_lower_bound_and_its_gap(has_table):
    """All rewards along the same walks, whose states NetworkX need know but once."""
    graph, _ = small_table(3)
    net, positive = None, 0
    for reward in REWARDS:
        env, rng = MlivrEnv("mlivr3", few_points(), reward=reward), np.random.default_rng(0)
        env.graph.graph_table = graph.graph_table if has_table else None
        env.regret = EpisodeRegret(env)
        for seed in range(2):
            _, info = env.reset(seed=seed)
            net = reachable(graph, env.state, known=net)
            first, spent = info["optimal_cost_lower_bound"], 0.0
            assert info["lower_bound_gap"] == 0.0
            for _ in range(3):
                bound = info["optimal_cost_lower_bound"]
                assert bound <= least(net, env, reward) + 1e-6
                positive += bound > 0.0
                before, metres = env.state.stance, env.base_translation
                _, _, over, _, info = env.step(int(rng.choice(np.flatnonzero(env.action_masks()))))
                spent += paid(reward, before, env.state.stance, env.base_translation - metres)
                gap = spent + info["optimal_cost_lower_bound"] - first
                assert info["lower_bound_gap"] == pytest.approx(gap, abs=1e-9)
                if over:
                    break
    assert positive
