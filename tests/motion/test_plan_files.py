"""A plan that is loaded can be carried out: nothing in the file reaches a kernel unchecked."""

import copy
import json

import pytest

from mlivr_gym.errors import PlanError
from mlivr_gym.planners import Plan


@pytest.fixture(scope="module")
def data(walk):
    """A plan of several steps, as plain data."""
    return json.loads(json.dumps(walk.to_dict()))


def changed(data, path, value):
    """The data with another value at a path of keys and indices, from a field of any part on."""
    out = copy.deepcopy(data)
    place = next(part for part in out.values() if isinstance(part, dict) and path[0] in part)
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value(place[path[-1]]) if callable(value) else value
    return out


FAULTS = [
    (("branches", 1, 0), 1_000_000, r"^motion\.branches\[1\]\[0\] is 1000000; .* from 0 to 7"),
    (("branches", 1), [1], "branches"),
    (("steps", 0, "limb"), 2, r"steps\[0\].limb is 2; .* from 0 to 1"),
    (("steps", 0, "limb"), 1, "does not lead from"),
    (("steps", 0, "knots", 1, 1, 3), 1e300, r"knots\[1\]\[1\]\[3\] is 1e.300; .* -100 to 100"),
    (("steps", 0, "rests", 0), 1, r"steps\[0\]\.rests must rise from 0 to \d+, the number"),
    (("base_quaternions", 0), [0, 0, 0, 0], r"base_quaternions\[0\] has length 0; it must be 1"),
    (("stances", 0), ["D2a:4"], r"stances\[0\] has 1 entries; it must have 2"),
    (("occupied",), ["no:1"], "unknown graspable point 'no:1'"),
]


@pytest.mark.parametrize(("path", "value", "words"), FAULTS)
def test_a_faulty_plan_is_refused_by_name(jem, data, path, value, words):
    with pytest.raises(PlanError, match=words):
        Plan.from_dict(changed(data, path, value), jem)


def test_a_point_that_the_map_lacks_is_named_though_the_fingerprint_fits(jem, data):
    """The first stance and all that goes with it name another point."""
    limb = data["motion"]["steps"][0]["limb"]
    other = changed(data, ("stances", 0, limb), "Q:1")
    del other["checksum"]
    other["motion"]["steps"][0]["from_point"] = "Q:1"
    assert Plan.from_dict(other).stances[0][limb] == "Q:1"
    with pytest.raises(PlanError, match="unknown graspable point 'Q:1'"):
        Plan.from_dict(other, jem)
