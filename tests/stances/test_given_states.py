"""Whatever a caller gives for a state, a stance or a configuration: an answer or one error.

Compiled code looks things up by these numbers and does not look whether they are inside.
"""

from zipfile import ZIP_STORED

import numpy as np
import pytest
from paper import NO_COLLISIONS

from mlivr_gym import State, stance_graph
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.table_build import build_table
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.stances.table_files import TableError

NAN, HUGE = float("nan"), 2**70


@pytest.fixture(scope="module", params=["mlivr2", "mlivr3"])
def graph(request, small_map):
    return stance_graph(small_map, request.param, NO_COLLISIONS)


@pytest.fixture(scope="module")
def state(graph):
    return random_state(graph, np.random.default_rng(0))


def first_replaced(values, number):
    return (number, *values[1:])


BAD = [-1, -40, 38, 43, 2**31, HUGE, -HUGE, -(2**63), NAN, 0.5, float("inf"), "a", None, (1,)]


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


@pytest.mark.parametrize("change", [(), (0,), (0, 1, 2, 3), "01", 7, None], ids=str)
def test_stances_and_masks_of_another_number_of_limbs_are_named(graph, state, change):
    for bad in (State(change, state.branch_sets), State(state.stance, change)):
        for ask in (graph.successors, graph.posture_of, graph.configuration):
            with pytest.raises(StanceError, match=f"must be {graph.limbs} whole numbers"):
                ask(bad)


@pytest.mark.parametrize("number", [-1, 1 << 16, HUGE, NAN, 0.5, "a", None], ids=str)
def test_masks_that_are_none_are_named(graph, state, number):
    bad = State(state.stance, first_replaced(state.branch_sets, number))
    for ask in (graph.successors, graph.posture_of, graph.configuration):
        with pytest.raises(StanceError, match="whole numbers from 0 to 65535"):
            ask(bad)


@pytest.mark.parametrize(
    "pose",
    [(NAN,) * 7, (np.inf, 0, 0, 1, 0, 0, 0), (0, 0, 0), (0,) * 7, (1e300, 0, 0, 1, 0, 0, 0), "x"],
    ids=str,
)
def test_poses_that_are_none_are_named(graph, state, pose):
    for ask in (graph.successors, graph.posture_of, graph.configuration):
        with pytest.raises(SettingError, match="start_pose"):
            ask(State(state.stance, state.branch_sets, pose))


@pytest.mark.parametrize("limb", [-1, 3, HUGE, NAN, "a"], ids=str)
def test_limbs_that_are_none_are_named(graph, state, limb):
    with pytest.raises(StanceError, match=r"limb is .* whole number from 0"):
        graph.branch_set_after_grasp(state, limb)


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


def test_a_cost_to_go_knows_no_stance_that_cannot_be_held(small_graph):
    values = Planner(small_graph).cost_to_go(small_graph.base_position[-1].tolist())
    assert values.value(State((3, 3), (0xFFFF, 0xFFFF))) == np.inf
    stance = tuple(small_graph.points[0].tolist())
    for bad in ((0, 43), (1, -1), (HUGE, 0)):
        with pytest.raises(StanceError, match=r"stance .* whole numbers from 0 to 37"):
            values.value(State(bad, (1, 1)))
    for bad in ((HUGE, 1), (-1, 1), (1,)):
        with pytest.raises(StanceError, match=r"branch sets .* whole numbers from 0 to 65535"):
            values.value(State(stance, bad))


@pytest.mark.parametrize(
    ("part", "value"),
    [
        (0, (NAN, 0, 0)), (0, (1e9, 0, 0)), (0, ()), (1, (0, 0, 0, 0)), (1, (1, 0, 0)),
        (1, (NAN,) * 4), (2, np.full((2, 6), NAN)), (2, np.zeros((1, 6))), (2, np.zeros((2, 5))),
        (2, np.zeros(12)), (2, np.full((2, 6), np.inf)),
    ],
)  # fmt: skip
def test_configurations_that_are_none_are_named(small_graph, part, value):
    parts = [np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros((2, 6))]
    contacts(small_graph.robot, (), tuple(parts), 0.02)
    parts[part] = value
    with pytest.raises(SettingError, match=r"base position|base quaternion|joint angles"):
        contacts(small_graph.robot, (), tuple(parts), 0.02)


@pytest.fixture(scope="module")
def graph_and_tables(small_map, tmp_path_factory):
    """A graph, and the arrays of the file of its steps."""
    full, path = stance_graph(small_map, settings=NO_COLLISIONS), tmp_path_factory.mktemp("steps")
    build_table(full)
    TABLES.write(full, full.graph_table, path / "steps.npz")
    found = dict(TABLES.arrays(full, path / "steps.npz"))
    assert len(TABLES.read(full, path / "steps.npz").nodes.lost)
    return full, found


@pytest.mark.parametrize(
    ("array", "field", "value"),
    [
        ("released", "folds", 8), ("lost_index", None, 1 << 30),
        ("released", "root", 1 << 40), ("released", "root", -1), ("released", "via", 100),
        ("released", "branches", -1), ("mask_index", None, 1 << 30), ("mask", None, -5),
        ("manipulability_index", None, 1 << 20), ("tried", None, 1 << 13),
        ("point_increments", None, 30_000),
    ],
)  # fmt: skip
def test_tables_of_steps_with_other_numbers_are_worked_out_anew(
    graph_and_tables, tmp_path, array, field, value
):
    fresh, path = graph_and_tables[0], tmp_path / "steps.npz"
    found = {name: part.copy() for name, part in graph_and_tables[1].items()}
    found["mask"] = found["mask"].astype(np.int64)
    target = found[array] if field is None else found[array][field]
    target[(-1,) + (0,) * (target.ndim - 1)] = value
    path.write_bytes(TABLES.pack(fresh, found, ZIP_STORED))
    with pytest.raises(TableError, match="is damaged, or not of format"):
        TABLES.read(fresh, path)


def test_no_stances_have_no_postures_and_no_steps(graph, state, small_map):
    """A map with a point for each limb and no more leaves no step."""
    nothing = graph.postures(np.zeros((0, graph.limbs), dtype=int))
    assert nothing.branch_sets.shape == nothing.w_m.shape == (0, graph.limbs)
    alone = small_map.subset(np.isin(np.arange(len(small_map)), state.stance), "alone")
    few = stance_graph(alone, graph.robot, NO_COLLISIONS)
    assert len(few.successors(few.state(tuple(graph.ids(state.stance)))).limb) == 0


@pytest.mark.parametrize("kind", [int, np.int8, np.uint8, np.int32, np.uint64, np.int64, "id"])
def test_points_are_given_by_id_or_by_whole_numbers_of_any_type(graph, state, kind):
    ids, goal = graph.grasp_map.ids, graph.configuration(state)[0].tolist()
    given = [ids[k] if kind == "id" else kind(k) for k in state.stance]
    assert [graph.grasp_map.index(point) for point in given] == list(state.stance)
    assert graph.indices(given) == state.stance
    assert graph.state(given) == graph.state(state.stance)
    found = Planner(graph).plan(given, goal, "steps").unwrap()
    assert found.stances[0] == tuple(ids[k] for k in state.stance)
