"""The published schema of map files, by another library, against what the loader takes."""

import json

import pytest
from fuzz import few, mutated
from hypothesis import given
from hypothesis import strategies as st
from map_data import BOX, POINT, RAIL, SEGMENT

from mlivr_gym import GraspMap, MlivrError
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.world.grasp_map import PLACES, as_map
from mlivr_gym.world.json_schema import map_schema

jsonschema = pytest.importorskip("jsonschema")
SCHEMA = json.loads(asset_path("map.schema.json").read_text(encoding="utf-8"))
MEETS = jsonschema.Draft202012Validator(SCHEMA).is_valid
TURNED = {
    "id": "T", "centre": [5, 0, 0], "half": [1, 1, 1],
    "rotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
}  # fmt: skip
WHOLE = {
    "name": "lab", "sources": ["a survey"], "points": [POINT], "segments": [SEGMENT],
    "spacing": 0.25, "handrails": [RAIL], "clearance": 0.02, "boxes": [BOX, TURNED],
    "cabin": {"min": [-1, -1, -1], "max": [8, 2, 2]},
    "parts": [{"id": "L", "map": {"points": [POINT]}, "translation": [0, 4, 0]}],
}  # fmt: skip


def test_the_published_schema_is_that_of_the_loader():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert json.loads(json.dumps(map_schema())) == SCHEMA


@pytest.mark.parametrize("name", PLACES)
def test_maps_that_ship_meet_it_and_so_do_saved_ones(name, tmp_path):
    jsonschema.validate(json.loads(asset_path(f"{name}.json").read_text(encoding="utf-8")), SCHEMA)
    as_map(name).save(tmp_path / "saved.json")
    jsonschema.validate(json.loads((tmp_path / "saved.json").read_text(encoding="utf-8")), SCHEMA)


def objects(data, path=()):
    """Places of all objects in plain data."""
    if isinstance(data, dict):
        yield path
        for name, inner in data.items():
            yield from objects(inner, (*path, name))
    elif isinstance(data, list):
        for k, inner in enumerate(data):
            yield from objects(inner, (*path, k))


SAVED = json.loads(json.dumps(GraspMap.from_dict(WHOLE).to_dict()))
MESH = {"points": [POINT], "mesh": {"file": "lab.stl", "scale": 0.001, "resolution": 0.1}}
PLACES_OF_FIELDS = [(data, path) for data in (WHOLE, SAVED, MESH) for path in objects(data)]


MILLIMETRES = {
    "unit": "mm", "points": [POINT | {"position": [9500, -400, 1200]}], "spacing": 250,
    "boxes": [{"id": "B", "min": [-2500, 0, 0], "max": [7000, 1, 1]}],
    "parts": [{"id": "L", "map": {"points": [POINT]}, "translation": [0, 4000, 0]}],
}  # fmt: skip


def test_a_map_in_millimetres_meets_it_and_is_in_metres_after_it_was_read():
    assert MEETS(MILLIMETRES)
    assert GraspMap.from_dict(MILLIMETRES).positions[0].tolist() == [9.5, -0.4, 1.2]


@pytest.mark.parametrize(("data", "path"), PLACES_OF_FIELDS)
def test_an_unknown_field_is_refused_by_schema_and_loader(data, path):
    assert MEETS(data)
    wrong = inner = json.loads(json.dumps(data))
    for key in path:
        inner = inner[key]
    inner["colour"] = "red"
    assert not MEETS(wrong)
    with pytest.raises(MlivrError, match="'colour'"):
        GraspMap.from_dict(wrong)


@pytest.mark.parametrize(
    "data", [WHOLE, SAVED, MILLIMETRES], ids=["written", "saved", "millimetres"]
)
@given(st.data())
@few(0.3)
def test_what_the_schema_refuses_the_loader_refuses(data, draw):
    """Not the other way round: a schema cannot say what joins several fields.

    NumPy takes a truth value among numbers for 0 or 1; these are left out.
    """
    changed = json.loads(json.dumps(draw.draw(mutated(data))).replace("true", '"true"'))
    if not MEETS(changed):
        with pytest.raises(MlivrError):
            GraspMap.from_dict(changed)
