"""Whatever a caller gives for a state, a stance or a configuration: an answer or one error.

Compiled code looks things up by these numbers and does not look whether they are inside.
"""

import numpy as np
import pytest
from paper import NO_COLLISIONS

from mlivr_gym import State, stance_graph
from mlivr_gym.errors import StanceError
from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state

NAN, HUGE = float("nan"), 2**70


@pytest.fixture(scope="module", params=["mlivr2", "mlivr3"])
def graph(request, small_map):
    return stance_graph(small_map, request.param, NO_COLLISIONS)


@pytest.fixture(scope="module")
def state(graph):
    return random_state(graph, np.random.default_rng(0))


def first_replaced(values, number):
    return (number, *values[1:])


BAD = [-1, 38, HUGE, NAN]


@pytest.mark.parametrize("number", BAD, ids=str)
def test_points_that_are_none_are_named(graph, state, number):
    assert len(graph.grasp_map) == 38
    for stance in (first_replaced(state.stance, number), (*state.stance[:-1], number)):
        bad = State(stance, state.branch_sets)
        for ask in (
            lambda bad=bad: graph.successors(bad),
            lambda bad=bad: graph.configuration(bad),
            lambda bad=bad: graph.posture_of(bad),
            lambda bad=bad: graph.postures_of([state, bad]),
            lambda bad=bad: graph.branch_set_after_grasp(bad, 0),
            lambda stance=stance: graph.posture(stance),
            lambda stance=stance: graph.step_to(state, stance),
            lambda stance=stance: graph.state(stance),
        ):
            with pytest.raises(StanceError, match=r"0 to 37|38 points|stance\[\d\] is .* index"):
                ask()


@pytest.mark.parametrize("number", [-1, 1 << 16, HUGE, NAN], ids=str)
def test_masks_that_are_none_are_named(graph, state, number):
    bad = State(state.stance, first_replaced(state.branch_sets, number))
    for ask in (graph.successors, graph.posture_of, graph.configuration):
        with pytest.raises(StanceError, match="whole numbers from 0 to 65535"):
            ask(bad)


def test_rows_of_stances_that_are_none_are_named(graph):
    n = graph.limbs
    for rows in (
        [[-1] * n], [[38] * n], [[HUGE] * n], np.full((1, n), NAN), np.zeros((1, n)),
        np.arange(n + 1), np.zeros((1, n + 1), dtype=int), [[0] * n, [0]], "ab", 5, None, [],
    ):  # fmt: skip
        with pytest.raises(StanceError, match="point indices from 0 to 37"):
            graph.postures(rows)


def test_a_step_to_the_same_stance_is_none(graph, state):
    assert graph.step_to(state, state.stance) is None


def test_no_stances_have_no_postures_and_no_steps(graph, state, small_map):
    """A map with a point for each limb and no more leaves no step."""
    nothing = graph.postures(np.zeros((0, graph.limbs), dtype=int))
    assert nothing.branch_sets.shape == nothing.w_m.shape == (0, graph.limbs)
    alone = small_map.subset(np.isin(np.arange(len(small_map)), state.stance), "alone")
    few = stance_graph(alone, graph.robot, NO_COLLISIONS)
    assert len(few.successors(few.state(tuple(graph.ids(state.stance)))).limb) == 0


@pytest.mark.parametrize("kind", [np.int8, np.uint64, "id"])
def test_points_are_given_by_id_or_by_whole_numbers_of_any_type(graph, state, kind):
    ids, goal = graph.grasp_map.ids, graph.configuration(state)[0].tolist()
    given = [ids[k] if kind == "id" else kind(k) for k in state.stance]
    assert [graph.grasp_map.index(point) for point in given] == list(state.stance)
    assert graph.indices(given) == state.stance
    assert graph.state(given) == graph.state(state.stance)
    found = Planner(graph).plan(given, goal, "steps").unwrap()
    assert found.stances[0] == tuple(ids[k] for k in state.stance)
