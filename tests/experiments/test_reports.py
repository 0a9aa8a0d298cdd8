"""The parts that experiments share: results, page and figure of a script, and rows of a study."""

import json

import pytest
import reports

pytest.importorskip("pyarrow")


@pytest.fixture(autouse=True)
def root(tmp_path, monkeypatch):
    """The folder of the test in place of the repository."""
    monkeypatch.setattr(reports, "ROOT", tmp_path)


PRODUCTS = """
from mlivr_gym.errors import SettingError

def product(task, *, factor):
    if factor < 0:
        raise SettingError("a factor below 0")
    return {"product": factor * task}
"""


@pytest.fixture
def product(tmp_path, monkeypatch):
    """A function in a module that other processes find."""
    (tmp_path / "products.py").write_text(PRODUCTS)
    monkeypatch.syspath_prepend(tmp_path)
    return "products:product"


def test_an_experiment_writes_results_page_and_figure(tmp_path, monkeypatch):
    calls = []

    def measure(tasks, share):
        calls.append((tasks, share))
        return {"tasks": tasks}

    def draw(data, path):
        path.write_text(f"drawn {data['tasks']}")

    def run(*words):
        monkeypatch.setattr("sys.argv", ["script", "--out", str(tmp_path), *words])
        page = "page of {tasks}".format_map
        reports.experiment("small", "What it does.", measure, page, draw, tasks=2, share=0.5)
        names = ("small.json", "small.md", "small.png")
        return [(tmp_path / name).read_text() for name in names]

    results, page, figure = run("--tasks", "7")
    assert calls == [(7, 0.5)]
    assert (json.loads(results), page, figure) == ({"tasks": 7}, "page of 7", "drawn 7")
    (tmp_path / "small.json").write_text('{"tasks": 8}')
    assert run("--report")[1:] == ["page of 8", "drawn 8"]
    assert calls == [(7, 0.5)]


def test_rows_of_a_study_are_those_of_the_function_and_leave_nothing(product, tmp_path):
    rows = reports.study_rows(product, 3, 1, factor=[2, 5])
    assert [row["product"] for row in rows] == [0, 2, 4, 0, 5, 10]
    assert list((tmp_path / "runs" / "studies").iterdir()) == []


def test_an_interrupted_experiment_keeps_the_studies_that_it_has_finished(
    product, tmp_path, monkeypatch
):
    factors = [[2], [-1]]

    def measure():
        return [reports.study_rows(product, 3, 1, factor=levels) for levels in factors]

    monkeypatch.setattr("sys.argv", ["script", "--out", str(tmp_path)])
    with pytest.raises(SystemExit, match="3 of 3 runs failed"):
        reports.experiment("two", "Two studies.", measure)
    (kept,) = (tmp_path / "runs" / "studies").glob("*/design.json")
    factors.pop()
    (tmp_path / "products.py").write_text("product = None")
    reports.experiment("two", "Two studies.", measure)
    assert [row["product"] for row in json.loads((tmp_path / "two.json").read_text())[0]] == [
        0,
        2,
        4,
    ]
    assert not kept.exists()
