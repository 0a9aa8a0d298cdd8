"""Stance graphs: steps, refusals, and what a caller may give for a state or a stance."""

import json
from dataclasses import replace

import numpy as np
import pytest
from map_data import POINT
from paper import NO_COLLISIONS

from mlivr_gym import Box, GraspMap, Settings, State, jem_map, robot_spec, stance_graph
from mlivr_gym.errors import MapError, RobotError, SettingError, StanceError
from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state


def steps_of(graph, state):
    found = graph.successors(state)
    return {
        (int(limb), int(point)): tuple(branch_sets.tolist())
        for limb, point, branch_sets in zip(found.limb, found.point, found.branch_sets, strict=True)
    }


def state_of(graph, s):
    return State(tuple(graph.points[s].tolist()), tuple(graph.branch_sets[s].tolist()))


def test_without_checks_every_pair_of_stances_that_share_a_point_is_a_step(small_map):
    graph = stance_graph(small_map, settings=Settings(collisions=False, transitions=False))
    stances = {tuple(p) for p in graph.points.tolist()}
    for s in range(0, len(graph), 37):
        a, b = graph.points[s].tolist()
        expected = {(1, d) for c, d in stances if c == a and d != b} | {
            (0, c) for c, d in stances if d == b and c != a
        }
        assert steps_of(graph, state_of(graph, s)).keys() == expected


def test_thresholds_hold_for_every_stance(small_map, small_graph):
    graph, without = small_graph, Settings(manipulability=False, collisions=False)
    kinematic_graph = stance_graph(small_map, settings=without)
    assert (graph.w_m >= 0.1).all()
    assert (graph.w_b >= 0.001).all()
    kept = (kinematic_graph.w_m >= 0.1).all(axis=1) & (kinematic_graph.w_b >= 0.001)
    assert {tuple(p) for p in graph.points.tolist()} <= {
        tuple(p) for p in kinematic_graph.points[kept].tolist()
    }


def test_occupied_points_are_not_grasped(small_graph):
    """And steps to all others are left as they are."""
    graph, taken = small_graph, [3, 8, 20]
    states = [state_of(graph, s) for s in range(0, len(graph), 61)]
    free, some = [steps_of(graph, state) for state in states], 0
    graph.occupy(taken)
    for state, steps in zip(states, free, strict=True):
        if graph.occupied.intersection(state.stance):
            with pytest.raises(StanceError, match="occupied"):
                graph.state(state.stance)
            continue
        left = {step: kept for step, kept in steps.items() if step[1] not in taken}
        assert steps_of(graph, state) == left
        some += len(left) < len(steps)
    graph.vacate()
    assert some
    assert [steps_of(graph, state) for state in states] == free


@pytest.mark.parametrize("name", ["likely_base", "nodes", "postures"])
def test_what_is_told_of_a_stance_does_not_depend_on_those_asked_with_it(small_graph, name):
    graph = small_graph

    def told(stances):
        found = getattr(graph, name)(stances)
        return [found] if name == "likely_base" else [*vars(found).values()]

    stances = np.concatenate([graph.points[::17].astype(np.int64), [[0, 1], [2, 30]]])
    together = told(stances)
    for k in range(0, len(stances), 5):
        for alone, among in zip(told(stances[k : k + 1]), together, strict=True):
            np.testing.assert_array_equal(alone, among[k : k + 1])


def test_stance_faults_are_named(graph):
    for stance, words in (
        (("D1a:4",), "must name 2 points"),
        ("D1a:4", "stance is 'D1a:4'; it must be a list"),
        (("D1a:4", "D1a:4"), "0.000 m apart"),
        (("D1b:4", "D2a:4"), "apart; two grippers need 0.1 m"),
        (("D1a:4", "D6b:2"), "spans 2.4 m"),
        (("D1a:4", "Q"), "'Q'"),
        (("D1a:4", "D2b:4"), "limb manipulability 0.0331 of limb 0 is below"),
    ):
        with pytest.raises(StanceError, match=words):
            graph.state(stance)


def test_max_step_bounds_every_step_of_three_limbs(jem):
    graph, rng = stance_graph(jem, "mlivr3", NO_COLLISIONS), np.random.default_rng(0)
    for _ in range(3):
        state = random_state(graph, rng)
        here = graph.posture(state.stance).base_position[0]
        moved = np.linalg.norm(graph.successors(state).base_position - here, axis=1)
        assert moved.max() <= graph.max_displacement


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_a_map_without_two_points_to_hold_at_once_is_refused(robot):
    points = [POINT, POINT | {"id": "Q", "position": [0, 2.5, 0]}]
    words = (
        r"no two of its points are between 0.1 m and 2.4 m apart: the nearest two are 2.5 m apart; "
        "if the map is not in metres, give its unit$"
    )
    with pytest.raises(RobotError, match=words):
        stance_graph(GraspMap.from_dict({"points": points}), robot)
    with pytest.raises(RobotError, match=r"2\.4 m apart$"):
        stance_graph(GraspMap.from_dict({"points": points[:1]}), robot)


def test_a_map_with_too_many_pairs_of_points_is_refused(jem):
    words = (
        r"map 'jem' has 42\d{5} pairs of points within the span of 2.4 m, with about 10\d{9} steps "
        r"between them; at most 10000000 and 4000000000"
    )
    with pytest.raises(MapError, match=words):
        stance_graph(jem_map(spacing=0.02))


