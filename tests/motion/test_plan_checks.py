"""A plan file in which anything was altered is refused, and every plan that is made loads."""

import copy
import json
import re
from collections import defaultdict

import numpy as np
import pytest
from plans import altered

from mlivr_gym import Settings, stance_graph
from mlivr_gym.errors import PlanError
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.world.boxes import Box

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)

ASKED = (
    "query.goal",  # as far as it is still reached
    "query.goal_tolerance",
    "world.robot",  # what was asked for: another robot
    "world.settings",  # and other rules, by which the motion is possible, too
    "world.obstacles",
)
"""Fields that no other field tells: an altered one is noticed by the checksum alone, unless what
follows from it, or is possible with it, is not what the plan tells."""

SPENT = ("expanded", "generated", "backward", "bound", "feasibility_time", "search_time")
"""Statistics that only the search knew."""

TOLD = (*ASKED, *(f"statistics.{name}" for name in SPENT))

EACH = 3
"""Entries of each array that are altered."""


def as_data(plan):
    return json.loads(json.dumps(plan.to_dict()))


def unsigned(data):
    return {name: value for name, value in data.items() if name != "checksum"}


@pytest.fixture(scope="module")
def walk(checked_graph):
    """A plan of several steps with a price."""
    found = Planner(checked_graph).plan(START, GOAL, "weighted", regrasp_price=0.1).unwrap()
    assert len(found.steps) >= 4
    return as_data(found)


@pytest.fixture(scope="module")
def three(jem):
    return stance_graph(jem, "mlivr3")


@pytest.fixture(scope="module")
def among_obstacles(three):
    """A plan of three limbs in a world with a box and points that are taken."""
    graph, rng = three, np.random.default_rng(3)
    start = ("O3b:2", "O3b:7", "O4a:4")
    goal = graph.posture(graph.indices(("O3b:2", "O3b:1", "O4a:4"))).base_position[0]
    free = [p for p in range(len(graph.grasp_map)) if p not in graph.indices(start)]
    graph.add_obstacles([Box("crate", "obstacle", (8.0, 0.0, 0.0), (0.1, 0.1, 0.1))])
    graph.occupy(rng.choice(free, 5, replace=False).tolist())
    try:
        found = Planner(graph).plan(start, goal, "steps", goal_tolerance=0.05).unwrap()
    finally:
        graph.remove_obstacles()
        graph.vacate()
    return as_data(found)


