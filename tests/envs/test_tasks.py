"""Start, goal and layout of episodes: anywhere, far, random, of a user's own; fixed by a number."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from state_graph import least_cost, reachable, within

from mlivr_gym.agents import ExpertPolicy
from mlivr_gym.envs import AnywhereTasks, LayoutTasks, MlivrEnv, WalkTasks
from mlivr_gym.envs.layout_tasks import OCCUPIED_SHARES
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.task import Task
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.errors import GoalError, SettingError, StanceError
from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state

pytestmark = pytest.mark.usefixtures("cache")


class Shuttle:
    """A random start, and one fixed goal; keeps what it was asked and what it gave."""

    def __init__(self, goal):
        self.goal, self.given, self.drawn = goal, [], []

    def draw(self, graph, rng, tolerance, start=None):
        self.given.append((tolerance, start))
        state = random_state(graph, rng) if start is None else start
        self.drawn.append(state)
        return Task(state, np.array(self.goal))


@pytest.fixture
def shuttle(small_map):
    return Shuttle(small_map.cabin.mean(axis=0).tolist())


def test_the_vector_environment_takes_start_and_goal_of_each_copy(small_map, shuttle):
    """Also of each that starts anew since its episode has ended."""
    given = {"collisions": False, "tasks": shuttle, "goal_tolerance": 0.15}
    copies = MlivrVectorEnv(5, 1, map=small_map, **given)

    def assert_taken(drawn):
        stances = copies.tables.points[copies.stances].tolist()
        assert [tuple(row) for row in stances] == [state.stance for state in drawn]
        sets = [tuple(row) for row in copies.branch_sets.tolist()]
        assert sets == [state.branch_sets for state in drawn]

    copies.reset(seed=1)
    assert shuttle.given == [(0.15, None)] * 5
    assert_taken(shuttle.drawn)
    np.testing.assert_array_equal(copies.goals, [shuttle.goal] * 5)
    assert len(set(shuttle.drawn)) > 2
    copies.reset(seed=1)
    assert shuttle.drawn[5:] == shuttle.drawn[:5]
    copies.reset()
    assert shuttle.drawn[10:] != shuttle.drawn[:5]
    copies.reset(options={"reset_mask": np.array([False, True, False, True, False])})
    assert len(shuttle.drawn) == 17
    actions = copies.action_masks().argmax(axis=1)
    assert copies.step(actions)[3].all()
    copies.step(actions)
    assert_taken(shuttle.drawn[17:])


def test_what_reset_is_given_is_not_drawn(small_map, shuttle):
    env = MlivrEnv(map=small_map, collisions=False, tasks=shuttle)
    copies = MlivrVectorEnv(2, env=env)
    env.reset(seed=0)
    start, goal = env.state, env.graph.posture(env.state.stance).base_position[0]
    env.reset(seed=1, options={"start": start.stance})
    assert shuttle.given[-1][1] == start
    assert env.state == start
    env.reset(seed=1, options={"goal": goal})
    np.testing.assert_array_equal(env.goal, goal)
    assert env.state == shuttle.drawn[-1]
    copies.reset(seed=1, options={"start": [start.stance] * 2})
    assert [given for _, given in shuttle.given[-2:]] == [start] * 2
    copies.reset(seed=1, options={"goal": [goal] * 2})
    np.testing.assert_array_equal(copies.goals, [goal] * 2)
    count = len(shuttle.drawn)
    env.reset(options={"start": start.stance, "goal": goal})
    copies.reset(options={"start": [start.stance] * 2, "goal": [goal] * 2})
    assert len(shuttle.drawn) == count


def test_faulty_tasks_are_refused(small_map, shuttle):
    """A goal outside the cabin, and a start that is no stance: no environment moves to them."""
    env = MlivrEnv(map=small_map, collisions=False, tasks=shuttle)
    copies = MlivrVectorEnv(2, env=env)
    copies.reset(seed=0)
    before = copies.stances.copy(), copies.goals.copy()
    good, shuttle.goal = shuttle.goal, [0.0, 0.0, 99.0]
    for reset in (env.reset, copies.reset):
        with pytest.raises(GoalError, match="outside the cabin"):
            reset(seed=3)
    shuttle.goal = good
    state = shuttle.drawn[-1]
    for start, error, words in (
        (state._replace(stance=(state.stance[0],) * 2), StanceError, "0.000 m apart"),
        (state._replace(stance=(0, len(small_map) - 1)), StanceError, "spans"),
        (state._replace(branch_sets=(2**70, 1)), StanceError, "whole numbers from 0 to 65535"),
        (state.stance, SettingError, "must be a State"),
    ):
        env.tasks = Mock()
        env.tasks.draw.return_value = Task(start, np.array(good))
        for reset in (env.reset, copies.reset):
            with pytest.raises(error, match=words):
                reset(seed=3)
    env.tasks.draw.return_value = None
    with pytest.raises(SettingError, match="drew None; it must be a Task"):
        env.reset(seed=3)
    np.testing.assert_array_equal(copies.stances, before[0])
    np.testing.assert_array_equal(copies.goals, before[1])


def test_fields_of_generators_are_checked(small_map):
    for make in (lambda: WalkTasks(far="no"), lambda: LayoutTasks(clustered=1)):
        with pytest.raises(SettingError, match="must be true or false"):
            make()
    with pytest.raises(SettingError, match="unknown field 'far'"):
        MlivrEnv(map=small_map, tasks={"kind": "walk", "far": True})


def tasks_of(grasp_map, kind):
    """Return an environment, and a function that draws a goal by a seed."""
    tasks = "random" if kind == "random" else "walk"
    env = MlivrEnv(map=grasp_map, collisions=False, tasks=tasks)
    if kind == "from tables":
        env.table_moves()

    def goal(seed):
        if kind == "one by one":
            return sample_task(env.graph, Stream.of_seed(seed), env.goal_tolerance).goal
        env.reset(seed=seed)
        return env.goal

    return env, goal


@pytest.mark.parametrize("kind", ["one by one", "from tables", "random"])
def test_goals_lie_in_the_cabin_though_stances_lie_outside(small_map, kind):
    """The same points with a cabin that ends in the middle of what the base reaches."""
    wide, goal = tasks_of(small_map, kind)
    cabin = small_map.cabin.copy()
    cabin[1, 0] = np.median(wide.graph.base_position[:, 0])
    assert np.mean([goal(seed)[0] > cabin[1, 0] for seed in range(12)]) > 0.2
    _, goal = tasks_of(replace(small_map, cabin=cabin), kind)
    goals = np.array([goal(seed) for seed in range(12)])
    assert ((cabin[0] <= goals) & (goals <= cabin[1])).all()


def test_a_goal_can_be_reached_from_its_start_but_does_not_lie_there(jem):
    """A search by hand over the steps of the graph, breadth first, finds each goal.

    No step leads from one part of the map to the other.
    """
    x = jem.positions[:, 0]
    parted = jem.subset(((x < 1.8) | (x > 6.4)) & np.isin(jem.faces, ["deck"]), "parted")
    env = MlivrEnv(map=parted, collisions=False, tasks="anywhere")
    graph, (low, high) = env.graph, parted.cabin
    away = []
    for seed in range(12):
        _, info = env.reset(seed=seed)
        away.append(np.linalg.norm(info["base_position"] - env.goal))
        assert ((low <= env.goal) & (env.goal <= high)).all()
        front, seen, reached = [env.state], {env.state}, False
        while front and not reached:
            after = []
            for state in front:
                steps = graph.successors(state)
                there = np.linalg.norm(steps.base_position - env.goal, axis=1)
                reached |= bool((there <= env.goal_tolerance).any())
                after += [
                    one for k in range(len(there)) if (one := steps.after(state, k)) not in seen
                ]
                seen.update(after)
            front = list(dict.fromkeys(after))
        assert reached
    assert min(away) > env.goal_tolerance


def test_four_limbs_get_tasks_that_are_the_same_whenever_they_are_drawn(small_map):
    env = MlivrEnv("mlivr4", small_map, collisions=False, tasks="anywhere")
    env.reset(options={"task": 3})
    start, goal = env.state, env.goal
    env.reset(seed=1)
    env.reset(options={"task": 3})
    assert env.state == start
    np.testing.assert_array_equal(env.goal, goal)
    assert MlivrEnv(map=small_map, tasks=AnywhereTasks().to_dict()).tasks == AnywhereTasks()


@pytest.fixture(scope="module")
def far(small_map):
    return MlivrEnv(map=small_map, collisions=False, tasks="far")


def test_start_and_goal_lie_in_opposite_halves_and_are_joined(far):
    places, planner = far.graph.grasp_map.positions, Planner(far.graph)
    axis = int(np.ptp(places, axis=0).argmax())
    middle = 0.5 * (places[:, axis].min() + places[:, axis].max())
    for seed in range(20):
        _, info = far.reset(seed=seed)
        here = info["base_position"][axis]
        assert (here - middle) * (far.goal[axis] - middle) < 0.0
        assert planner.plan(far.state, far.goal, "steps")


def test_copies_draw_what_single_environments_draw(small_map, far):
    copies = MlivrVectorEnv(6, env=MlivrEnv(map=small_map, collisions=False, tasks="far"))
    for count in (1, 2):  # tasks of each stream
        _, info = copies.reset(seed=40 if count == 1 else None)
        for k in range(6):
            for number in range(count):
                _, alone = far.reset(seed=None if number else 40 + k)
            assert tuple(info["stance"][k]) == tuple(alone["stance"])
            np.testing.assert_array_equal(copies.goals[k], far.goal)


@pytest.mark.parametrize("tasks", ["walk", "far"])
def test_a_fixed_task_is_the_same_whatever_was_drawn_before(small_map, tasks):
    made = [MlivrEnv(map=small_map, collisions=False, tasks=tasks) for _ in range(2)]
    for k, one in enumerate(made):
        one.reset(seed=k)
    seen = []
    for number in (0, 7, 999_999):
        found = [one.reset(options={"task": number})[1]["stance"] for one in made]
        assert found[0] == found[1]
        np.testing.assert_array_equal(made[0].goal, made[1].goal)
        seen.append((found[0], made[0].goal.tolist()))
    assert len({str(one) for one in seen}) == 3
    copies = MlivrVectorEnv(3, env=made[0])
    _, info = copies.reset(seed=3, options={"task": [0, 7, 999_999]})
    for k, (stance, goal) in enumerate(seen):
        assert tuple(info["stance"][k]) == tuple(stance)
        np.testing.assert_array_equal(copies.goals[k], goal)
    one, other = made  # a fixed task takes no number of the stream
    for each in made:
        each.reset(seed=5)
    one.reset(options={"task": 3})
    assert one.reset()[1]["stance"] == other.reset()[1]["stance"]
    np.testing.assert_array_equal(one.goal, other.goal)


@pytest.fixture(scope="module")
def layouts(small_map, cache):
    return MlivrEnv(map=small_map, collisions=False, tasks="random")


def drawn(env):
    return env.graph.occupied, env.state, env.goal.tolist()


def test_a_seed_gives_one_layout_start_and_goal(small_map, layouts):
    other = MlivrEnv(map=small_map, collisions=False, tasks="random")
    other.reset(seed=99)
    seen = set()
    for seed in range(8):
        for one in (layouts, other):
            one.reset(seed=seed)
        assert drawn(layouts) == drawn(other)
        observation, info = layouts.reset(seed=seed)
        taken = np.flatnonzero(observation["occupied"])
        assert set(taken.tolist()) == layouts.graph.occupied
        assert not info["action_mask"].reshape(2, -1)[:, taken].any()
        seen.add(layouts.graph.occupied)
        share = len(layouts.graph.occupied) / len(small_map)
        assert OCCUPIED_SHARES[0] - 0.02 <= share <= OCCUPIED_SHARES[1] + 0.02
    assert len(seen) == 8
    layouts.reset(options={"task": 3})
    other.reset(options={"task": 3})
    assert drawn(layouts) == drawn(other)
    assert layouts.graph.occupied not in seen


def test_the_fewest_steps_are_those_of_networkx_and_the_expert_takes_them(small_map):
    half = small_map.subset(np.arange(len(small_map)) % 2 == 0, "half")
    env = MlivrEnv(map=half, collisions=False, tasks="random")
    for seed in range(2):
        observation, info = env.reset(seed=seed)
        fewest = info["fewest_steps"]
        net = reachable(env.graph, env.state)
        ends = within(net, env.goal, env.goal_tolerance)
        assert fewest == least_cost(net, env.state, ends) > 0
        expert = ExpertPolicy()
        while not info["is_success"]:
            action = expert.act(env, observation, env.action_masks())
            observation, _, _, _, info = env.step(action)
            assert info["fewest_steps"] == fewest
        assert info["steps"] == fewest


def test_a_start_that_is_given_stays_free_and_a_layout_stays_if_nothing_is_drawn(layouts):
    layouts.reset(seed=5)
    state = layouts.state
    for seed in range(5):
        layouts.reset(seed=100 + seed)  # whose layout may have taken these points
        _, info = layouts.reset(seed=seed, options={"start": state.stance})
        assert layouts.state == state
        assert info["fewest_steps"] > 0
    occupied, goal = layouts.graph.occupied, layouts.goal
    layouts.reset(seed=77, options={"start": state.stance, "goal": goal})
    assert layouts.graph.occupied == occupied
    here = layouts.graph.posture_of(state).base_position[0]
    assert layouts.reset(options={"start": state.stance, "goal": here})[1]["fewest_steps"] == 0
    free = {*state.stance, int(layouts.graph.successors(state).point[0])}
    layouts.graph.occupy([p for p in range(len(layouts.graph.grasp_map)) if p not in free])
    _, info = layouts.reset(
        options={"start": state.stance, "goal": layouts.graph.grasp_map.cabin[0]}
    )
    assert info["fewest_steps"] == -1
