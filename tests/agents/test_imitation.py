"""Imitation of the planner: its loss, its labels, whose walks it sees, and that it learns."""

import numpy as np
import pytest
import torch

from mlivr_gym.agents import evaluate
from mlivr_gym.agents.features import env_features
from mlivr_gym.agents.hyperparameters import ImitationHyperparameters
from mlivr_gym.agents.imitation import Imitation, optimal_set_loss
from mlivr_gym.agents.learned import LearnedPolicy
from mlivr_gym.agents.networks import logits_and_value, make_actor_critic
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.task import Task
from mlivr_gym.errors import StanceError
from mlivr_gym.planners import Planner
from mlivr_gym.transitions.state import State


def test_loss_on_sets_against_brute_force():
    rng = np.random.default_rng(0)
    logits = rng.normal(size=(5, 7))
    valid = rng.random((5, 7)) < 0.7
    valid[:, 0] = True
    optimal = valid & (rng.random((5, 7)) < 0.4)
    optimal[:, 0] = True
    expected = 0.0
    for k in range(5):
        weights = [np.exp(logits[k, a]) if valid[k, a] else 0.0 for a in range(7)]
        expected -= np.log(sum(weights[a] for a in range(7) if optimal[k, a]) / sum(weights)) / 5
    loss = optimal_set_loss(*map(torch.as_tensor, (logits, valid, optimal)))
    assert loss.item() == pytest.approx(expected, abs=1e-12)


def test_labels_are_the_steps_of_optimal_plans(env, short):
    """Costs are those of the planner's plans, and optimal actions those of its cost-to-go."""
    imitation = Imitation(
        env, make_actor_critic(env, "mlp", {}), True, ImitationHyperparameters(**short), 0
    )
    samples, _ = imitation.gather(np.ones(len(env.graph.grasp_map), dtype=bool), by_expert=True)
    planner, tables = Planner(env.graph), env.table_moves().tables
    m = len(env.graph.grasp_map)
    whole = (samples.branch_sets == tables.branch_sets[samples.stances]).all(axis=1)
    fresh, labels = np.flatnonzero(whole)[:10], []
    assert len(fresh) == 10
    for k in fresh:
        stance, goal = tables.points[samples.stances[k]].tolist(), samples.goals[k]
        plan = planner.plan(stance, goal.tolist(), "steps").unwrap()
        assert samples.cost[k] == len(plan.steps)
    for k in range(len(samples.cost)):
        stance = tuple(tables.points[samples.stances[k]].tolist())
        state = State(stance, tuple(samples.branch_sets[k].tolist()))
        steps = env.graph.successors(state)
        costs = planner.cost_to_go(samples.goals[k].tolist(), "steps").action_values(state, steps)
        assert samples.cost[k] == pytest.approx(costs.min())
        expected = set((steps.limb * m + steps.point)[costs < costs.min() + 0.5].tolist())
        optimal = np.flatnonzero(np.unpackbits(samples.optimal[k], count=2 * m))
        assert set(optimal.tolist()) == expected
        labels.append((len(expected), len(costs)))
    assert sum(most > 1 for most, _ in labels) > 10
    assert sum(most < least for most, least in labels) > 10


def test_imitation_lowers_its_loss_arrives_and_teaches_the_value(env):
    """Of states it has not seen: the farther from the goal, the lower the value."""
    torch.manual_seed(0)
    policy = make_actor_critic(env, "pointer", {"width": 32, "summary": 16})
    settings = ImitationHyperparameters(
        rounds=2, layouts=3, goals=8, rollouts=6, updates=80, batch=64, learning_rate=3e-3,
        value_weight=0.5,
    )  # fmt: skip
    losses, imitation = [], Imitation(env, policy, False, settings, 0)
    imitation.run(lambda done, total, figures: losses.append(figures["loss"]))
    assert len(losses) == 160
    assert np.mean(losses[-20:]) < 0.75 * np.mean(losses[:20])
    result = evaluate(env, LearnedPolicy(policy, "pointer"), 20, seed=100, max_steps=30)
    assert result.success_rate >= 0.8
    samples, _ = imitation.gather(np.ones(len(env.graph.grasp_map), dtype=bool), by_expert=True)
    with torch.no_grad():
        value = logits_and_value(policy, imitation.observe(samples)[0])[1].numpy()
    assert np.corrcoef(value, -samples.cost)[0, 1] > 0.5


