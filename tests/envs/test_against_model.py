"""Both environments, in step with a slow model that is written from their docstring alone."""

import functools
import pickle

import numpy as np
import pytest
from env_model import EnvModel, Rules, Toll
from gymnasium.wrappers import TimeLimit
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from mlivr_gym import jem_map
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.errors import StanceError
from mlivr_gym.world.boxes import Box

COPIES = 3

BOXES = [
    Box(f"box {k}", "obstacle", centre, (0.1, 0.1, 0.1))
    for k, centre in enumerate([(1.5, -0.5, 0.3), (2.2, 0.6, 0.4), (0.8, 0.0, 0.9)])
]

WORLDS = [
    (Rules("base", 3.0, True, 0.9, 0.3, 5), "NextStep", 0.4),
    (Rules("steps", 0.0, False, 0.99, 0.6, 4), "NextStep", 0.0),
    (Rules(Toll(), -1.0, True, 0.99, 0.25, 6), "Disabled", 0.45),
]
"""Rules, what becomes of copies whose episode has ended, and the mean of `grasp_failure`."""


@functools.cache
def tiny_map():
    jem = jem_map()
    keep = (jem.positions[:, 0] < 3.0) & np.isin(jem.faces, ["deck", "forward"])
    return jem.subset(keep & (np.arange(len(jem)) % 3 == 0), "tiny")


@functools.cache
def made(world):
    """Environments and the graph of the model, pickled, since making them takes longer."""
    rules, mode, failure = WORLDS[world]
    arguments = {"map": tiny_map(), "grasp_failure": failure, **rules._asdict()}
    limit = arguments.pop("limit")
    vector = MlivrVectorEnv(COPIES, limit, mode, **arguments)
    single = MlivrEnv(**arguments)
    return pickle.dumps((vector, single, single.graph, single.failure_probability))


