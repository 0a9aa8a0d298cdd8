"""Colours of points, compared with the graph that they tell of."""

import pytest

from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.viewer import marks


@pytest.fixture
def state(checked_graph):
    yield checked_graph.state(("D2a:4", "D2b:4"))
    checked_graph.vacate()


def test_reach_is_what_the_successors_are(checked_graph, state):
    found, steps = marks.reach_marks(checked_graph, state), checked_graph.successors(state)
    for limb in range(2):
        to, others = (set(steps.point[steps.limb == i].tolist()) for i in (limb, 1 - limb))
        for point in range(len(checked_graph.grasp_map)):
            alone = point in to and point not in others
            assert (found.colours[point] == LIMB_COLOURS[limb]) == alone
        assert (LIMB_COLOURS[limb], f"limb {limb}: {len(to)} points") in found.legend
    assert set(found.points) == set(steps.point.tolist())


def test_reasons_agree_with_the_graph(checked_graph, state):
    """Every point has a known reason or none, and none exactly where a step leads."""
    checked_graph.occupy(["D3b:7"])
    steps = checked_graph.successors(state)
    for limb in range(2):
        to = set(steps.point[steps.limb == limb].tolist())
        for point in range(len(checked_graph.grasp_map)):
            why = marks.why_not(checked_graph, state, limb, point, steps)
            assert (why == "") == (point in to)
            assert why == "" or marks.reason_of(why)
            after = (*state.stance[:limb], point, *state.stance[limb + 1 :])
            if why == marks.NO_STEP:
                assert checked_graph.step_to(state, after) is None
    why = marks.why_not(checked_graph, state, 0, checked_graph.grasp_map.index("D3b:7"), steps)
    assert marks.reason_of(why) == "is occupied"


def test_a_legend_counts_every_point_once(checked_graph, state):
    found = marks.blocked_marks(checked_graph, state, 1)
    counts = [int(words.rsplit(": ", 1)[1]) for _, words in found.legend]
    assert sum(counts) == len(checked_graph.grasp_map)


def test_states_follow_a_plan(checked_graph, walk):
    states = marks.states_of(checked_graph, walk)
    assert [checked_graph.ids(state.stance) for state in states] == list(walk.stances)
    checked_graph.occupy([walk.steps[1].to_point])
    after = marks.states_of(checked_graph, walk)
    checked_graph.vacate()
    assert [state is None for state in after] == [False, False, True, True, True]
