"""Learned policies: features, the pointer network, imitation, training of each algorithm, checkpoints."""

import json
import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

from mlivr_gym.agents import ExpertPolicy, Task, evaluate
from mlivr_gym.agents.evaluation import bootstrap
from mlivr_gym.agents.features import (
    DEPTH,
    LIMB,
    PointObservation,
    TableFeatures,
    env_features,
    reach_of_points,
)
from mlivr_gym.agents.imitation import Imitation, ImitationSettings, optimal_set_loss
from mlivr_gym.agents.learned import (
    CheckpointError,
    LearnedPolicy,
    beam_policy,
    beam_walk,
    load_policy,
    save_policy,
)
from mlivr_gym.agents.networks import as_tensors, make_policy, scores_and_value
from mlivr_gym.agents.sb3_env import TableVecEnv
from mlivr_gym.agents.test_set import SPLITS, held_out_goals, load_test_set
from mlivr_gym.agents.training import METHODS, hyperparameters, train
from mlivr_gym.cli.main import main
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import Planner
from mlivr_gym.stances.moves import GraphMoves
from mlivr_gym.stances.stance_graph import State
from mlivr_gym.world.grasp_map import GraspMap

LADDER = {
    "segments": [
        {
            "id": f"R{k}",
            "face": "deck",
            "start": [x, -0.4, 0.0],
            "end": [x, 0.4, 0.0],
            "normal": [0, 0, 1],
        }
        for k, x in enumerate((0.0, 0.9, 1.8))
    ],
    "cabin": {"min": [-1, -1, 0], "max": [3, 1, 2]},
}
"""A user's own map: three short rails on a floor."""

SHORT = {"rounds": 2, "layouts": 2, "goals": 4, "walks": 3, "updates": 10, "batch": 32}


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def env(small_map):
    return MlivrEnv(map=small_map, collisions=False, precompute=True)


@pytest.fixture
def policy(env):
    torch.manual_seed(0)
    policy = make_policy(env, "pointer", {"width": 32, "summary": 16})
    for parameter in policy.parameters():
        torch.nn.init.normal_(parameter, std=0.3)
    return policy


def test_point_observation_is_an_environment(env):
    wrapped = PointObservation(
        gymnasium.make("MLIVR-JEM-v0", map=env.graph.grasp_map, collisions=False)
    )
    with pytest.raises(gymnasium.error.ResetNeeded):
        wrapped.action_masks()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")
        check_env(wrapped, skip_render_check=True)


def test_features_are_positions_seen_from_the_robot(env):
    """Back in the world they are the points, the goal and the places the base moves to."""
    env.reset(seed=0)
    seen = {name: rows[0].astype(float) for name, rows in env_features(env).items()}
    posture, grasp_map = env.graph.posture(env.state.stance), env.graph.grasp_map
    base, rotation = posture.position[0], posture.rotation[0]
    np.testing.assert_allclose(
        seen["points"][:, :3] @ rotation.T + base, grasp_map.positions, atol=1e-5
    )
    np.testing.assert_allclose(seen["points"][:, 3:6] @ rotation.T, grasp_map.normals, atol=1e-5)
    np.testing.assert_allclose(rotation @ seen["goal"][:3] + base, env.goal, atol=1e-5)
    assert seen["goal"][3] == pytest.approx(np.linalg.norm(env.goal - base), abs=1e-5)
    assert seen["goal"][4] == pytest.approx(0.2)
    assert [int(row.argmax()) for row in seen["limbs"][:, :, 0]] == list(env.state.stance)
    np.testing.assert_array_equal(seen["limbs"][:, :, 1].ravel() > 0, env.action_masks())
    steps = env.successors()
    for limb, point, position in zip(steps.limb, steps.point, steps.position, strict=True):
        np.testing.assert_allclose(
            rotation @ seen["limbs"][limb, point, 2:5] + base, position, atol=1e-5
        )


