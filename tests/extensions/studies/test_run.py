"""A study gives each run once, whatever computes it, and goes on where it was interrupted."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym import stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.engines import executor_of
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.extensions.studies import read_study, run_study
from mlivr_gym.extensions.studies.design import BLOCK_TASKS, StudyDesign
from mlivr_gym.extensions.studies.rows import PLAN_COLUMNS, drawn_task, rows_of, succeeded
from mlivr_gym.extensions.studies.study import combination_means
from mlivr_gym.files import FileError
from mlivr_gym.planners import Planner

LEVELS = {"robot": ["mlivr2", "mlivr3"], "cost": ["steps", "base"], "clearance": [0.01, 0.02]}


@given(st.sets(st.sampled_from(list(LEVELS))), st.integers(1, 3 * BLOCK_TASKS))
def test_blocks_hold_each_task_of_each_combination_once(names, tasks):
    factors = {name: LEVELS[name] for name in names}
    design = StudyDesign.from_data({"kind": "plan", "tasks": tasks, "factors": factors})
    runs = {}
    for block in design.blocks:
        for k, task in enumerate(block.tasks):
            levels = tuple(block.levels[name] for name in factors)
            assert runs.setdefault(block.first_run + k, (*levels, task)) == (*levels, task)
    expected = [(*levels, task) for levels in product(*factors.values()) for task in range(tasks)]
    assert [runs[run] for run in sorted(runs)] == expected
    assert [block.number for block in design.blocks] == list(range(len(design.blocks)))


def test_a_file_describes_the_same_design_as_its_data(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('kind = "plan"\ntasks = 3\n[factors]\ncost = ["base", "steps"]\n')
    design = StudyDesign.from_file(path)
    assert design == StudyDesign.from_data(design.to_data())
    assert [levels["cost"] for levels in design.combinations] == ["base", "steps"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "kind is missing"),
        ('kind = "a:b"\n[factors]\nx = 3', "factors.x is 3; it must be a list"),
        ('kind = "a:b"\n[factors]\nx = [[1]]', "factors.x[0] is [1]; it must be text, a number"),
        ('kind = "plan"\ntask = 3', "unknown field 'task'; valid fields are kind, tasks"),
        ('kind = "build"', "kind is 'build'; valid choices are 'plan'"),
        ('kind = "plan"\n[factors]\npace = ["fast"]', "factors has an unknown field 'pace'"),
        ('kind = "plan"\n[factors]\ncost = ["time"]', "factors.cost[0] is 'time'"),
        ('kind = "plan"\n[factors]\nrobot = ["a", "a"]', "it must be levels that differ"),
        ("kind = plan", "cannot read study"),
        (f"kind = {'[' * 5000}{']' * 5000}", "nested too deeply"),
    ],
)
def test_a_faulty_file_is_refused_in_one_line(tmp_path, text, words):
    path = tmp_path / "study.toml"
    path.write_text(text)
    with pytest.raises(MlivrError) as fault:
        StudyDesign.from_file(path)
    assert words in str(fault.value)
    assert "\n" not in str(fault.value)
    assert "study.toml" in str(fault.value)
    with pytest.raises(MlivrError, match=r"cannot read study .*none\.toml.*No such file"):
        StudyDesign.from_file(tmp_path / "none.toml")


pytest.importorskip("pyarrow")

DESIGN = StudyDesign.from_data(
    {
        "kind": "plan",
        "tasks": 4,
        "seed": 3,
        "factors": {"cost": ["steps", "base"], "occupied": [0.0, 0.4]},
    }
)


@pytest.fixture(scope="module", autouse=True)
def small_blocks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mlivr_gym.extensions.studies.design.BLOCK_TASKS", 3)
        yield


@pytest.fixture(scope="module")
def rows(small_blocks):
    """The rows of the study, computed in this process."""
    return [row for block in DESIGN.blocks for row in rows_of(DESIGN, block)]


def untimed(rows):
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


def test_an_interruption_ends_processes_that_work():
    """They would finish their blocks, which may take hours."""

    def interrupted():
        with executor_of("local", 1) as pool:
            job = pool.submit(time.sleep, 36_000.0)
            while not job.running():
                time.sleep(0.01)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()


def test_rows_are_plans_of_equal_tasks(rows):
    by_run = {row["run"]: row for row in rows}
    graph, combinations = stance_graph(), len(DESIGN.combinations)
    assert sorted(by_run) == list(range(combinations * DESIGN.tasks))
    for task in range(DESIGN.tasks):
        steps, _, base, _ = (by_run[k * DESIGN.tasks + task] for k in range(combinations))
        assert (steps["start"], steps["goal_x"]) == (base["start"], base["goal_x"])
        if not steps["reason"]:
            goal = [steps["goal_x"], steps["goal_y"], steps["goal_z"]]
            plan = Planner(graph).plan(steps["start"].split(), goal, "steps").unwrap()
            assert (len(plan.steps), plan.base_translation) == (
                steps["steps"],
                steps["base_translation"],
            )
            assert base["base_translation"] <= steps["base_translation"] + 1e-9
            assert base["steps"] >= steps["steps"]


def test_a_share_of_the_points_is_occupied():
    graph = stance_graph()
    start, _ = drawn_task(graph, DESIGN.seed, 5, 0.4)
    assert len(graph.occupied) == round(0.4 * len(graph.grasp_map))
    assert graph.occupied.isdisjoint(start.stance)


def test_an_interrupted_study_goes_on_where_it_was(rows, tmp_path):
    def interrupt(done, total):
        if done >= 6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(DESIGN, tmp_path, workers=1, progress=interrupt)
    stored = {file.name: file.stat().st_mtime_ns for file in (tmp_path / "blocks").iterdir()}
    assert len(stored) == 3
    seen = []
    with ThreadPoolExecutor(1) as executor:
        file = run_study(DESIGN, tmp_path, executor, progress=lambda done, _: seen.append(done))
    assert seen == [7, 8, 11, 12, 15, 16]
    assert untimed(read_study(tmp_path)) == untimed(rows)
    written = file.stat().st_mtime_ns
    for _ in range(2):  # asked again, it is as it was
        assert sorted(one.name for one in tmp_path.iterdir()) == ["design.json", "study.parquet"]
        assert run_study(DESIGN, tmp_path, workers=1).stat().st_mtime_ns == written


def test_no_run_is_lost_or_repeated_when_a_worker_of_dask_is_killed(rows, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        killed = []

        def kill(done, total):
            if done and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        address = cluster.scheduler_address
        run_study(DESIGN, tmp_path, "dask", scheduler=address, progress=kill)
        assert killed
    assert untimed(read_study(tmp_path)) == untimed(rows)


def squares(task, *, scale, word="none"):
    """The kind of run of a user."""
    if task == 3:
        raise SettingError("no third run")
    return {"value": scale * task**2, "digits": list(range(task)), "word": word}


def test_an_own_function_is_a_kind_of_run(tmp_path):
    kind, factors = f"{__name__}:squares", {"scale": [2, 5], "word": ["a"]}
    design = StudyDesign.from_data({"kind": kind, "tasks": 90, "factors": factors})
    with ThreadPoolExecutor(2) as executor:  # any executor can compute a study
        run_study(design, tmp_path, executor)
    rows = read_study(tmp_path)
    assert [row["run"] for row in rows] == list(range(180))
    for row in rows:
        if row["task"] == 3:
            assert (row["error"], row["value"]) == ("no third run", None)
        else:
            assert row["value"] == row["scale"] * row["task"] ** 2
            assert row["digits"] == list(range(row["task"]))
            assert (row["word"], row["error"]) == ("a", "")
    assert sum(succeeded(row) for row in rows) == 178


@pytest.mark.parametrize("name", ["a:b", "file:a", "s3:", "%41 #?"])
def test_a_folder_of_any_name_holds_a_study(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    design = StudyDesign.from_data(
        {"kind": f"{__name__}:squares", "tasks": 2, "factors": {"scale": [3]}}
    )
    assert run_study(design, name, ThreadPoolExecutor(1)) == Path(name, "study.parquet")
    assert [row["value"] for row in read_study(name)] == [0, 3]


def test_a_study_that_cannot_be_run_is_refused(tmp_path):
    """Of functions and engines that do not exist, and in the folder of another study."""
    nothing = StudyDesign.from_data(
        {"kind": "plan", "tasks": 1, "factors": {"robot": ["no_such_robot"]}}
    )
    (row,) = rows_of(nothing, nothing.blocks[0])  # but a faulty level is the error of its row
    assert "no_such_robot" in row["error"]
    assert not succeeded(row)
    assert {*PLAN_COLUMNS} <= {*row}
    run_study(nothing, tmp_path / "kept", workers=1)
    other = StudyDesign.from_data(nothing.to_data() | {"seed": 1})
    with pytest.raises(SettingError, match="another design; choose another folder"):
        run_study(other, tmp_path / "kept")
    for kind in ("no_such_module:run", "json:no_such_function", "a b:c"):
        with pytest.raises(SettingError, match=f"kind is '{kind}', but there is no such function"):
            run_study(StudyDesign.from_data({"kind": kind, "tasks": 1}), tmp_path / "made")
    for engine, words in (({"engine": "ray"}, "'local', 'dask'"), ({"scheduler": "a"}, "='dask'")):
        with pytest.raises(MlivrError, match=words):
            run_study(DESIGN, tmp_path / "made", **engine)
    assert not (tmp_path / "made").exists()


def test_the_command_prints_a_line_for_each_combination(tmp_path, capsys):
    path = tmp_path / "costs.toml"
    path.write_text('kind = "plan"\ntasks = 2\n[factors]\ncost = ["steps", "base"]\n')
    assert main(["study", str(path), "--workers", "1"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].startswith("cost steps: 2 of 2, ")
    assert len(read_study(tmp_path / "costs")) == 4
    assert main(["study", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["successes"] for one in found["combinations"]] == [2, 2]
    assert main(["study", str(path), "--scheduler", "tcp://x:1"]) == 2


def test_counts_means_and_medians_are_those_of_each_combination():
    """Of two levels with three rows each, of which one run found nothing and one was refused."""
    design = StudyDesign.from_data(
        {"kind": "plan", "tasks": 3, "factors": {"cost": ["steps", "base"]}}
    )
    plain = {"error": "", "reason": "", "seconds": 1.0, "steps": 4}
    changes = [{}, {"steps": 9, "seconds": 2.0}, {"steps": 2, "seconds": 9.0}]
    changes += [{"steps": None, "reason": "no plan"}, {"steps": 6, "seconds": 3.0}]
    refused = dict.fromkeys(["reason", "steps", "seconds"])
    changes += [refused | {"error": "no such point"}]
    first, second = combination_means(design, [plain | change for change in changes])
    assert (first["runs"], first["successes"], first["errors"]) == (3, 3, 0)
    assert (first["mean_steps"], first["median_seconds"]) == (5.0, 2.0)
    assert (second["runs"], second["successes"], second["errors"]) == (3, 1, 1)
    assert (second["mean_steps"], second["median_seconds"]) == (6.0, 2.0)
    assert second["error"] == "no such point"


@pytest.mark.parametrize("name", ["study.parquet", "blocks/000000.parquet"])
def test_a_damaged_file_is_one_error(tmp_path, name):
    kind, factors = f"{__name__}:squares", {"scale": [1]}
    design = StudyDesign.from_data({"kind": kind, "tasks": 6, "factors": factors})
    executor = ThreadPoolExecutor(1)
    run_study(design, tmp_path, executor)
    damaged = tmp_path / name
    if not damaged.exists():
        damaged.parent.mkdir()
        (tmp_path / "study.parquet").unlink()
    damaged.write_bytes(b"PAR1 and no more")
    with pytest.raises(FileError, match=f"{damaged.name}' is damaged"):
        read_study(run_study(design, tmp_path, executor).parent)


def test_dask_opens_no_door_to_other_machines():
    """Neither the scheduler, its dashboard nor a worker listens elsewhere than on this machine."""
    pytest.importorskip("distributed")
    psutil, told = pytest.importorskip("psutil"), []
    me = psutil.Process()

    def listening():
        found = [one.net_connections("inet") for one in [me, *me.children(recursive=True)]]
        return {each.laddr for one in found for each in one if each.status == psutil.CONN_LISTEN}

    before = listening()
    with executor_of("dask", 1, notify=told.append) as executor:
        assert executor.submit(abs, -1).result() == 1
        opened = listening() - before
    assert len(opened) >= 3
    assert {address.ip for address in opened} == {"127.0.0.1"}
    assert told[0].startswith("http://127.0.0.1:")


@pytest.mark.parametrize("engine", ["local", "dask"])
def test_ctrl_c_does_not_reach_workers(engine):
    """It ends the command, which ends its workers: those that wait would tell where they were."""
    if engine == "dask":
        pytest.importorskip("distributed")
    with executor_of(engine, 1, notify=lambda _: None) as executor:
        blocked = executor.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result()
    assert signal.SIGINT in blocked
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.mark.parametrize("kind", ["plan", "own_runs:run"])
def test_files_beside_a_study_hide_no_installed_module(tmp_path, kind):
    """A study that was downloaded may lie beside files that are called like modules."""
    for name in ("pyarrow", "typing", "numpy", "mlivr_gym", "not_there"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w')\nraise SystemExit(9)\n")
    (tmp_path / "own_runs.py").write_text("def run(task):\n    return {'path': __file__}\n")
    (tmp_path / "study.toml").write_text(f"kind = '{kind}'\ntasks = 1\n")
    probe = (
        "import importlib.util, sys\n"
        "from mlivr_gym.cli.main import main\n"
        "code = main(['study', 'study.toml', '--workers', '1', '--quiet'])\n"
        "print(code, importlib.util.find_spec('not_there') is not None)\n"
    )
    code = "import sys; sys.path[:] = [p for p in sys.path if p]\n" + probe
    script = tmp_path / "elsewhere" / "probe.py"
    script.parent.mkdir()
    script.write_text(f"if __name__ == '__main__':\n{textwrap.indent(code, '    ')}")
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["0", str(kind != "plan")], done.stderr
    assert not list(tmp_path.rglob("ran"))