def leaves(value, path=()):
    """Path and value of each number in plain data."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(inner, (*path, key))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, value


def field_of(path):
    return ".".join(key for key in path if isinstance(key, str))


def some_leaves(data, rng):
    """A few of the entries of each array, and every other number."""
    fields = defaultdict(list)
    for path, value in leaves(data):
        if path[0] not in ("format", "rules"):
            fields[field_of(path)].append((path, value))
    for entries in fields.values():
        for k in rng.permutation(len(entries))[:EACH]:
            yield entries[k]


def numbers_in(text):
    return [float(digits) for digits in re.findall(r"-?\d+\.?\d*(?:e[-+]?\d+)?", text)]


WITHOUT_TRUTH = ("motion.steps.limb", "motion.steps.leader", "motion.steps.rests")
"""Fields of which an error does not tell what would be right."""


@pytest.mark.parametrize("name", ["walk", "among_obstacles"])
def test_every_altered_number_is_refused(jem, request, name):
    """By the field, the value told and the value that was there; some by the checksum alone."""
    data, rng = request.getfixturevalue(name), np.random.default_rng(7)
    by_checksum = set()
    for path, value in some_leaves(data, rng):
        other = value + 1 if isinstance(value, int) else value + rng.choice([-1, 1]) * 1e-3
        other = abs(other) if path[-1] in SPENT else other
        other = value + 1e-3 if path[-1] == "bound" else other  # none is less than 1
        changed, field = altered(data, path, other), field_of(path)
        try:
            Plan.from_dict(unsigned(changed), jem)
        except PlanError as error:
            if field.startswith("world"):
                continue  # what follows from it is named
            message = str(error)
            assert str(path[-1] if isinstance(path[-1], str) else field.split(".")[-1]) in message
            shown = numbers_in(message)
            if field == "motion.base_quaternions":
                continue  # of a row without length 1
            if field == "motion.steps.knots" and "off their points" in message:
                continue  # by so much that a gripper slips
            assert min(abs(n - other) for n in shown) < 1e-12, message
            # Of these another follows.
            if field not in ("query.regrasp_price", *WITHOUT_TRUTH):
                assert min(abs(n - value) for n in shown) < 1e-6, message
        else:
            assert field.startswith(TOLD), field
            differ = r"^checksum is '\w{64}', but the other fields give '\w{64}'"
            with pytest.raises(PlanError, match=differ):
                Plan.from_dict(changed, jem)
            by_checksum.add(field)
    assert {f"statistics.{name}" for name in SPENT if data["statistics"][name] is not None} == {
        field for field in by_checksum if field.startswith("statistics")
    }


def test_a_plan_without_a_checksum_is_worked_out_all_the_same(jem, walk):
    assert Plan.from_dict(unsigned(walk), jem).to_dict() == Plan.from_dict(walk).to_dict()


def test_an_altered_file_is_refused_without_its_map(walk):
    """As far as numbers follow without it, else by the checksum."""
    far = altered(walk, ("query", "goal", 0), 5.0)
    with pytest.raises(PlanError, match=r"query\.goal is \[5\.0, .* within 0\.2 m; .* is \d"):
        Plan.from_dict(far)
    length = walk["motion"]["steps"][1]["displacement"]
    moved = altered(walk, ("motion", "steps", 1, "displacement"), length + 0.25)
    told = rf"steps\[1\]\.displacement is {length + 0.25!r}; recomputed, it is {length!r}"
    with pytest.raises(PlanError, match=told):
        Plan.from_dict(moved)
    with pytest.raises(PlanError, match="checksum is"):
        Plan.from_dict(altered(walk, ("motion", "w_m", 0, 0), 0.5))


def test_steps_that_are_left_out_or_repeated_are_refused(jem, walk):
    arrays = [name for name, value in walk["motion"].items() if name != "steps"]
    count = len(walk["motion"]["steps"])
    for k in range(count):
        for chosen in ([*range(k), *range(k + 1, count)], [*range(k + 1), *range(k, count)]):
            data = copy.deepcopy(unsigned(walk))
            motion = data["motion"]
            motion["steps"] = [motion["steps"][step] for step in chosen]
            with pytest.raises(PlanError, match=r"motion\.steps has \d+ entries; it must have"):
                Plan.from_dict(data, jem)
            rows = [*chosen, count]
            motion |= {name: [motion[name][row] for row in rows] for name in arrays}
            with pytest.raises(
                PlanError, match=r"steps\[\d\] does not lead from .*: limb \d moves|cost"
            ):
                Plan.from_dict(data, jem)
    data = copy.deepcopy(unsigned(walk))
    data["motion"] |= {name: walk["motion"][name][:-1] for name in (*arrays, "steps")}
    price = count * 0.1 - 0.1 + sum(s["displacement"] for s in walk["motion"]["steps"][:-1])
    with pytest.raises(
        PlanError, match=rf"statistics\.cost is .* recomputed, it is {str(price)[:8]}"
    ):
        Plan.from_dict(data, jem)


def test_a_plan_that_its_world_forbids_is_refused(jem, walk):
    """Though all its numbers follow: a box in the way, a point taken, more clearance or floor."""
    data, middle = unsigned(walk), walk["motion"]["base_positions"][1]
    low, high = (np.array(middle) - 0.2).tolist(), (np.array(middle) + 0.2).tolist()
    box = Box.between("crate", "obstacle", low, high).to_dict()
    with pytest.raises(PlanError, match=r"^motion\."):
        Plan.from_dict(altered(data, ("world", "obstacles"), [box]), jem)
    point = walk["motion"]["stances"][2][0]
    with pytest.raises(PlanError, match=r"motion\.branches\[\d\]\[0\] is \d; .* is one of \[\]"):
        Plan.from_dict(altered(data, ("world", "occupied"), [point]), jem)
    for name, value, told in (
        ("clearance", 0.15, r"^motion\."),
        ("limb_threshold", 0.5, r"^motion\."),
        ("path_floor", 0.3, r"^motion\."),
        ("path_floor", 0.09, r"^motion\."),
    ):
        with pytest.raises(PlanError, match=told):
            Plan.from_dict(altered(data, ("world", "settings", name), value), jem)


@pytest.mark.parametrize(
    "settings",
    [
        Settings(collisions=False),
        Settings(manipulability=False, transitions=False, collisions=False),
        Settings(manipulability=False),
    ],
)
def test_plans_of_other_settings_load(small_map, settings):
    """Also where limbs are all but singular."""
    graph = stance_graph(small_map, settings=settings)
    planner, rng, loaded = Planner(graph), np.random.default_rng(0), 0
    for row in rng.choice(len(graph), 12).tolist():
        goal = graph.base_position[int(rng.integers(len(graph)))]
        found = planner.plan(graph.points[row].tolist(), goal, "base").plan
        if found is not None:
            assert Plan.from_dict(as_data(found), small_map).to_dict() == found.to_dict()
            loaded += 1
    assert loaded > 2


def test_plans_from_a_pose_and_refined_plans_load(jem, checked_graph):
    """Their base poses are not those of the stances' postures."""
    graph, planner, goal = checked_graph, Planner(checked_graph), (4.2, 0.0, 0.42)
    position, quaternion, _ = graph.configuration(graph.state(START))
    pose = (*(position + np.array([0.05, 0.03, 0.04])).tolist(), *quaternion.tolist())
    from_pose = planner.plan(START, goal, "steps", start_pose=pose).unwrap()
    joints = from_pose.motion.joint_positions[0]
    from_joints = planner.plan(START, goal, "steps", start_pose=pose, start_joints=joints).unwrap()
    shorter = planner.refined(from_pose)
    assert shorter.base_translation < from_pose.base_translation
    for found in (from_pose, from_joints, shorter):
        assert Plan.from_dict(as_data(found), jem).to_dict() == found.to_dict()
    data, place = as_data(shorter), shorter.motion.base_positions[1]
    moved = altered(data, ("motion", "base_positions", 1, 2), place[2] + 0.01)
    told = (
        rf"base_positions\[1\]\[2\] is {str(place[2] + 0.01)[:8]}\d*; .* it is {str(place[2])[:8]}"
    )
    with pytest.raises(PlanError, match=told):
        Plan.from_dict(moved, jem)


