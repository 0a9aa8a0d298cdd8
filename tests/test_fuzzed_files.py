"""Whatever is done to a valid file, its loader returns or raises one `MlivrError` of one line.

`MLIVR_GYM_FUZZ=10000` draws more examples.
"""

import json
from pathlib import Path

import pytest
from fuzz import damaged, few, loaded, mutated
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym import GraspMap, RobotSpec, robot_spec
from mlivr_gym.agents.hyperparameters import METHODS, load_hyperparameters
from mlivr_gym.agents.test_set import load_test_set
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.planners import Plan
from mlivr_gym.world.boxes import Box, load_obstacles

JEM = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))
TURN = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
BOXES = [
    {"id": "cargo", "min": [5, 0, 0], "max": [6, 1, 1]},
    {"id": "turned", "centre": [5, 0, 0], "half": [1, 1, 1], "rotation": TURN},
]
POINT = {"id": "P", "face": "deck", "position": [1, 0, -1], "normal": [0, 0, 1], "rail": [1, 0, 0]}
MODULE = (
    {name: JEM[name] for name in ("name", "cabin", "spacing", "clearance", "sources")}
    | {name: JEM[name][:3] for name in ("handrails", "segments")}
    | {"points": [POINT], "boxes": BOXES}
)
TASKS = json.loads(asset_path("test_set.json").read_text(encoding="utf-8"))
FILES = {
    "map": MODULE,
    "saved map": json.loads(json.dumps(GraspMap.from_dict(MODULE | {"spacing": 0.5}).to_dict())),
    "robot": json.loads(json.dumps(RobotSpec(capsules=RobotSpec().mounted[0].capsules).to_dict())),
    "obstacles": {"boxes": BOXES, "occupied": ["D1a:4", "D2a:3"]},
    "training": json.loads(asset_path("training.json").read_text(encoding="utf-8")),
    "tasks": TASKS | {"worlds": [one | {"tasks": one["tasks"][:2]} for one in TASKS["worlds"][:3]]},
}


def same_map(path):
    """A map that loads is the same after it was written and read again."""
    made = GraspMap.load(path)
    again = GraspMap.from_dict(json.loads(json.dumps(made.to_dict())))
    assert (again.fingerprint, again.cabin.tolist()) == (made.fingerprint, made.cabin.tolist())
    return made


def same_robot(path):
    made = robot_spec(str(path))
    assert RobotSpec.from_dict(json.loads(json.dumps(made.to_dict()))) == made
    return made


def same_boxes(path):
    made, _ = load_obstacles(path)
    assert tuple(Box.from_dict(json.loads(json.dumps(box.to_dict()))) for box in made) == made
    return made


LOADERS = {
    "map": same_map,
    "saved map": same_map,
    "robot": same_robot,
    "obstacles": same_boxes,
    "training": lambda path: [load_hyperparameters(method, path) for method in METHODS],
    "tasks": load_test_set,
}


@pytest.fixture(scope="module")
def plan(walk):
    data = walk.to_dict()
    data["statistics"] |= {"feasibility_time": 0.0, "search_time": 0.0}
    del data["checksum"]  # so that what a mutation leaves right is read
    return json.loads(json.dumps(data))


def test_the_files_and_those_of_the_repository_are_valid(tmp_path, jem):
    for kind, data in FILES.items():
        assert loaded(LOADERS[kind], tmp_path / "x.json", json.dumps(data).encode()) is not None
    assert same_map(asset_path("jem.json")).fingerprint == jem.fingerprint
    walk = Path(__file__).parent.parent / "results" / "walk" / "plan.json"
    assert Plan.load(walk, jem).steps


@pytest.mark.parametrize("kind", FILES)
@given(st.data())
@few(0.06)
def test_a_mutated_file_is_one_error_at_most(tmp_path, kind, data):
    content = json.dumps(data.draw(mutated(FILES[kind]))).encode()
    loaded(LOADERS[kind], tmp_path / f"{kind}.json", content)


@given(st.data())
@few(0.07)
def test_a_mutated_plan_is_one_error_at_most(tmp_path, plan, jem, data):
    content = json.dumps(data.draw(mutated(plan))).encode()
    made = loaded(lambda path: Plan.load(path, jem), tmp_path / "plan.json", content)
    if made is not None:
        again = Plan.from_dict(json.loads(json.dumps(made.to_dict())), jem)
        assert again.to_dict() == made.to_dict()


@pytest.mark.parametrize("kind", FILES)
@given(st.data())
@few(0.03)
def test_a_damaged_file_is_one_error_at_most(tmp_path, kind, data):
    content = data.draw(damaged(json.dumps(FILES[kind]).encode()))
    loaded(LOADERS[kind], tmp_path / f"{kind}.json", content)