def test_features_from_tables_are_those_of_the_environment(env):
    features, moves = TableFeatures(env), env.table_moves()
    for seed in range(4):
        env.reset(seed=seed)
        s = np.array([moves.stance_at[env.state.stance]], dtype=np.int64)
        batch = features(
            moves.tables,
            s,
            np.array([env.state.masks]),
            env.goal[None],
            reach_of_points(env.graph, env.goal)[None],
        )
        for name, rows in env_features(env).items():
            np.testing.assert_array_equal(batch[name], rows)


def test_reach_is_the_nearest_base_of_all_stances_that_follow(env):
    """After one step any stance with the point, after each further one any that the other limb's point is kept in."""
    graph, goal = env.graph, np.array([1.5, 0.0, 0.0])
    reach, held = reach_of_points(graph, goal), (graph.mask > 0).all(axis=1)
    distance = np.linalg.norm(graph.position - goal, axis=1)
    for limb in range(2):
        for point in range(0, len(graph.grasp_map), 3):
            stances, kept = held & (graph.points[:, limb] == point), limb
            for depth in range(DEPTH):
                assert reach[limb, point, depth] == pytest.approx(
                    distance[stances].min(initial=10.0), abs=1e-12
                )
                kept = 1 - kept
                stances = held & np.isin(graph.points[:, kept], graph.points[stances, kept])


def test_the_pointer_policy_does_not_depend_on_order_or_number_of_points(env, policy):
    """Scores of permuted points are permuted; points that may not be grasped and are not held change nothing."""
    env.reset(seed=1)
    seen = env_features(env)
    order = np.random.default_rng(0).permutation(len(env.graph.grasp_map))
    turned = {
        "points": seen["points"][:, order],
        "limbs": seen["limbs"][:, :, order],
        "goal": seen["goal"],
    }
    more = {
        "points": np.concatenate([seen["points"], np.tile([[[9.0, 9, 9, 0, 0, 1, 0, 0]]], (1, 7, 1))], axis=1),
        "limbs": np.concatenate([seen["limbs"], np.zeros((1, 2, 7, LIMB))], axis=2),
        "goal": seen["goal"],
    }  # fmt: skip
    more = {name: rows.astype(np.float32) for name, rows in more.items()}
    with torch.no_grad():
        scores, value = scores_and_value(policy, as_tensors(policy, seen))
        scores = scores.reshape(2, -1)
        other, other_value = scores_and_value(policy, as_tensors(policy, turned))
        longer, longer_value = scores_and_value(policy, as_tensors(policy, more))
    assert np.ptp(scores.numpy()[seen["limbs"][0, :, :, 1] > 0]) > 0.1
    np.testing.assert_allclose(other.reshape(2, -1), scores[:, order], atol=1e-4)
    np.testing.assert_allclose(longer.reshape(2, -1)[:, :-7], scores, atol=1e-4)
    np.testing.assert_allclose([other_value, longer_value], [value, value], atol=1e-4)


def test_the_pointer_policy_does_not_depend_on_the_order_of_limbs(env, policy):
    env.reset(seed=1)
    seen = env_features(env)
    with torch.no_grad():
        scores, value = scores_and_value(policy, as_tensors(policy, seen))
        swapped = {**seen, "limbs": seen["limbs"][:, ::-1]}
        other, other_value = scores_and_value(policy, as_tensors(policy, swapped))
    np.testing.assert_allclose(other.reshape(2, -1).flip(0), scores.reshape(2, -1), atol=1e-5)
    np.testing.assert_allclose(other_value, value, atol=1e-5)


