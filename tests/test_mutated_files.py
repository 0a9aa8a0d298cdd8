"""Whatever is done to a valid file, its loader returns or raises one `MlivrError` of one line."""

import copy
import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mlivr_gym import GraspMap, MlivrError, RobotSpec, robot_spec
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.world.boxes import load_obstacles

JEM = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))
BOXES = [
    {"id": "cargo", "min": [5, 0, 0], "max": [6, 1, 1]},
    {
        "id": "turned",
        "centre": [5, 0, 0],
        "half": [1, 1, 1],
        "rotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    },
]
POINT = {"id": "P", "face": "deck", "position": [1, 0, -1], "normal": [0, 0, 1], "rail": [1, 0, 0]}
FILES = {
    "map": {name: JEM[name] for name in ("name", "cabin", "spacing", "clearance", "scene")}
    | {name: JEM[name][:3] for name in ("racks", "handrails", "segments")}
    | {"points": [POINT], "boxes": BOXES},
    "robot": json.loads(json.dumps(RobotSpec(capsules=RobotSpec().shapes).to_dict())),
    "obstacles": {"boxes": BOXES, "occupied": ["D1a:4", "D2a:3"]},
}
LOADERS = {
    "map": GraspMap.load,
    "robot": lambda path: robot_spec(str(path)),
    "obstacles": load_obstacles,
}

values = st.one_of(
    st.sampled_from([None, True, [], {}, "", "x", "\ud800", "a\0b", "limb0/flange", "body", "-"]),
    st.sampled_from([0, -1, 8, 1_000_000, 2**63, 10**250, 1e-300, 1e5, 1e19, 1e300, np.nan]),
    st.floats(), st.integers(), st.text(max_size=5), st.lists(st.floats(), max_size=4),
)  # fmt: skip


def mutated(draw, data):
    """One to three parts of the data replaced, scaled, left out or doubled."""
    data = copy.deepcopy(data)
    for _ in range(draw(st.integers(1, 3))):
        place, depth = data, draw(st.integers(1, 6))
        while place:
            keys = list(place) if isinstance(place, dict) else range(len(place))
            last = keys[draw(st.integers(0, len(keys) - 1))]
            depth -= 1
            if depth == 0 or not isinstance(place[last], (dict, list)) or not place[last]:
                break
            place = place[last]
        else:
            continue
        how, value = draw(st.integers(0, 4)), place[last]
        if how == 0 and type(value) in (int, float):
            place[last] = value * draw(st.sampled_from([-1, 0, 1e-9, 1e3, 1e9]))
        elif how == 1:
            del place[last]
        elif how == 2 and isinstance(place, list):
            place.append(copy.deepcopy(value))
        elif how == 3 and isinstance(place, dict):
            place[draw(st.text(max_size=3))] = draw(values)
        else:
            place[last] = draw(values)
    return data


def check(load, path, content):
    path.write_bytes(content)
    try:
        load(path)
    except MlivrError as error:
        told = str(error)
        assert path.name in told
        assert told.isprintable()
        assert len(told) < 1500


few = settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def plan(checked_graph):
    plan = Planner(checked_graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps").unwrap()
    return json.loads(json.dumps(plan.to_dict() | {"feasibility_time": 0.0, "search_time": 0.0}))


@pytest.mark.parametrize("kind", FILES)
@given(st.data())
@few
def test_a_mutated_file_is_one_error_at_most(tmp_path, kind, data):
    content = json.dumps(mutated(data.draw, FILES[kind])).encode()
    check(LOADERS[kind], tmp_path / f"{kind}.json", content)


@given(st.data())
@few
def test_a_mutated_plan_is_one_error_at_most(tmp_path, plan, jem, data):
    content = json.dumps(mutated(data.draw, plan)).encode()
    check(lambda path: Plan.load(path, jem), tmp_path / "plan.json", content)


@pytest.mark.parametrize("kind", FILES)
@given(st.data())
@settings(few, max_examples=60)
def test_a_damaged_file_is_one_error_at_most(tmp_path, kind, data):
    """Bytes changed, cut off or put in."""
    whole = json.dumps(FILES[kind]).encode()
    at, length = data.draw(st.integers(0, len(whole))), data.draw(st.integers(0, 9))
    content = whole[:at] + data.draw(st.binary(max_size=9)) + whole[at + length :]
    check(
        LOADERS[kind],
        tmp_path / f"{kind}.json",
        content[: data.draw(st.integers(0, 2 * len(whole)))],
    )
