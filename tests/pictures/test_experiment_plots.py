"""Plots of the experiments show every figure, and say what is not measured."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(scope="module")
def experiments():
    sys.path.insert(0, str(ROOT / "experiments"))
    try:
        yield {name: importlib.import_module(name) for name in ("comparison_report", "table1")}
    finally:
        sys.path.remove(str(ROOT / "experiments"))


def result(success, steps):
    tasks = list(range(len(success)))
    values = {"success": success, "steps": steps, "base_translation": steps}
    return {"0": {"part": {"tasks": tasks, **values}}}


DATA = {
    "same": {
        "astar-steps": result([1, 1, 1], [4, 4, 5]),
        "greedy": result([1, 1, 1], [8, 8, 10]),
        "random": result([1, 0, 1], [60, 60, 75]),
        "mcts": result([0, 0, 0], [60, 60, 60]),
        "no-manipulability-reached": result([1, 1, 1], [3, 3, 3.75]),
    },
    "dense": {"astar-steps": result([1, 1, 1], [4, 4, 4])},
}


@pytest.fixture
def drawn(experiments, monkeypatch, tmp_path):
    module, kept = experiments["comparison_report"], []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: kept.append(figure))
    module.draw(DATA, tmp_path / "planner_vs_rl.png")
    return module, kept[0]


def test_no_mean_is_cut_off_and_each_has_its_figure(drawn):
    _, figure = drawn
    success, steps = figure.axes
    for axes, expected in ((success, [100.0, 100.0, 200 / 3, 0.0, 100.0, 100.0]),
                           (steps, [1.0, 2.0, 15.0, 0.75, 1.0])):  # fmt: skip
        dots = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "o"
                and len(line.get_xdata()) == 1]  # fmt: skip
        np.testing.assert_allclose(sorted(dots), sorted(expected))
        low, high = axes.get_xlim()
        assert low < min(dots)
        assert max(dots) < high
    said = [text.get_text() for text in steps.texts]
    assert {"1.00", "2.00", "15.00"} <= set(said)
    assert steps.get_xscale() == "log"
    assert "0 %" in [text.get_text() for text in success.texts]


def test_what_is_missing_is_said_and_not_drawn_as_nothing(drawn):
    module, figure = drawn
    success, steps = ([text.get_text() for text in axes.texts] for axes in figure.axes)
    assert success.count(module.NOT_MEASURED) == 4  # four methods on the dense map
    assert steps.count(module.NOT_MEASURED) == 4
    assert success.count(module.NEVER_REACHED) == 0
    assert steps.count(module.NEVER_REACHED) == 1


def test_the_front_tells_the_span_of_its_axis(experiments, monkeypatch, tmp_path):
    module, kept = experiments["table1"], []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: kept.append(figure))
    rows = [
        {"price": 0.0, "steps": 4.0, "base_translation": 2.0},
        {"price": 0.5, "steps": 3.0, "base_translation": 2.05},
    ]
    module.draw_pareto(rows, 7, tmp_path / "pareto.png")
    (axes,) = kept[0].axes
    said = " ".join(text.get_text() for text in axes.texts)
    assert "translations differ by 2.5 %" in said
    assert "(50 mm)" in said
    assert "the steps by 33 %" in said
    assert "2.000 m [%]" in axes.get_ylabel()
    (dots,) = axes.collections
    np.testing.assert_allclose(dots.get_offsets(), [[4.0, 0.0], [3.0, 2.5]])


def test_the_front_is_drawn_from_what_was_found(experiments, monkeypatch, tmp_path):
    """`--picture` plans nothing and leaves the figures alone."""
    study = (ROOT / "results" / "table1_study.json").read_text()
    (tmp_path / "table1_study.json").write_text(study)
    monkeypatch.setattr(sys, "argv", ["table1.py", "--picture", "--out", str(tmp_path)])
    monkeypatch.setattr(experiments["table1"], "run_cases", None)
    experiments["table1"].main()
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"table1_study.json", "pareto.png", "pareto.svg"}
    assert json.loads((tmp_path / "table1_study.json").read_text()) == json.loads(study)
