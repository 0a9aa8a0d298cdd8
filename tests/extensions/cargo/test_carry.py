"""The command `carry` tells each part of a mission, and refuses one without a bag."""

import json

from mlivr_gym.cli.main import main
from mlivr_gym.world.grasp_map import jem_map

POINTS = ["--start", "D3a:8", "D3a:1", "D3a:4", "--pick", "D2b:3", "--stow", "F2b:4"]


def test_it_tells_what_was_carried_out(tmp_path, capsys):
    jem, bay = jem_map(), tmp_path / "bay.json"
    near = abs(jem.positions[:, 0] - 2.9) < 0.2
    near &= [face in ("deck", "forward") for face in jem.faces]
    jem.subset(near, "bay").save(bay)
    world = ["carry", "--robot", "mlivr3", "--map", str(bay), "--cargo", "10", "0.2", "0.2", "0.2"]
    assert main([*world, "--limb", "0", *POINTS, "--json"]) == 0
    mission = json.loads(capsys.readouterr().out)
    assert (mission["limb"], mission["failure"]) == (0, None)
    assert list(mission["parts"]) == ["pick up", "fold", "carry", "stow"]
