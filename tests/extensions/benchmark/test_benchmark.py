"""Entries of the benchmark: made, checked by replay, refused when altered, and listed."""

import csv
import json
import re
import shutil
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from mlivr_gym.agents import ExpertPolicy, planner_policy
from mlivr_gym.cli.main import main
from mlivr_gym.envs.regret import CostBounds
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.benchmark import (
    BenchmarkEntry,
    TrainingEnv,
    check,
    markdown_table,
    protocol,
    run,
)
from mlivr_gym.extensions.benchmark.entry import BenchmarkError, EpisodeRow, results_of
from mlivr_gym.extensions.benchmark.protocol import environment
from mlivr_gym.extensions.benchmark.runner import episode_row, policy_maker
from mlivr_gym.files import FileError
from mlivr_gym.settings import GRAPH_RULES

pytestmark = pytest.mark.usefixtures("cache")
ROOT = Path(__file__).parents[3]
FAR = "MLIVR-JEM-Far-v0"
TASKS = 15
ENTRIES = sorted(path.parent for path in (ROOT / "benchmark").glob("*/summary.json"))


@pytest.fixture(scope="module", autouse=True)
def environments_are_dropped_after_these_tests():
    """All six of them take half a gigabyte."""
    yield
    environment.cache_clear()


class Learner:
    """Takes five steps, and then acts as the expert does."""

    def train(self, env, seed):
        """Learn, within the budget or not."""
        env.reset(seed=seed)
        for _ in range(5):
            env.step(int(env.action_masks().argmax()))

    def act(self, env, observation, mask):
        """Return the optimal action."""
        return ExpertPolicy().act(env, observation, mask)


class Loaded:
    """Says what it learned from before."""

    environment_steps = 2_000_000

    def act(self, env, observation, mask):
        """Return the first valid action."""
        return int(mask.argmax())


def first(observation, mask):
    """Return the first valid action."""
    return int(mask.argmax())


@pytest.fixture(scope="module")
def greedy(tmp_path_factory, cache):
    """The example of the page, on a few tasks."""
    folder = tmp_path_factory.mktemp("greedy")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        entry = run("benchmark.greedy.greedy:act", "planner", None, (FAR,), TASKS)
    entry.write(folder)
    return folder


def test_nineteen_of_twenty_seeds_score_between_the_percentiles():
    """Of 41 seeds that score evenly spaced, all but one at each end do, and two on them."""
    rows = [EpisodeRow(FAR, k, 0, True, 100.0, k + 1.0, 1.0, (), (1.0,)) for k in range(41)]
    told = results_of(rows)[FAR]
    assert told["score_percentiles"] == [0.02, 0.4]
    assert told["score"] == 0.21


def test_references_and_scores_are_those_of_the_cost_to_go(greedy):
    """The exact cost-to-go shares no search with the A* from which the references come."""
    entry, scores = BenchmarkEntry.read(greedy), []
    env = gymnasium.make(FAR, info_regret=True, disable_env_checker=True)
    for row in entry.rows:
        _, info = env.reset(options={"task": row.task})
        assert (row.reference, row.bound) == (info["optimal_cost"], 1.0)
        assert row.cost == len(row.actions) == len(row.milliseconds)
        scores.append(row.success * info["optimal_cost"] / len(row.actions))
    found = entry.summary["results"][FAR]
    assert found["score"] == pytest.approx(np.mean(scores), abs=1e-6)
    assert found["success"] == pytest.approx(np.mean([row.success for row in entry.rows]), abs=1e-6)
    assert 0.0 < found["score"] < 1.0
    assert (entry.summary["uses"], entry.summary["seeds"]) == ("observation", 1)


def test_what_adds_up_passes_and_what_does_not_is_refused(greedy, tmp_path):
    assert check(greedy, TASKS).summary == BenchmarkEntry.read(greedy).summary
    with pytest.raises(BenchmarkError, match="the entry has 15 tasks; it must have 200"):
        check(greedy)
    done = next(k for k, row in enumerate(BenchmarkEntry.read(greedy).rows) if row.success)

    def row_with(**change):
        def alter(rows, _):
            rows[done].update(change)

        return alter

    def another_action(rows, _):
        rows[done]["actions"] = " ".join(["0", *rows[done]["actions"].split()[1:]])

    def one_action_less(rows, _):
        rows[done]["actions"] = " ".join(rows[done]["actions"].split()[:-1])

    def one_row_less(rows, _):
        rows.pop()

    def told(**change):
        return lambda _, summary: summary.update(change)

    results = json.loads((greedy / "summary.json").read_text())["results"]
    better = {FAR: results[FAR] | {"score": 0.999}}
    faults = (
        (row_with(cost="1.0"), "cost is told as 1.0; the replay gives"),
        (row_with(reference="9.0"), "reference is told as 9.0; the replay gives"),
        (row_with(bound="2.0"), "bound is told as 2.0; the replay gives"),
        (row_with(success="False"), "success is told as False"),
        (row_with(success="yes"), "cannot read"),
        (another_action, "success is told as True"),
        (one_action_less, "goes on after its"),
        (one_row_less, "the episodes are not those of 15 tasks and each seed"),
        (told(results=better), "results is told as"),
        (told(graph_rules=1), "rules"),
        (told(seeds=3), "seeds is told as 3; the replay gives 1"),
        (told(environment_steps=[7]), "learned from 7 steps, more than planner has"),
        (told(budget="1G"), "budget"),
    )
    for alter, words in faults:
        folder = tmp_path / "altered"
        shutil.copytree(greedy, folder, dirs_exist_ok=True)
        with open(folder / "episodes.csv", newline="") as stream:
            rows = list(csv.DictReader(stream))
        summary = json.loads((folder / "summary.json").read_text())
        alter(rows, summary)
        with open(folder / "episodes.csv", "w", newline="") as stream:
            writer = csv.DictWriter(stream, rows[0].keys())
            writer.writeheader()
            writer.writerows(rows)
        (folder / "summary.json").write_text(json.dumps(summary))
        with pytest.raises(BenchmarkError, match=re.escape(words)):
            check(folder, TASKS)