def test_loss_on_sets_against_brute_force():
    rng = np.random.default_rng(0)
    scores = rng.normal(size=(5, 7))
    legal = rng.random((5, 7)) < 0.7
    legal[:, 0] = True
    optimal = legal & (rng.random((5, 7)) < 0.4)
    optimal[:, 0] = True
    expected = 0.0
    for k in range(5):
        weights = [np.exp(scores[k, a]) if legal[k, a] else 0.0 for a in range(7)]
        expected -= np.log(sum(weights[a] for a in range(7) if optimal[k, a]) / sum(weights)) / 5
    loss = optimal_set_loss(*map(torch.as_tensor, (scores, legal, optimal)))
    assert loss.item() == pytest.approx(expected, abs=1e-12)


def test_labels_are_the_steps_of_optimal_plans(env):
    """The cost of each gathered state is that of the planner's plan; the planner's own cost-to-go calls the same actions optimal."""
    imitation = Imitation(env, make_policy(env, "mlp", {}), True, ImitationSettings(**SHORT), 0)
    samples, _ = imitation.gather(np.ones(len(env.graph.grasp_map), dtype=bool), expert=True)
    planner, tables = Planner(env.graph), env.table_moves().tables
    m = len(env.graph.grasp_map)
    fresh = [
        k
        for k in range(len(samples.cost))
        if (samples.masks[k] == tables.masks[samples.stances[k]]).all()
    ]
    assert len(fresh) >= 10
    for k in fresh[:10]:
        stance, goal = tables.points[samples.stances[k]].tolist(), samples.goals[k]
        plan = planner.plan(stance, goal.tolist(), "steps").unwrap()
        assert samples.cost[k] == len(plan.steps)
    labels = []
    for k in range(len(samples.cost)):
        state = State(
            tuple(tables.points[samples.stances[k]].tolist()), tuple(samples.masks[k].tolist())
        )
        steps = env.graph.successors(state)
        costs = planner.cost_to_go(samples.goals[k].tolist(), "steps").action_values(state, steps)
        assert samples.cost[k] == pytest.approx(costs.min())
        expected = set((steps.limb * m + steps.point)[costs < costs.min() + 0.5].tolist())
        assert (
            set(np.flatnonzero(np.unpackbits(samples.optimal[k], count=2 * m)).tolist()) == expected
        )
        labels.append((len(expected), len(costs)))
    assert sum(most > 1 for most, _ in labels) > 10
    assert sum(most < least for most, least in labels) > 10


@pytest.mark.parametrize("dagger", [True, False])
def test_dagger_lets_the_policy_walk_after_the_first_round(env, dagger, monkeypatch):
    settings = ImitationSettings(**(SHORT | {"rounds": 3, "updates": 1, "dagger": dagger}))
    imitation, walks, rounds = (
        Imitation(env, make_policy(env, "mlp", {}), True, settings, 0),
        [],
        [],
    )
    chosen, learn = imitation._chosen, imitation._learn
    monkeypatch.setattr(
        imitation, "_chosen", lambda samples: walks.append(len(rounds)) or chosen(samples)
    )
    monkeypatch.setattr(imitation, "_learn", lambda *given: rounds.append(learn(*given)))
    imitation.run()
    assert set(walks) == ({1, 2} if dagger else set())


def test_imitation_teaches_the_value(env):
    """Of states it has not seen: the farther from the goal, the lower."""
    torch.manual_seed(0)
    policy = make_policy(env, "pointer", {"width": 32, "summary": 16})
    settings = ImitationSettings(
        rounds=1,
        layouts=3,
        goals=8,
        walks=6,
        updates=80,
        batch=64,
        learning_rate=3e-3,
        value_weight=0.5,
    )
    imitation = Imitation(env, policy, False, settings, 0)
    imitation.run()
    samples, _ = imitation.gather(np.ones(len(env.graph.grasp_map), dtype=bool), expert=True)
    with torch.no_grad():
        value = scores_and_value(policy, imitation.observe(samples)[0])[1].numpy()
    assert np.corrcoef(value, -samples.cost)[0, 1] > 0.5