def test_samples_of_a_layout_are_seen_as_the_environment_shows_them(env, short):
    """With points taken away: what the policy learns from is what it will see."""
    policy = make_actor_critic(env, "pointer", {"width": 16, "summary": 8})
    imitation = Imitation(env, policy, False, ImitationHyperparameters(**short), 5)
    free = np.ones(len(env.graph.grasp_map), dtype=bool)
    free[[3, 8, 21]] = False
    samples, _ = imitation.gather(free, by_expert=True)
    seen = imitation.observe(samples)[0]
    world = MlivrEnv(map=env.graph.grasp_map, collisions=False)
    world.graph.occupy([3, 8, 21])
    points = env.table_moves().tables.points
    assert len(samples.stances) > 20
    for k in range(0, len(samples.stances), 3):
        stance = points[samples.stances[k]].tolist()
        world.reset(options={"start": stance, "goal": samples.goals[k]})
        world._enter_state(world.state._replace(branch_sets=tuple(samples.branch_sets[k].tolist())))
        for name, rows in env_features(world).items():
            np.testing.assert_allclose(seen[name][k].numpy(), rows[0], atol=1e-5, err_msg=name)


@pytest.mark.parametrize("dagger", [True, False])
def test_dagger_lets_the_policy_walk_after_the_first_round(env, dagger, monkeypatch, short):
    settings = ImitationHyperparameters(**(short | {"rounds": 3, "updates": 1, "dagger": dagger}))
    imitation = Imitation(env, make_actor_critic(env, "mlp", {}), True, settings, 0)
    walks, rounds = [], []
    chosen, learn = imitation._policy_actions, imitation._learn
    monkeypatch.setattr(
        imitation, "_policy_actions", lambda samples: walks.append(len(rounds)) or chosen(samples)
    )
    monkeypatch.setattr(imitation, "_learn", lambda *given: rounds.append(learn(*given)))
    imitation.run()
    assert set(walks) == ({1, 2} if dagger else set())


class OneGoal:
    """A user's generator with a single goal."""

    def __init__(self, goal):
        self.goal = goal

    def draw(self, graph, rng, tolerance, start=None):
        return Task(graph.state((0, 1)) if start is None else start, self.goal)


def test_goals_are_drawn_by_the_tasks_of_the_environment(env, small_map, short):
    """All samples have the one goal, in all rounds; nothing is learned if it is held out."""
    goal = env.graph.base_position[0]
    own = MlivrEnv(map=small_map, collisions=False, tasks=OneGoal(goal))
    given = ImitationHyperparameters(**(short | {"updates": 1}))
    network = make_actor_critic(own, "mlp", {})
    imitation = Imitation(own, network, True, given, 0)
    imitation.run()
    goals = imitation.data[0].goals
    assert len(goals) > 10
    assert (goals == goal).all()
    with pytest.raises(StanceError, match="imitation has no state to learn from"):
        Imitation(own, network, True, given, 0, goal[None]).run()


@pytest.mark.parametrize("discount", [0.9, 1.0])
def test_the_value_learns_the_discounted_return(env, short, discount):
    """Of a policy with value 0, the error is the mean square of sums of discounted rewards."""
    given = ImitationHyperparameters(
        **(short | {"rounds": 1, "updates": 1, "batch": 4096, "discount": discount})
    )
    network = make_actor_critic(env, "mlp", {})
    torch.nn.init.zeros_(network.value_net.weight)
    torch.nn.init.zeros_(network.value_net.bias)
    imitation, found = Imitation(env, network, True, given, 0), []
    imitation.run(lambda done, total, figures: found.append(figures["value_error"]))
    returns = {n: -sum(discount**k for k in range(n)) for n in range(1, 30)}
    squares = [returns[int(n)] ** 2 for n in imitation.data[0].cost]
    assert found[0] == pytest.approx(np.mean(squares), rel=0.1)