def test_grippers_that_slip_and_joints_outside_their_windows_are_told(jem, among_obstacles):
    """At a knot, on a line that takes the place of many, and by a whole turn."""
    data, sent = unsigned(among_obstacles), among_obstacles["motion"]["steps"]
    number = max(range(len(sent)), key=lambda k: len(sent[k]["knots"]))
    step = sent[number]
    follower = next(limb for limb in range(3) if limb not in (step["limb"], step["leader"]))
    first, last = step["rests"][1:3]
    k = (first + last) // 2

    def refused(changes):
        with pytest.raises(PlanError) as error:
            Plan.from_dict(altered(data, ("motion", "steps", number), step | changes), jem)
        return str(error.value)

    bent = altered(step, ("knots", k, follower, 1), step["knots"][k][follower][1] + 1e-3)
    assert re.search(rf"steps\[{number}\]\.knots: at knot {k} .* m off their points", refused(bent))
    left_out = last - first - 1
    few = {
        "knots": step["knots"][: first + 1] + step["knots"][last:],
        "rests": step["rests"][:2] + [n - left_out for n in step["rests"][2:]],
    }
    assert re.search(r"knots: after knot \d+ .* off their points; it may be 0.0002 m", refused(few))
    turn = step["knots"][k][step["limb"]][3] + 2.0 * np.pi
    turned = altered(step, ("knots", k, step["limb"], 3), turn)
    named = re.escape(f"steps[{number}].knots[{k}][{step['limb']}][3] is {turn!r}, outside the")
    assert re.search(named, refused(turned))
