import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from mlivr_gym import Settings, stance_graph
from mlivr_gym.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.pair_graph import fill_rows
from mlivr_gym.reliability import failure_probabilities
from mlivr_gym.step_tables import CACHE_VARIABLE, cache_file, step_tables, without_points
from mlivr_gym.vector_env import MlivrVectorEnv


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """A cache directory of the tests' own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def single(small_map, cache):
    """The small map with collisions; every step is asked of the graph."""
    return MlivrEnv(map=small_map)


@pytest.fixture(scope="module")
def exact(small_map, cache):
    return MlivrEnv(map=small_map, precompute=True)


def same(ours, theirs):
    return all(np.array_equal(ours[name], theirs[name]) for name in theirs)


@pytest.mark.parametrize(("reward", "collisions"), [("steps", True), ("base", False)])
def test_vector_environment_equals_single_environments(small_map, reward, collisions):
    """Step by step on random walks, some actions not possible: observation, reward, end, masks and info."""
    options = {"map": small_map, "collisions": collisions, "reward": reward, "success_bonus": 3.0, "shaping": True}
    copies = MlivrVectorEnv(4, 12, **options)
    observations, infos = copies.reset(seed=1)
    singles = [MlivrEnv(**options) for _ in range(4)]
    for env in singles[1:]:
        env.graph = singles[0].graph  # what one has found out the others need not
    rng = np.random.default_rng(0)
    compared = 0
    for env, start, goal in zip(singles, observations["stance"], copies.goals, strict=True):
        env.reset(options={"start": start.tolist(), "goal": goal})
    over = np.zeros(4, dtype=bool)
    for _ in range(60):
        actions = (rng.random(infos["action_mask"].shape) * infos["action_mask"]).argmax(axis=1)
        actions[rng.random(4) < 0.1] = 0
        observations, rewards, ended, cut, infos = copies.step(actions)
        for k, env in enumerate(singles):
            if over[k]:
                _, info = env.reset(options={"start": observations["stance"][k].tolist(), "goal": copies.goals[k]})
                assert rewards[k] == 0.0 and infos["steps"][k] == 0 and not ended[k] and not cut[k]
                continue
            observation, reward, terminated, _, info = env.step(int(actions[k]))
            assert same({name: rows[k] for name, rows in observations.items()}, observation)
            assert rewards[k] == pytest.approx(reward, abs=1e-12) and ended[k] == terminated
            assert cut[k] == (info["steps"] >= 12)
            for name in ("action_mask", "limb_manipulability", "base_position"):
                np.testing.assert_array_equal(infos[name][k], info[name])
            for name in ("base_translation", "steps", "base_manipulability", "is_success", "invalid_action"):
                assert infos[name][k] == pytest.approx(info[name], abs=1e-12)
            compared += 1
        over = ended | cut
    assert compared > 150


def test_tables_give_the_steps_of_the_graph(single, exact):
    """The environment from tables and the one that asks the graph go alike."""
    rng = np.random.default_rng(2)
    for seed in range(3):
        ours, theirs = exact.reset(seed=seed), single.reset(seed=seed)
        for _ in range(20):
            assert same(ours[0], theirs[0]) and same(ours[-1], {"action_mask": theirs[-1]["action_mask"]})
            a, b = exact.successors(), single.successors()
            assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
            action = int(rng.choice(np.flatnonzero(theirs[-1]["action_mask"])))
            ours, theirs = exact.step(action), single.step(action)


def test_tables_without_some_points_are_those_of_the_occupied_map(small_map):
    graph = stance_graph(small_map, settings=Settings(collisions=False))
    free = step_tables(graph)
    taken = np.random.default_rng(0).permutation(len(small_map))[:10]
    occupied = np.zeros(len(small_map), dtype=bool)
    occupied[taken] = True
    thinned = without_points(free, occupied)
    graph.occupy(taken.tolist())
    there = step_tables(graph)
    for name in ("start", "after", "left", "masks"):
        np.testing.assert_array_equal(getattr(thinned, name), getattr(there, name))


def test_what_is_cached_is_what_was_worked_out(small_map, monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "new"))
    fewer = small_map.subset(small_map.positions[:, 0] < 2.2, "smaller")
    first, second = stance_graph(fewer), stance_graph(fewer)
    assert len(step_tables(first).after) > 200
    assert cache_file(first).exists()
    monkeypatch.setattr("mlivr_gym.step_tables.fill_rows", lambda *_: pytest.fail("the cache was not used"))
    step_tables(second)
    np.testing.assert_array_equal(first.table, second.table)
    np.testing.assert_array_equal(first.mask, second.mask)
    monkeypatch.setattr("mlivr_gym.step_tables.fill_rows", fill_rows)
    cache_file(first).write_bytes(b"no archive")
    third = stance_graph(fewer)
    step_tables(third)
    np.testing.assert_array_equal(first.table, third.table)
    other = stance_graph(fewer, settings=Settings(path_floor=0.035))
    assert cache_file(other) != cache_file(first)
    monkeypatch.setenv(CACHE_VARIABLE, "")
    assert cache_file(first) is None


def test_made_by_gymnasium_and_seeded(small_map):
    made = gymnasium.make_vec("MLIVR-JEM-v0", num_envs=3, map=small_map, collisions=False)
    assert isinstance(made.unwrapped, MlivrVectorEnv) and made.unwrapped.max_episode_steps == 100
    assert made.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    one, other = made.reset(seed=5)[0], made.reset(seed=5)[0]
    assert same(one, other) and made.observation_space.contains(one)
    assert not same(one, made.reset(seed=6)[0])
    assert same({k: v[1:] for k, v in one.items()}, {k: v[:2] for k, v in made.reset(seed=6)[0].items()})


def test_only_some_copies_start_anew(small_map):
    copies = MlivrVectorEnv(3, 2, AutoresetMode.DISABLED, map=small_map, collisions=False)
    _, infos = copies.reset(seed=0)
    for _ in range(2):
        _, _, ended, cut, infos = copies.step(infos["action_mask"].argmax(axis=1))
    assert (ended | cut).all()
    with pytest.raises(SettingError, match="episode 0 has ended"):
        copies.step(infos["action_mask"].argmax(axis=1))
    goals = copies.goals.copy()
    copies.reset(options={"reset_mask": np.array([True, False, False])})
    assert copies.steps.tolist() == [0, 2, 2] and (copies.goals[1:] == goals[1:]).all()


def test_bad_input_is_named(small_map):
    for words, change in (
        ("num_envs is 0", {"num_envs": 0}),
        ("autoreset_mode is 'now'", {"autoreset_mode": "now"}),
        ("does not render", {"render_mode": "rgb_array"}),
        ("exact tables need two limbs", {"robot": "mlivr3", "collisions": False}),
        ("grasp_failure is 0.6", {"grasp_failure": 0.6}),
    ):
        with pytest.raises(SettingError, match=words):
            MlivrVectorEnv(**({"num_envs": 1, "map": small_map, "collisions": False} | change))
    copies = MlivrVectorEnv(2, map=small_map, collisions=False)
    copies.reset(seed=0)
    with pytest.raises(SettingError, match="actions must be 2 numbers"):
        copies.step(np.array([0, 10**6]))
    with pytest.raises(SettingError, match="unknown reset option 'begin'"):
        copies.reset(options={"begin": 1})


@pytest.mark.parametrize("vector", [False, True])
def test_grasps_fail_as_often_as_said(small_map, vector):
    """Shares of failed attempts against their probabilities; a failed attempt leaves the stance and costs a step."""
    options = {
        "map": small_map,
        "collisions": False,
        "goal_tolerance": 0.0,
        "grasp_failure": 0.3,
        "grasp_failure_seed": 4,
    }
    rng = np.random.default_rng(0)
    expected, failed, attempts = 0.0, 0, 0
    if vector:
        copies = MlivrVectorEnv(64, None, **options)
        before, infos = copies.reset(seed=0)
        risk, m = copies.env.failure_probability, len(small_map)
        for _ in range(60):
            actions = (rng.random(infos["action_mask"].shape) * infos["action_mask"]).argmax(axis=1)
            after, _, _, _, infos = copies.step(actions)
            stayed = (after["stance"] == before["stance"]).all(axis=1)
            np.testing.assert_array_equal(stayed, infos["grasp_failed"])
            expected, failed = expected + risk[actions % m].sum(), failed + stayed.sum()
            attempts, before = attempts + 64, after
    else:
        env = MlivrEnv(**options)
        _, info = env.reset(seed=0)
        for _ in range(1500):
            before, moved = info["stance"], info["base_translation"]
            action = int(rng.choice(np.flatnonzero(info["action_mask"])))
            expected += env.failure_probability[action % len(small_map)]
            _, reward, _, _, info = env.step(action)
            assert info["grasp_failed"] == (info["stance"] == before) and info["action_mask"].any() and reward == -1.0
            assert info["action_mask"][action] or not info["grasp_failed"]
            assert info["base_translation"] >= moved
            failed, attempts = failed + info["grasp_failed"], attempts + 1
    assert abs(failed - expected) < 4.0 * np.sqrt(expected)
    assert attempts > 1000


def test_failure_probabilities():
    drawn = failure_probabilities(20_000, 0.2, seed=1)
    assert drawn.mean() == pytest.approx(0.2, abs=0.005) and drawn.min() >= 0.0 and drawn.max() <= 0.4
    np.testing.assert_array_equal(failure_probabilities(3, np.array([0.0, 0.5, 0.9])), [0.0, 0.5, 0.9])
    with pytest.raises(SettingError, match="3 numbers"):
        failure_probabilities(3, np.array([0.0, 1.0, 0.5]))