def test_files_beside_a_policy_hide_no_installed_module(monkeypatch, tmp_path):
    """A policy that was downloaded may lie beside files that are called like modules."""
    (tmp_path / "colorsys.py").write_text("raise SystemExit(9)\n")
    own = "import colorsys\ndef act(observation, mask):\n    return 0\n"
    (tmp_path / "own_policy.py").write_text(own)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("colorsys", "own_policy"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    assert policy_maker("own_policy:act")().act(None, None, np.ones(9, dtype=bool)) == 0
    del sys.modules["own_policy"]


@pytest.mark.parametrize("name", ["summary.json", "episodes.csv", "scores.png"])
def test_all_files_of_an_entry_are_written_or_none(greedy, tmp_path, name):
    (tmp_path / name).mkdir()
    with pytest.raises(FileError, match=f"{name}': it is a folder"):
        BenchmarkEntry.read(greedy).write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_learner_is_held_to_its_budget(monkeypatch, tmp_path):
    here = f"{__name__}:Learner"
    entry = run(here, "100k", 2, ("MLIVR-JEM-v0", FAR), 2)
    assert entry.summary["environment_steps"] == [5, 5, 5, 5]
    assert entry.summary["results"][FAR]["score"] == 1.0
    entry.write(tmp_path)
    check(tmp_path, 2)
    for policy, seeds in (("Learner", 3), ("first", 1)):  # as its help says
        told = run(f"{__name__}:{policy}", "100k", None, (FAR,), 1).summary
        assert told["seeds"] == seeds == len(told["environment_steps"] or "1")
    monkeypatch.setitem(protocol.BUDGETS, "100k", 4)
    with pytest.raises(SettingError, match="the budget of 4 environment steps is spent"):
        run(here, "100k", 1, (FAR,), 1)
    with pytest.raises(SettingError, match="is trained; give it a budget"):
        run(here, "planner", 1, (FAR,), 1)
    with pytest.raises(SettingError, match="learned from 2000000 steps; 100k is less"):
        run(f"{__name__}:Loaded", "100k", 1, (FAR,), 1)


def test_steps_in_training_are_counted_and_held_out_tasks_refused():
    env = TrainingEnv(environment(FAR), 2)
    with pytest.raises(SettingError, match="fixed tasks are held out"):
        env.reset(options={"task": 3})
    env.reset(seed=0)
    for _ in range(2):
        env.step(int(env.action_masks().argmax()))
    assert env.environment_steps == 2
    with pytest.raises(SettingError, match="the budget of 2"):
        env.step(0)


def test_commands_check_and_list_entries(greedy, capsys, tmp_path):
    rows = {"greedy": BenchmarkEntry.read(greedy)}
    rows["better"] = run(f"{__name__}:Learner", "5M", 2, (FAR,), 2)
    lines = markdown_table(rows).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| better", "| greedy"]
    assert "MLIVR-5M | environment" in lines[2]
    assert "1.000 [1.000, 1.000] (100 %)" in lines[2]
    assert main(["benchmark", "table", str(greedy)]) == 0
    assert capsys.readouterr().out.count("\n") == 3
    assert main(["benchmark", "check", str(greedy)]) == 2
    assert "it must have 200" in capsys.readouterr().err
    for line, words in (
        ("check", "check needs the folder of an entry"),
        ("run", "run needs --policy, --budget, --out"),
        (f"table {greedy} --seeds 2", "--seeds has no effect with table"),
        (f"run {greedy}", "run takes no folders"),
        (f"run --policy nothing:here --budget 5M --out {tmp_path}/a", "must be MODULE:NAME"),
    ):
        assert main(["benchmark", *line.split()]) == 2
        assert words in capsys.readouterr().err


def test_a_run_goes_on_where_it_was_stopped(tmp_path, capsys):
    """By environment and seed; what is there is kept, and another policy is refused."""
    here, names = f"{__name__}:Learner", ("MLIVR-Random-v0", FAR)
    written = []
    first = run(here, "100k", 1, names, 2, save=written.append)
    assert [len(entry.rows) for entry in written] == [2, 4]
    both = run(here, "100k", 2, (FAR, "MLIVR-JEM-v0"), 2, entry=first)
    assert list(both.parts) == [("MLIVR-JEM-v0", 0), ("MLIVR-JEM-v0", 1), (FAR, 0), (FAR, 1), (
        "MLIVR-Random-v0", 0)]  # fmt: skip
    assert both.summary["environment_steps"] == [5] * 5
    assert [row for row in both.rows if row in first.rows] == list(written[1].rows)
    assert {name: one["seeds"] for name, one in both.summary["results"].items()} == {
        "MLIVR-JEM-v0": 2, FAR: 2, "MLIVR-Random-v0": 1,
    }  # fmt: skip
    both.write(tmp_path)
    check(tmp_path, 2)
    with pytest.raises(SettingError, match="the entry has budget '100k', not '5M'"):
        run(here, "5M", 2, (FAR,), 2, entry=both)
    line = f"run --policy {__name__}:first --budget 100k --environment {FAR} --out {tmp_path}"
    assert main(["benchmark", *line.split()]) == 2
    assert "the entry has policy" in capsys.readouterr().err


def test_an_unknown_map_is_scored_by_the_plan_of_who_knows_it():
    """A look costs half an attempt, so that who looks once on an optimal way scores less."""
    name = "MLIVR-JEM-Unknown-v0"
    _, info = environment(name).reset(options={"task": 0})
    look = environment(name).action_space.n - 1

    class LookThenExpert:
        def act(self, env, observation, mask):
            if env.steps == 0:
                return look
            return ExpertPolicy().act(env, observation, mask[:-1])

    row = episode_row(name, 0, 0, LookThenExpert())
    assert (row.reference, row.bound) == (info["fewest_steps"], 1.0)
    assert row.cost >= row.reference + 0.5
    assert row.cost == pytest.approx(len(row.actions) - 0.5)


def test_four_limbs_are_compared_with_a_plan_that_is_proved_to_a_bound():
    """The lower bound of the environment comes from another program than the bound of the plan."""
    name = "MLIVR4-JEM-Anywhere-v0"
    env = environment(name)
    bounds = CostBounds(env)
    for task in (3, 6):
        env.reset(options={"task": task})
        lower = bounds.of_state(env, env.state)
        row = episode_row(name, 0, task, planner_policy("steps"))
        assert row.success
        assert 1.0 <= lower <= row.reference
        assert row.reference / row.bound <= row.cost


def test_best_plans_known_are_of_the_present_rules_and_no_entry_beats_them():
    stored = json.loads(asset_path("best_known.json").read_text())
    assert stored.pop("rules") == GRAPH_RULES
    for name, plans in stored.items():
        costs, bounds = np.array(plans).T
        assert len(plans) == protocol.TASKS
        assert ((costs >= 1.0) & (costs % 1.0 == 0.0)).all()
        assert ((bounds >= 1.0) & (bounds < 2.0)).all()
        for folder in ENTRIES:
            rows = [row for row in BenchmarkEntry.read(folder).rows if row.environment == name]
            assert all(row.cost >= row.reference for row in rows if row.success)


def test_the_entries_in_the_repository_are_of_the_present_rules():
    """Their replays take minutes, so that only what is read quickly is compared here."""
    found = {folder.name: BenchmarkEntry.read(folder) for folder in ENTRIES}
    for entry in found.values():
        assert entry.summary["graph_rules"] == GRAPH_RULES
        assert entry.summary["results"] == results_of(entry.rows)
        assert entry.summary["tasks"] == protocol.TASKS
    for page in ("docs/benchmark.md", "README.md"):
        assert markdown_table(found) in (ROOT / page).read_text(encoding="utf-8")
    page = (ROOT / "docs" / "benchmark.md").read_text(encoding="utf-8")
    assert (ROOT / "benchmark" / "greedy" / "greedy.py").read_text(encoding="utf-8") in page


@pytest.mark.parametrize("name", ["11_benchmark_maskable_ppo", "12_benchmark_reinforce"])
def test_learners_of_the_examples_learn_within_their_budget(name, monkeypatch):
    pytest.importorskip("sb3_contrib")
    monkeypatch.chdir(ROOT)
    monkeypatch.setitem(protocol.BUDGETS, "100k", 1000)
    kind = "MaskedPPO" if "maskable" in name else "Reinforce"
    entry = run(f"examples.{name}:{kind}", "100k", 1, ("MLIVR-JEM-Unknown-v0",), 2)
    assert entry.summary["environment_steps"] == [1000]
    assert all(len(row.actions) == 60 or row.success for row in entry.rows)  # all were valid
