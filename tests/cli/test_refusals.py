"""What a command cannot use is told in one sentence, with exit code 2; it writes nothing."""

import pytest

LINES = """
plan --start D1a:4 Q:1                        : 'Q:1'
plan --goal 60 0 0                            : outside the cabin
plan --cost fast                              : --cost is 'fast'; valid choices are 'base', 'steps'
plan --robot robocop                          : 'robocop'
plan --robot mlivr2-iiwa --locked-joint joint2 : --locked-joint has no effect with --robot mlivr2
suggest --robot mlivr3                        : smallest changes need two limbs
plan --failed-joint 0 3 0.5                   : limb 0 has 6 joints: with joint 3 failed it can hold
failures --robot mlivr3                       : failures needs two limbs; 'mlivr3' has 3
load no/folder                                : cannot read simulation
plan --map nowhere.json                       : nowhere.json
plan --map uslab --unit mm                    : --unit mm needs the file of a map, given with --map
plan --map my.csv --unit km                   : --unit is 'km'; valid choices are 'm', 'mm'
plan --out plan.json --picture no/plan.png    : does not exist
plan --no-collisions --clearance 0.1          : --clearance has no effect
render --stance 2                             : --stance needs --plan
render --plan PLAN --stance 5 --out x.png     : --stance is 5; this plan has stances 0 (start) to 4
simulate --plan x.json --case 3               : give only one of
simulate --case 3 --duration 0                : step_duration is 0
simulate --case 3 --pace paper --duration 9   : no effect with --pace paper
simulate --case 3 --film walk.avi             : valid endings
walk --max 3                                  : --max 3; see `mlivr-gym walk --help`
carry --robot mlivr3 --start D3a:8 D3a:1 D3a:4 --pick D2b:3 --stow F2b:4 : --cargo is missing
simulate --plan PLAN --robot mlivr3           : --robot has no effect with --plan
simulate --case 3 --occupied D1a:4            : --occupied has no effect with --case
evaluate --split same --episodes 3            : --episodes has no effect
train --method bc --shaping                   : --shaping has no effect
dataset --lerobot x --id a-v0                 : --id has no effect with --lerobot
view --plan a --execution b                   : --plan has no effect with --execution
"""
"""Command lines, and words of what is told."""

NEEDED = {"view": "viser", "train": "sb3_contrib", "dataset": "minari"}
"""Packages of the extras that commands need before they look at anything else."""


@pytest.mark.parametrize("line", LINES.strip().splitlines())
def test_what_cannot_be_used_is_one_sentence_and_code_2(
    run, tmp_path, monkeypatch, plan_file, line
):
    command, words = (part.strip() for part in line.split(" : "))
    pytest.importorskip(NEEDED.get(command.split()[0], "numpy"))
    monkeypatch.chdir(tmp_path)
    code, _, err = run(command.replace("PLAN", str(plan_file)))
    assert code == 2
    assert words in err
    assert err.startswith("mlivr-gym: ")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())