def test_features_tell_points_that_are_taken_and_their_risk(small_map):
    risk = np.linspace(0.0, 0.5, len(small_map))
    world = MlivrEnv(map=small_map, collisions=False, grasp_failure=risk)
    world.graph.occupy([3, 8])
    world.reset(seed=0)
    points = env_features(world)["points"][0]
    assert np.flatnonzero(points[:, 6] == 0.0).tolist() == [3, 8]
    assert (np.delete(points[:, 6], [3, 8]) == 1.0).all()
    np.testing.assert_allclose(points[:, 7], risk, atol=1e-6)


def test_tables_and_graph_agree_on_who_may_let_go_next(small_map):
    """From states of walks among racks, where some limbs that hold cannot depart."""
    env = MlivrEnv(map=small_map, precompute=True)
    rng, graph_moves, differ = np.random.default_rng(0), GraphMoves(env.graph), 0
    for seed in range(10):
        env.reset(seed=seed)
        for _ in range(6):
            steps = env.moves.successors(env.state)
            ours = env.table_moves().releasable_after(env.state, steps)
            np.testing.assert_array_equal(ours, graph_moves.releasable_after(env.state, steps))
            for k, (limb, point) in enumerate(
                zip(steps.limb.tolist(), steps.point.tolist(), strict=True)
            ):
                after = env.moves.take(env.state, limb * len(env.graph.grasp_map) + point)
                lets_go = env.graph.successors(after).limb != limb
                assert ours[k] or not lets_go.any()
            differ += not ours.all()
            env.step(int(rng.choice(np.flatnonzero(env.action_masks()))))
    assert differ > 0


def test_a_policy_never_returns_to_a_stance(env, monkeypatch):
    """Not even one whose scores would step to and fro for ever."""
    learned = LearnedPolicy(make_policy(env, "mlp", {}), "mlp")
    scores = torch.arange(2.0 * len(env.graph.grasp_map))[None]
    monkeypatch.setattr("mlivr_gym.agents.learned.scores_and_value", lambda *_: (scores, None))
    forgets = LearnedPolicy(learned.policy, "mlp", memory=False)
    for policy in (learned, forgets):
        for seed in (0, 1):
            observation, info = env.reset(seed=seed)
            env.goal = np.array([50.0, 0.0, 0.0])  # never reached
            stances = [info["stance"]]
            for _ in range(8):
                observation, *_, info = env.step(policy.act(env, observation, env.action_masks()))
                stances.append(info["stance"])
            assert (len(set(stances)) == 9) == (policy is learned)


def test_held_out_goals_are_not_learnt_from(env):
    settings = ImitationSettings(**SHORT)
    free = np.ones(len(env.graph.grasp_map), dtype=bool)
    first, _ = Imitation(env, make_policy(env, "mlp", {}), True, settings, 3).gather(free, True)
    goal = first.goals[:1]
    second, _ = Imitation(env, make_policy(env, "mlp", {}), True, settings, 3, goal).gather(
        free, True
    )
    assert (np.linalg.norm(first.goals - goal, axis=1) < 0.01).any()
    assert len(second.goals)
    assert not (np.linalg.norm(second.goals - goal, axis=1) < 0.01).any()


