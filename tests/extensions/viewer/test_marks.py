"""What is told of points and states, compared with the graph."""

import pytest

from mlivr_gym.extensions.viewer import live_plan as marks


@pytest.fixture
def state(checked_graph):
    yield checked_graph.state(("D2a:4", "D2b:4"))
    checked_graph.vacate()


def test_reasons_agree_with_the_graph(checked_graph, state):
    """Every point has a reason for a limb exactly where no step leads."""
    checked_graph.occupy(["D3b:7"])
    steps = checked_graph.successors(state)
    for point in range(len(checked_graph.grasp_map)):
        for limb, told in enumerate(marks.explanations(checked_graph, state, point)):
            stepped = point in steps.point[steps.limb == limb]
            assert told.startswith(f"limb {limb}: ")
            assert told.endswith("can step to this point") == stepped
            after = (*state.stance[:limb], point, *state.stance[limb + 1 :])
            if told.endswith(marks.NO_STEP):
                assert checked_graph.step_to(state, after) is None
    told = marks.explanations(checked_graph, state, checked_graph.grasp_map.index("D3b:7"))
    assert all("is occupied" in line for line in told)


def test_states_follow_a_plan(checked_graph, walk):
    states = marks.states_of(checked_graph, walk)
    assert [checked_graph.ids(state.stance) for state in states] == list(walk.stances)
    checked_graph.occupy([walk.steps[1].to_point])
    after = marks.states_of(checked_graph, walk)
    checked_graph.vacate()
    assert [state is None for state in after] == [False, False, True, True, True]
