"""The commands that train and evaluate."""

import argparse
import json

import pytest

from mlivr_gym.agents.test_set import SPLITS, load_test_set
from mlivr_gym.cli.evaluate import _worlds
from mlivr_gym.cli.main import main
from mlivr_gym.world.grasp_map import GraspMap


def test_commands_train_and_evaluate(capsys, tmp_path, short, ladder_file):
    assert GraspMap.load(ladder_file)
    hyper = {"bc": {"imitation": short}, "networks": {"pointer": {"width": 16, "summary": 8}}}
    (tmp_path / "hyper.json").write_text(json.dumps(hyper))
    common = ["--map", str(ladder_file), "--no-collisions"]
    out = tmp_path / "policy"
    arguments = [
        "--method",
        "bc",
        "--hyperparameters",
        str(tmp_path / "hyper.json"),
        "--out",
        str(out),
    ]
    assert main(["train", *common, *arguments]) == 0
    assert out.with_suffix(".pt").exists()
    assert out.with_suffix(".json").exists()
    for policy in (str(out), "expert", "mcts", "astar"):
        assert main(["evaluate", *common, "--policy", policy, "--episodes", "2"]) == 0
    assert "2 of 2 episodes" in capsys.readouterr().out
    assert main(["evaluate", *common, "--policy", "magic"]) == 2
    assert "policy is 'magic'" in capsys.readouterr().err


def test_ctrl_c_ends_the_command_train_with_a_checkpoint_and_130(
    capsys, tmp_path, monkeypatch, short, ladder_file
):
    hyper = {"bc": {"imitation": short}, "networks": {"pointer": {"width": 16, "summary": 8}}}
    (tmp_path / "hyper.json").write_text(json.dumps(hyper))

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("mlivr_gym.cli.train.timed_bar", lambda _: interrupt)
    code = main(
        ["train", "--map", str(ladder_file), "--no-collisions", "--method", "bc",
         "--hyperparameters", str(tmp_path / "hyper.json"), "--out", str(tmp_path / "policy")]
    )  # fmt: skip
    told = capsys.readouterr().err
    assert code == 130
    assert told.startswith("mlivr-gym: training interrupted")
    assert told.count("\n") == 1
    assert (tmp_path / "policy.pt").exists()
    assert (tmp_path / "policy.json").exists()


@pytest.mark.parametrize("split", SPLITS)
def test_a_split_is_evaluated_with_all_its_tasks(split):
    """Each world of the split with its own map; nothing of the other splits."""
    worlds = [world for world in load_test_set() if world.split == split]
    found = _worlds(argparse.Namespace(split=split, episodes=7))
    assert [(a["map"].fingerprint, tasks) for a, tasks in found] == [
        (world.map().fingerprint, world.tasks) for world in worlds
    ]
    assert _worlds(argparse.Namespace(split=None, episodes=7)) == [({}, 7)]
