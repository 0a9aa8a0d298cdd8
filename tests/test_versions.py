"""Files of other rules of the stance graph are refused in one sentence.

Nothing is written without the number of the rules.
"""

import json
import logging
import zipfile
from collections import OrderedDict

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.agents.learned import CheckpointError, load_policy, made_for, save_policy
from mlivr_gym.agents.networks import make_actor_critic
from mlivr_gym.agents.test_set import load_test_set
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError, PlanError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Planner
from mlivr_gym.settings import GRAPH_RULES
from mlivr_gym.stances import table_files
from mlivr_gym.stances.step_tables import step_tables
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.stances.table_files import HEAD

OTHERS = (None, GRAPH_RULES + 1)


@pytest.fixture(scope="module")
def env(small_map):
    return MlivrEnv(map=small_map, collisions=False)


def a_plan(env, folder):
    env.reset(seed=0)
    plan = Planner(env.graph).plan(env.state.stance, env.goal.tolist(), "steps").unwrap()
    plan.save(folder / "plan.json")
    assert Plan.load(folder / "plan.json").to_dict() == plan.to_dict()
    return folder / "plan.json", lambda: Plan.load(folder / "plan.json")


def a_checkpoint(env, folder):
    path, config = folder / "policy", {"network": "mlp", "sizes": {}} | made_for(env, "mlp")
    save_policy(path, make_actor_critic(env, "mlp", {}), config)
    assert "rules" not in config
    assert load_policy(path, env).config["rules"] == GRAPH_RULES
    return path.with_suffix(".json"), lambda: load_policy(path, env)


def a_test_set(env, folder):
    (folder / "set.json").write_text(asset_path("test_set.json").read_text())
    return folder / "set.json", lambda: load_test_set(folder / "set.json")


@pytest.mark.parametrize("rules", OTHERS)
@pytest.mark.parametrize(
    ("make", "error", "kind", "what", "remedy"),
    [
        (a_plan, PlanError, "plan", "the plan", "plan it anew"),
        (a_checkpoint, CheckpointError, "checkpoint", "it", "train it again"),
        (a_test_set, MlivrError, "test set", "it", "draw it again with freeze_test_set"),
    ],
)
def test_a_file_of_other_rules_or_none_is_refused(
    env, tmp_path, rules, make, error, kind, what, remedy
):
    file, load = make(env, tmp_path)
    data = json.loads(file.read_text())
    assert data.pop("rules") == GRAPH_RULES
    file.write_text(json.dumps(data | ({} if rules is None else {"rules": rules})))
    with pytest.raises(error) as caught:
        load()
    assert str(caught.value) == (
        f"{kind} {str(file)!r}: {what} was made by rules {1 if rules is None else rules!r} of the "
        f"stance graph, and this version has rules {GRAPH_RULES}: {remedy}"
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rules": GRAPH_RULES + 1}, f"has rules {GRAPH_RULES + 1}, and this version has rules"),
        ({"map": "0" * 16}, "is for another map;"),
        (None, "is damaged, or not of format 7;"),
    ],
)
def test_step_tables(small_map, tmp_path, monkeypatch, caplog, change, said):
    """Those of another format, rules or world are worked out anew; one line says what differs."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    world = small_map.subset(small_map.positions[:, 0] < 1.8, "smaller")
    graph = stance_graph(world)
    first, file, head = step_tables(graph), TABLES.cached(graph), TABLES.head(graph)
    with zipfile.ZipFile(file) as data:
        kept = {name: data.read(name) for name in data.namelist()}
    wrong = {**kept, "lost.npy": bytes(len(kept["lost.npy"]))}
    wrong[HEAD] = json.dumps(head | (change or {})).encode()
    if change is None:
        del wrong[HEAD]
    with zipfile.ZipFile(file, "w") as data:
        for name, content in wrong.items():
            data.writestr(name, content)
    table_files._memory.clear()
    with caplog.at_level(logging.WARNING):
        second = step_tables(stance_graph(world))
    (record,) = caplog.records
    assert said in record.getMessage()
    assert str(file) in record.getMessage()
    for ours, theirs in zip(first, second, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    with zipfile.ZipFile(file) as data:
        assert json.loads(data.read(HEAD)) == head
