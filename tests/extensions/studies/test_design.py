"""The design of a study has every combination of levels, and refuses what cannot be run."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.errors import MlivrError
from mlivr_gym.extensions.studies.design import BLOCK_TASKS, StudyDesign

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


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(MlivrError, match=r"cannot read study .*none\.toml.*No such file"):
        StudyDesign.from_file(tmp_path / "none.toml")