class EnvironmentsAgree(RuleBasedStateMachine):
    """Whatever happens to them, model, single environments and copies go alike."""

    @initialize(world=st.integers(0, len(WORLDS) - 1), seed=st.integers(0, 10**6))
    def make(self, world, seed):
        self.rules, self.mode, _ = WORLDS[world]
        self.vector, _, graph, risk = pickle.loads(made(world))
        self.singles = []
        for _ in range(COPIES):
            single = pickle.loads(made(world))[1]
            self.singles.append(TimeLimit(single, self.rules.limit))
        self.graph = graph
        self.models = [EnvModel(graph, self.rules, risk) for _ in range(COPIES)]
        assert risk.any() == (WORLDS[world][2] > 0.0)
        observations, infos = self.vector.reset(seed=seed)
        for k, (single, model) in enumerate(zip(self.singles, self.models, strict=True)):
            model.reset(seed=seed + k)
            self.compare(k, observations, infos, *single.reset(seed=seed + k))

    def compare(self, k, observations, infos, observation, info):
        """What the copy, the single environment and the model show."""
        model = self.models[k]
        assert self.singles[k].observation_space.contains(observation)
        assert set(infos) == {*info, *(f"_{name}" for name in info)}
        for name, value in observation.items():
            np.testing.assert_array_equal(observations[name][k], value, err_msg=name)
            assert observations[name].dtype == value.dtype
        for name, value in model.observation().items():
            if name == "base_quaternion" and abs(value[0]) < 1e-9:
                value = value * np.sign(value @ observation[name])  # no sign has w >= 0 alone
            np.testing.assert_allclose(observation[name], value, atol=1e-6, err_msg=name)
        for name, value in model.info().items():
            for shown in (info[name], infos[name][k]):
                if name == "stance":
                    assert tuple(shown) == value
                else:
                    np.testing.assert_allclose(shown, value, atol=1e-9, err_msg=name)
        assert set(model.info()) == set(info)
        digits = "".join(f"{branch_set:016b}"[::-1] for branch_set in model.state.branch_sets)
        assert observation["branches"].tolist() == [int(digit) for digit in digits]

    def graphs(self):
        return [self.graph, self.vector.env.graph, *(one.unwrapped.graph for one in self.singles)]

    @rule(
        data=st.data(),
        kinds=st.lists(
            st.sampled_from(["near", "allowed", "any"]), min_size=COPIES, max_size=COPIES
        ),
    )
    def step(self, data, kinds):
        if self.mode == "Disabled" and any(model.over for model in self.models):
            self.restart(None, [model.over for model in self.models])
            return
        actions = [self.action(data, *pair) for pair in zip(self.models, kinds, strict=True)]
        observations, rewards, ended, cut, infos = self.vector.step(np.array(actions))
        for k, (single, model) in enumerate(zip(self.singles, self.models, strict=True)):
            if model.over:
                model.reset()
                self.compare(k, observations, infos, *single.reset())
                assert (rewards[k], ended[k], cut[k]) == (0.0, False, False)
                continue
            expected = model.step(actions[k])
            observation, *done, info = single.step(actions[k])
            self.compare(k, observations, infos, observation, info)
            for shown in (done, (rewards[k], ended[k], cut[k])):
                assert shown[0] == pytest.approx(expected.reward, abs=1e-9)
                assert tuple(shown[1:]) == expected[1:]

    def action(self, data, model, kind):
        """The one that leads nearest to the goal, one that the mask allows, or any."""
        steps = self.graph.successors(model.state)
        if kind == "near" and not model.over and len(steps.limb):
            k = np.linalg.norm(steps.base_position - model.goal, axis=1).argmin()
            return int(steps.limb[k] * model.points + steps.point[k])
        allowed = np.flatnonzero(model.mask()) if kind == "allowed" and not model.over else ()
        if len(allowed):
            return int(data.draw(st.sampled_from(allowed.tolist())))
        return data.draw(st.integers(0, self.graph.limbs * model.points - 1))

    def restart(self, seed, which, start=None, goal=None):
        """Start some copies anew, with a seed or going on with their streams."""
        rows = {"start": start, "goal": goal}
        options = {name: [row] * COPIES for name, row in rows.items() if row is not None}
        observations, infos = self.vector.reset(
            seed=seed, options={"reset_mask": np.array(which), **options}
        )
        options = {name: row for name, row in rows.items() if row is not None}
        for k in np.flatnonzero(which):
            one = None if seed is None else seed + int(k)
            self.models[k].reset(one, start, goal)
            shown = self.singles[k].reset(seed=one, options=options)
            self.compare(k, observations, infos, *shown)

    @rule(
        seed=st.none() | st.integers(0, 10**6),
        which=st.lists(st.booleans(), min_size=COPIES, max_size=COPIES),
        start=st.none() | st.integers(0, 10**6),
        goal=st.booleans(),
    )
    def reset(self, seed, which, start, goal):
        """Anew, from a stance and to a goal that are given or drawn."""
        where = None if start is None else self.graph.points[start % len(self.graph)].tolist()
        away = self.models[0].observation()["base_position"] if goal else None
        low, high = self.graph.grasp_map.cabin
        if away is not None and not ((away >= low) & (away <= high)).all():
            away = None
        if where is not None and (
            self.graph.occupied.intersection(where) or not self.models[0]._leaves(where)
        ):
            with pytest.raises(StanceError):
                self.vector.reset(options={"start": [where] * COPIES})
            with pytest.raises(StanceError):
                self.singles[0].unwrapped.reset(options={"start": where})
            return
        if self.can_go_far(where):
            self.restart(seed, which, where, away)

    def can_go_far(self, where):
        """Whether a goal can be drawn for a start at all."""
        if where is None:
            return True
        model, state = self.models[0], self.graph.state(where)
        base = self.graph.posture(where).base_position[0]
        ends = [model._walk(state, target) for target in self.graph.grasp_map.positions]
        return max(np.linalg.norm(end - base) for end in ends) > self.rules.goal_tolerance

    @precondition(lambda self: len(self.graph.occupied) < 4)
    @rule(point=st.integers(0, 10**6))
    def occupy(self, point):
        for graph in self.graphs():
            graph.occupy([point % len(graph.grasp_map)])

    @precondition(lambda self: self.graph.occupied)
    @rule(every=st.booleans())
    def vacate(self, every):
        for graph in self.graphs():
            graph.vacate(None if every else [min(graph.occupied)])

    @precondition(lambda self: not self.graph.obstacles)
    @rule(box=st.sampled_from(BOXES))
    def put_obstacle(self, box):
        for graph in self.graphs():
            graph.add_obstacles([box])

    @precondition(lambda self: self.graph.obstacles)
    @rule()
    def take_obstacle(self):
        for graph in self.graphs():
            graph.remove_obstacles()

    @rule()
    def pickle(self):
        self.vector = pickle.loads(pickle.dumps(self.vector))
        self.singles = [pickle.loads(pickle.dumps(single)) for single in self.singles]

    @invariant()
    def masks_are_those_of_the_world_as_it_is(self):
        masks = self.vector.action_masks()
        for k, (single, model) in enumerate(zip(self.singles, self.models, strict=True)):
            np.testing.assert_array_equal(masks[k], model.mask())
            np.testing.assert_array_equal(single.unwrapped.action_masks(), model.mask())


def examples(count):
    # To shrink a failure takes minutes: for that, run it with all phases.
    return settings(
        max_examples=count, stateful_step_count=30, deadline=None, phases=[Phase.generate]
    )


@pytest.mark.usefixtures("cache")
class TestEnvironments(EnvironmentsAgree.TestCase):
    settings = examples(3)


@pytest.mark.slow
@pytest.mark.usefixtures("cache")
class TestEnvironmentsLonger(EnvironmentsAgree.TestCase):
    settings = examples(60)