def test_stances_that_all_touch_something_are_counted(ladder):
    """The same stances are left without the check of collisions."""
    free = len(stance_graph(ladder, settings=Settings(collisions=False)))
    full = Box.between("full", "obstacle", (-2.0, -2.0, 0.1), (4.0, 2.0, 3.0))
    words = rf"none is left; of those that meet w_m >= 0.1 .* w_m >= 0.03 {free} touch "
    with pytest.raises(RobotError, match=words):
        stance_graph(replace(ladder, boxes=(*ladder.boxes, full)))


def test_points_may_be_held_at_once_from_the_separation_of_grippers_to_the_span():
    """Both ends belong to it, whatever is lost in rounding; checked point by point."""
    dense = jem_map(0.1)
    dense = dense.subset((dense.positions[:, 0] < 3.0) & np.isin(dense.faces, ["deck"]), "dense")
    span = round(float(np.linalg.norm(dense.positions[0] - dense.positions[-1])), 4)
    robot = replace(robot_spec("mlivr2"), span=min(span, 2.4))
    graph = stance_graph(dense, robot, NO_COLLISIONS)
    apart = np.linalg.norm(dense.positions[:, None] - dense.positions[None], axis=-1)
    expected = np.argwhere((apart > 0.1 - 1e-7) & (apart < robot.span + 1e-7))
    np.testing.assert_array_equal(graph.pairs, expected)
    assert (np.abs(apart[tuple(graph.pairs.T)] - 0.1) < 1e-9).sum() > 20
    for point in (0, len(dense) // 2):
        np.testing.assert_array_equal(graph.partners(point), expected[expected[:, 0] == point, 1])


def test_a_graph_of_a_map_in_a_file_or_as_plain_data(ladder, tmp_path):
    path, how = tmp_path / "lab.json", Settings(collisions=False, limb_threshold=0.05)
    path.write_text(json.dumps(ladder.to_dict()))
    expected = stance_graph(ladder, settings=how).points
    for given in (str(path), path, ladder.to_dict()):
        np.testing.assert_array_equal(stance_graph(given, settings=how).points, expected)
    with pytest.raises(MapError, match="cannot read"):
        stance_graph(str(tmp_path / "none.json"))
    with pytest.raises(SettingError, match="settings is 3; it must be a Settings"):
        stance_graph(ladder, settings=3)


NAN, HUGE = float("nan"), 2**70


@pytest.fixture(scope="module", params=["mlivr2", "mlivr3"])
def either(request, small_map):
    return stance_graph(small_map, request.param, NO_COLLISIONS)


@pytest.fixture(scope="module")
def state(either):
    return random_state(either, np.random.default_rng(0))


def first_replaced(values, number):
    return (number, *values[1:])


BAD = [-1, 38, HUGE, NAN]


@pytest.mark.parametrize("number", BAD, ids=str)
def test_points_that_are_none_are_named(either, state, number):
    assert len(either.grasp_map) == 38
    for stance in (first_replaced(state.stance, number), (*state.stance[:-1], number)):
        bad = State(stance, state.branch_sets)
        for ask in (
            lambda bad=bad: either.successors(bad),
            lambda bad=bad: either.configuration(bad),
            lambda bad=bad: either.posture_of(bad),
            lambda bad=bad: either.postures_of([state, bad]),
            lambda bad=bad: either.branch_set_after_grasp(bad, 0),
            lambda stance=stance: either.posture(stance),
            lambda stance=stance: either.step_to(state, stance),
            lambda stance=stance: either.state(stance),
        ):
            with pytest.raises(StanceError, match=r"0 to 37|38 points|stance\[\d\] is .* index"):
                ask()


@pytest.mark.parametrize("number", [-1, 1 << 16, HUGE, NAN], ids=str)
def test_masks_that_are_none_are_named(either, state, number):
    bad = State(state.stance, first_replaced(state.branch_sets, number))
    for ask in (either.successors, either.posture_of, either.configuration):
        with pytest.raises(StanceError, match="whole numbers from 0 to 65535"):
            ask(bad)


def test_rows_of_stances_that_are_none_are_named(either):
    n = either.limbs
    for rows in (
        [[-1] * n], [[38] * n], [[HUGE] * n], np.full((1, n), NAN), np.zeros((1, n)),
        np.arange(n + 1), np.zeros((1, n + 1), dtype=int), [[0] * n, [0]], "ab", 5, None, [],
    ):  # fmt: skip
        with pytest.raises(StanceError, match="point indices from 0 to 37"):
            either.postures(rows)


def test_a_step_to_the_same_stance_is_none(either, state):
    assert either.step_to(state, state.stance) is None


def test_no_stances_have_no_postures_and_no_steps(either, state, small_map):
    """A map with a point for each limb and no more leaves no step."""
    nothing = either.postures(np.zeros((0, either.limbs), dtype=int))
    assert nothing.branch_sets.shape == nothing.w_m.shape == (0, either.limbs)
    alone = small_map.subset(np.isin(np.arange(len(small_map)), state.stance), "alone")
    few = stance_graph(alone, either.robot, NO_COLLISIONS)
    assert len(few.successors(few.state(tuple(either.ids(state.stance)))).limb) == 0


@pytest.mark.parametrize("kind", [np.int8, np.uint64, "id"])
def test_points_are_given_by_id_or_by_whole_numbers_of_any_type(either, state, kind):
    ids, goal = either.grasp_map.ids, either.configuration(state)[0].tolist()
    given = [ids[k] if kind == "id" else kind(k) for k in state.stance]
    assert [either.grasp_map.index(point) for point in given] == list(state.stance)
    assert either.indices(given) == state.stance
    assert either.state(given) == either.state(state.stance)
    found = Planner(either).plan(given, goal, "steps").unwrap()
    assert found.stances[0] == tuple(ids[k] for k in state.stance)
