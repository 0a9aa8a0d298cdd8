"""What the page of the paper's figures says, on data made up with a known answer."""

import importlib

import pytest


@pytest.fixture(scope="module")
def module(experiments):
    return importlib.import_module("paper_figures_report")


def run(swing, capture):
    """A step whose peaks are 0.1 N m but in swing and capture."""
    peaks = {"departure": 0.1, "swing": swing, "approach": 0.1, "capture": capture}
    return {
        "largest_in": max(peaks, key=peaks.get),
        "parts": {part: {"peak_N_m": peak, "mean_N_m": 0.05} for part, peak in peaks.items()},
        "captured": True,
    }


def step(ours, task):
    """A step with one controller's runs for both; without a swing in task space if that is None."""
    runs = {"joint space": {"PD": ours}}
    return {"runs": runs if task is None else runs | {"task space": {"PD": task}}}


def test_only_steps_that_both_swings_can_do_are_compared(module):
    steps = [step(run(1.0, 0.2), run(0.5, 0.6)), step(run(2.0, 3.0), None)]
    assert module.largest_counts(module.runs_of(steps, "joint space", "PD")) == {"swing": 1}
    assert module.largest_counts(module.runs_of(steps, "task space", "PD")) == {"capture": 1}
    assert module.swing_ratio(steps, "PD") == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("caught", "word"), [(0, "no"), (1, "in part"), (9, "in part"), (10, "yes")]
)
def test_reproduced_means_more_than_nine_in_ten(module, caught, word):
    runs = [run(1.0, 2.0)] * caught + [run(1.0, 0.5)] * (10 - caught)
    assert module.reproduced(runs) == word


def test_torque_goes_with_the_distance(module):
    rows = [
        {"capture": 0.2, "capture_distance_mm": [2.0]},
        {"capture": 0.6, "capture_distance_mm": [4.0]},
        {"capture": 0.2, "capture_distance_mm": [1.0]},
        {"swing": 1.0, "capture_distance_mm": []},
    ]
    assert module.per_millimetre(rows) == pytest.approx(0.15)
    assert module.arrival(rows) == pytest.approx(2.0)