@pytest.mark.parametrize("network", ["pointer", "mlp"])
@pytest.mark.parametrize("method", METHODS)
def test_each_algorithm_trains_and_its_checkpoint_acts_alike(env, tmp_path, method, network):
    settings = hyperparameters(method)
    sizes = {"pointer": {"width": 16, "summary": 8}, "mlp": {"net_arch": [16]}}
    settings["networks"] = sizes
    if "imitation" in settings:
        settings["imitation"] = settings["imitation"] | SHORT
    if "ppo" in settings:
        settings |= {
            "copies": 4,
            "timesteps": 256,
            "ppo": settings["ppo"] | {"n_steps": 32, "batch_size": 64},
        }
    phases = {}
    init = None
    if method == "finetune":
        init = tmp_path / "first"
        save_policy(
            init,
            make_policy(env, network, sizes[network]),
            {"network": network, "sizes": sizes[network]},
        )
        with pytest.raises(SettingError, match="needs a checkpoint"):
            train(method, network, env=env, settings=settings)
    trained = train(
        method, network, 1, env=env, settings=settings, init=init, out=tmp_path / "policy",
        command="none",
        progress=lambda phase, done, total, figures: phases.update({phase: (done, total)}),
    )  # fmt: skip
    assert phases
    assert all(done == total for done, total in phases.values())
    config = json.loads((tmp_path / "policy.json").read_text())
    assert config["method"] == method
    assert config["seed"] == 1
    assert config["sizes"] == sizes[network]
    loaded = load_policy(tmp_path / "policy", env)
    observation, _ = env.reset(seed=0)
    assert loaded.act(env, observation, env.action_masks()) == trained.act(
        env, observation, env.action_masks()
    )
    assert evaluate(env, loaded, 2, max_steps=5).steps.max() <= 5


@pytest.mark.parametrize("method", ["bc", "ppo"])
def test_an_interrupted_training_leaves_what_was_learned(env, tmp_path, method):
    sizes = {"pointer": {"width": 16, "summary": 8}}
    ppo = {"copies": 4, "timesteps": 10**6, "ppo": {"n_steps": 32, "batch_size": 64}}
    settings = {"networks": sizes} | ({"imitation": SHORT} if method == "bc" else ppo)
    told = []

    def interrupt(*_):
        told.append(0)
        if len(told) == 3:
            raise KeyboardInterrupt

    with pytest.raises(
        KeyboardInterrupt, match=r"interrupted after .*policy\.pt and \.json hold what was learned"
    ):
        train(
            method, seed=1, env=env, settings=settings, out=tmp_path / "policy", progress=interrupt
        )
    policy = load_policy(tmp_path / "policy", env)
    assert policy.config["interrupted"] is True
    torch.manual_seed(1)
    untrained = make_policy(env, "pointer", sizes["pointer"]).state_dict()
    assert any(
        not torch.equal(value, untrained[name])
        for name, value in policy.policy.state_dict().items()
    )


def test_a_training_interrupted_at_once_overwrites_nothing(env, tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Imitation, "gather", interrupt)
    settings = {"imitation": SHORT, "networks": {"pointer": {"width": 16, "summary": 8}}}
    with pytest.raises(KeyboardInterrupt, match="nothing was written"):
        train("bc", env=env, settings=settings, out=tmp_path / "policy")
    assert not list(tmp_path.iterdir())


def test_imitation_lowers_its_loss_and_arrives(env):
    torch.manual_seed(0)
    policy = make_policy(env, "pointer", {"width": 32, "summary": 16})
    settings = ImitationSettings(
        rounds=2, layouts=3, goals=8, walks=6, updates=80, batch=64, learning_rate=3e-3
    )
    losses = []
    Imitation(env, policy, False, settings, 0).run(
        lambda done, total, figures: losses.append(figures["loss"])
    )
    assert len(losses) == 160
    assert np.mean(losses[-20:]) < 0.75 * np.mean(losses[:20])
    assert (
        evaluate(env, LearnedPolicy(policy, "pointer"), 20, seed=100, max_steps=30).success_rate
        >= 0.8
    )


def test_equal_seeds_train_equal_policies(env):
    settings = {"imitation": SHORT, "networks": {"pointer": {"width": 16, "summary": 8}}}
    a, b, c = (
        train("bc", "pointer", seed, env=env, settings=settings).policy.state_dict()
        for seed in (5, 5, 6)
    )
    assert all(torch.equal(a[name], b[name]) for name in a)
    assert any(not torch.equal(a[name], c[name]) for name in a)


