"""The script of `completion`, asked as a shell asks it."""

import shutil
import subprocess

import pytest

from mlivr_gym.cli.main import main

ASK = """
COMP_WORDS=({words})
COMP_CWORD={last}
_mlivr_gym
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def completed(text, *words):
    """What bash offers for the last of some words."""
    quoted = " ".join(f"'{word}'" for word in words)
    asked = text + ASK.format(words=quoted, last=len(words) - 1)
    done = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout.split()


@pytest.fixture
def text(capsys):
    assert main(["completion", "bash"]) == 0
    return capsys.readouterr().out


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_commands_options_and_values_are_completed(text):
    assert completed(text, "mlivr-gym", "ren") == ["render"]
    assert completed(text, "mlivr-gym", "plan", "--goal-") == ["--goal-face"]
    costs = ["base", "steps", "weighted", "time", "reaction"]
    assert completed(text, "mlivr-gym", "plan", "--cost", "") == costs
    assert completed(text, "mlivr-gym", "train", "--method", "d") == ["dagger"]
    assert completed(text, "mlivr-gym", "plan", "--method", "d") == ["dijkstra"]
    assert completed(text, "mlivr-gym", "evaluate", "--split", "ha") == ["half"]
    assert completed(text, "mlivr-gym", "completion", "z") == ["zsh"]
    assert completed(text, "mlivr-gym", "plan", "--out", "") == []  # files, which bash completes


@pytest.mark.skipif(shutil.which("zsh") is None, reason="no zsh")
def test_zsh_takes_the_script(text):
    asked = f"autoload -U compinit && compinit -u -D\n{text}\nwhence -w _mlivr_gym"
    done = subprocess.run(["zsh", "-fc", asked], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "_mlivr_gym: function"
    assert done.stderr == ""
