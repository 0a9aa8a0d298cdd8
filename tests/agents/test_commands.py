"""The commands that train and evaluate."""

import argparse
import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from mlivr_gym.agents.evaluation import Evaluation
from mlivr_gym.agents.test_set import SPLITS, load_test_set
from mlivr_gym.cli.evaluate import _worlds, summary_of
from mlivr_gym.cli.main import main
from mlivr_gym.world.grasp_map import GraspMap


def test_commands_train_and_evaluate(capsys, tmp_path, short, ladder_file):
    assert GraspMap.load(ladder_file)
    hyper = {"bc": {"imitation": short}, "networks": {"pointer": {"width": 16, "summary": 8}}}
    (tmp_path / "hyper.json").write_text(json.dumps(hyper))
    common = ["--map", str(ladder_file), "--no-collisions"]
    out = tmp_path / "policy"
    arguments = f"--method bc --hyperparameters {tmp_path / 'hyper.json'} --out {out}".split()
    torch.set_num_threads(2)
    assert main(["train", *common, *arguments]) == 0
    assert torch.get_num_threads() == 1  # these small networks lose time with more
    assert out.with_suffix(".pt").exists()
    assert out.with_suffix(".json").exists()
    for policy in (str(out), "expert", "mcts", "astar"):
        assert main(["evaluate", *common, "--policy", policy, "--episodes", "2"]) == 0
    assert "2 of 2 episodes" in capsys.readouterr().out
    assert main(["evaluate", *common, "--policy", "magic"]) == 2
    assert "policy is 'magic'" in capsys.readouterr().err


@pytest.mark.parametrize("split", SPLITS)
def test_a_split_is_evaluated_with_all_its_tasks(split):
    """Each world of the split with its own map; nothing of the other splits."""
    worlds = [world for world in load_test_set() if world.split == split]
    found = _worlds(argparse.Namespace(split=split, episodes=7))
    assert [(a["map"].fingerprint, tasks) for a, tasks in found] == [
        (world.map().fingerprint, world.tasks) for world in worlds
    ]
    assert _worlds(argparse.Namespace(split=None, episodes=7)) == [({}, 7)]


def test_what_is_told_are_means_over_what_reached_the_goal():
    """Steps and metres of the episodes that did, in all worlds; the first action of every one."""
    one = Evaluation(
        np.array([True, False, True]), np.array([2, 90, 5]), np.array([1.0, 9.0, 2.5]),
        np.array([0.01, 0.02, 0.03]), np.zeros(3), np.zeros(3, dtype=int), np.full(3, np.nan),
        np.full(3, np.nan), np.full(3, np.nan),
    )  # fmt: skip
    none = replace(one, success=np.zeros(3, dtype=bool))
    other = replace(one, success=np.array([False, True, False]))
    told = summary_of([one, other, none])
    assert (told["episodes"], told["successes"]) == (9, 3)
    means = told["mean_steps"], told["mean_base_translation"], told["mean_first_action_time"]
    assert means == pytest.approx((97.0 / 3.0, 12.5 / 3.0, 0.02))
    assert summary_of([none])["mean_steps"] is None