@pytest.mark.parametrize("network", ["pointer", "mlp"])
def test_policies_run_in_maskable_ppo_and_subprocesses(small_map, network, tmp_path):
    """The plain way of stable-baselines3: single environments in processes, model saved and loaded by it."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    from mlivr_gym.agents.networks import policy_class

    vector = make_vec_env(
        "mlivr_gym:MLIVR-JEM-v0", n_envs=2, seed=0, vec_env_cls=SubprocVecEnv,
        env_kwargs={"map": small_map, "collisions": False},
        wrapper_class=PointObservation if network == "pointer" else None,
    )  # fmt: skip
    try:
        model = MaskablePPO(policy_class(network), vector, n_steps=16, batch_size=16, seed=0)
        model.learn(32)
        model.save(tmp_path / "model")
        loaded = MaskablePPO.load(tmp_path / "model")
        observation, masks = vector.reset(), np.stack(vector.env_method("action_masks"))
        chosen = [
            one.predict(observation, action_masks=masks, deterministic=True)[0]
            for one in (model, loaded)
        ]
        np.testing.assert_array_equal(*chosen)
        assert masks[np.arange(2), chosen[0]].all()
    finally:
        vector.close()


def test_one_copy_alone_cannot_be_changed(env):
    with pytest.raises(SettingError, match="'reward'.*share one world"):
        TableVecEnv(env, 2, "points").set_attr("reward", "base")


def test_copies_for_stable_baselines3_go_like_single_environments(env, small_map):
    copies = TableVecEnv(env, 3, "points", max_episode_steps=6)
    copies.seed(0)
    observations = copies.reset()
    with pytest.raises(gymnasium.error.ResetNeeded):
        TableVecEnv(env, 3).action_masks()
    singles = [MlivrEnv(map=small_map, collisions=False) for _ in range(3)]

    def follow(k):
        stance = copies.copies.tables.points[copies.copies.stances[k]].tolist()
        singles[k].reset(options={"start": stance, "goal": copies.copies.goals[k].copy()})

    for k in range(3):
        follow(k)
    rng, expert = np.random.default_rng(0), ExpertPolicy()
    ended, arrived = 0, 0
    for _ in range(60):
        masks = np.stack(copies.env_method("action_masks"))
        np.testing.assert_array_equal(masks, observations["limbs"][..., 1].reshape(3, -1) > 0)
        actions = (rng.random(masks.shape) * masks).argmax(axis=1)
        actions[0] = expert.act(singles[0], {}, masks[0])
        observations, rewards, dones, infos = copies.step(actions)
        assert (rewards == -1.0).all()
        for k, single in enumerate(singles):
            _, _, success, _, info = single.step(int(actions[k]))
            assert dones[k] == (success or info["steps"] == 6)
            if not dones[k]:
                assert infos[k] == {}
                continue
            ended, arrived = ended + 1, arrived + success
            assert infos[k]["episode"]["l"] == -infos[k]["episode"]["r"] == info["steps"]
            assert infos[k]["is_success"] is success
            assert infos[k]["TimeLimit.truncated"] is not success
            for name, rows in env_features(single).items():
                np.testing.assert_array_equal(rows[0], infos[k]["terminal_observation"][name])
            follow(k)
        for k, single in enumerate(singles):
            assert single.state.masks == tuple(copies.copies.masks[k].tolist())
    assert ended >= 25
    assert 3 <= arrived < ended


def test_faulty_checkpoints_are_named(env, policy, tmp_path):
    with pytest.raises(CheckpointError, match="cannot use checkpoint.*nowhere"):
        load_policy(tmp_path / "nowhere", env)
    save_policy(tmp_path / "one", policy, {"network": "pointer", "sizes": {"width": 64}})
    with pytest.raises(CheckpointError, match="cannot use checkpoint"):
        load_policy(tmp_path / "one", env)
    mlp = LearnedPolicy(make_policy(env, "mlp", {}), "mlp")
    other = MlivrEnv(
        map=env.graph.grasp_map.subset(np.arange(len(env.graph.grasp_map)) % 4 > 0),
        collisions=False,
    )
    with pytest.raises(CheckpointError, match="cannot use checkpoint|actions|one map only"):
        save_policy(tmp_path / "mlp", mlp.policy, {"network": "mlp", "sizes": {}})
        load_policy(tmp_path / "mlp", other)
    with pytest.raises(SettingError, match="method is 'magic'"):
        train("magic", env=env)
    with pytest.raises(SettingError, match="network is 'cnn'"):
        train("bc", "cnn", env=env)


def test_a_beam_finds_walks_that_the_policy_alone_does_not(env, policy):
    """Even random weights lead a wide beam to the goal; one that keeps every stance finds the fewest steps."""
    learned, planner = LearnedPolicy(policy, "pointer"), Planner(env.graph)
    tasks = []
    for seed in range(40):
        env.reset(seed=seed)
        tasks.append((len(planner.plan(env.state.stance, env.goal, "steps").unwrap().steps), seed))
    for fewest, seed in sorted(tasks)[-4:]:
        env.reset(seed=seed)
        assert fewest > 2
        assert len(beam_walk(learned, env, len(env.graph))) == fewest
        actions = beam_walk(learned, env, 64)
        assert actions is not None
        for k, action in enumerate(actions):
            _, _, terminated, _, info = env.step(action)
            assert not info["invalid_action"]
            assert terminated == (k == len(actions) - 1)
    assert evaluate(env, beam_policy(learned, 64), 2).success.all()
    with pytest.raises(SettingError, match="needs a pointer policy"):
        beam_policy(LearnedPolicy(make_policy(env, "mlp", {}), "mlp"))


def test_the_test_set_is_as_described(jem):
    worlds = load_test_set()
    sizes = {split: sum(len(w.tasks) for w in worlds if w.split == split) for split in SPLITS}
    assert min(sizes.values()) >= 50
    assert sum(sizes.values()) >= 200
    assert len(held_out_goals()) == sum(sizes.values())
    for world in worlds:
        grasp_map = world.map()
        for task in world.tasks:
            for point in (*task.start, *task.occupied):
                grasp_map.index(point)
            assert not set(task.start) & set(task.occupied)
            grasp_map.check_goal(task.goal)
        assert (world.split == "half") == (len(grasp_map) == len(jem) // 2)
        assert (world.split == "occupied") == all(len(task.occupied) > 60 for task in world.tasks)


def test_tasks_are_evaluated_with_their_points_occupied(env):
    planner = Planner(env.graph)
    for seed in range(20):
        env.reset(seed=seed)
        start, goal = env.graph.ids(env.state.stance), env.goal
        plan = planner.plan(start, goal, "steps").unwrap()
        taken = plan.actions[0][1]
        env.graph.occupy([taken])
        other = planner.plan(start, goal, "steps").plan
        env.graph.vacate()
        if other is not None:
            break
    assert other is not None
    tasks = [Task(start, tuple(goal)), Task(start, tuple(goal), (taken,))]
    seen = []
    result = evaluate(
        env,
        ExpertPolicy(),
        tasks,
        execute=lambda world, states: bool(seen.append(states) or len(seen) == 1),
    )
    assert result.success.all()
    assert result.executed.tolist() == [1.0, 0.0]
    assert env.graph.occupied == frozenset()
    assert result.steps.tolist() == [
        len(plan.steps),
        len(other.steps),
    ]
    point = env.graph.grasp_map.index(taken)
    assert all(point not in state.stance for state in seen[1])


def test_bootstrap_interval_of_a_mean():
    """Against the normal approximation."""
    values = np.random.default_rng(0).normal(5.0, 2.0, 400)
    low, high = bootstrap(values)
    assert low == pytest.approx(values.mean() - 1.96 * 0.1, abs=0.05)
    assert high == pytest.approx(values.mean() + 0.196, abs=0.05)


def test_the_shipped_checkpoint_acts_on_a_map_it_never_saw(env):
    policy = load_policy("pretrained", env)
    assert policy.config["network"] == "pointer"
    assert policy.config["command"].startswith("mlivr-gym train")
    assert evaluate(env, policy, 10, max_steps=30).success_rate >= 0.9
    assert evaluate(env, beam_policy(policy), 10).success.all()


def test_data_set_holds_optimal_masked_walks_and_rebuilds_its_environment(tmp_path, monkeypatch):
    minari = pytest.importorskip("minari", reason="needs the extra [data]")
    pytest.importorskip("jax", reason="needs the extra [data]")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    from mlivr_gym.agents.dataset import write_dataset

    (tmp_path / "map.json").write_text(json.dumps(LADDER))
    arguments = {"map": str(tmp_path / "map.json"), "collisions": False}
    write_dataset("mlivr/jem/test-v0", 2, seed=3, env_arguments=arguments)
    dataset = minari.load_dataset("mlivr/jem/test-v0")
    rebuilt = dataset.recover_environment()
    planner = Planner(rebuilt.unwrapped.graph)
    for episode in dataset.iterate_episodes():
        observation, info = rebuilt.reset(seed=3 + int(episode.id))
        plan = planner.plan(info["stance"], rebuilt.unwrapped.goal, "steps").unwrap()
        assert len(episode.actions) == len(plan.steps) == -episode.rewards.sum()
        assert episode.terminations[-1]
        for k, action in enumerate(episode.actions):
            for name, rows in episode.observations.items():
                np.testing.assert_array_equal(rows[k], observation[name])
            assert episode.observations["action_mask"][k][action]
            observation, *_ = rebuilt.step(action)
    with pytest.raises(SettingError, match="already"):
        write_dataset("mlivr/jem/test-v0", 1)


def test_commands_train_and_evaluate(capsys, tmp_path):
    (tmp_path / "map.json").write_text(json.dumps(LADDER))
    assert GraspMap.load(tmp_path / "map.json")
    hyper = {"bc": {"imitation": SHORT}, "networks": {"pointer": {"width": 16, "summary": 8}}}
    (tmp_path / "hyper.json").write_text(json.dumps(hyper))
    common = ["--map", str(tmp_path / "map.json"), "--no-collisions"]
    out = tmp_path / "policy"
    arguments = [
        "--method",
        "bc",
        "--hyperparameters",
        str(tmp_path / "hyper.json"),
        "--out",
        str(out),
    ]
    assert main(["train", *common, *arguments]) == 0
    assert out.with_suffix(".pt").exists()
    assert out.with_suffix(".json").exists()
    for policy in (str(out), "expert", "mcts", "astar"):
        assert main(["evaluate", *common, "--policy", policy, "--episodes", "2"]) == 0
    assert "2 of 2 episodes" in capsys.readouterr().out
    assert main(["evaluate", *common, "--policy", "magic"]) == 2
    assert "policy is 'magic'" in capsys.readouterr().err


def test_ctrl_c_ends_the_command_train_with_a_checkpoint_and_130(capsys, tmp_path, monkeypatch):
    (tmp_path / "map.json").write_text(json.dumps(LADDER))
    hyper = {"bc": {"imitation": SHORT}, "networks": {"pointer": {"width": 16, "summary": 8}}}
    (tmp_path / "hyper.json").write_text(json.dumps(hyper))

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("mlivr_gym.cli.agents.bar", lambda _: interrupt)
    code = main(
        ["train", "--map", str(tmp_path / "map.json"), "--no-collisions", "--method", "bc",
         "--hyperparameters", str(tmp_path / "hyper.json"), "--out", str(tmp_path / "policy")]
    )  # fmt: skip
    told = capsys.readouterr().err
    assert code == 130
    assert told.startswith("mlivr-gym: training interrupted")
    assert told.count("\n") == 1
    assert (tmp_path / "policy.pt").exists()
    assert (tmp_path / "policy.json").exists()
