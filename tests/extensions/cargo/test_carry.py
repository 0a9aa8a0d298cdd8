"""The command `carry` tells each part of a mission, and refuses one without a bag."""

import json

from mlivr_gym.cli.main import main
from mlivr_gym.world.grasp_map import jem_map

POINTS = ["--start", "D3a:8", "D3a:1", "D3a:4", "--pick", "D2b:3", "--stow", "F2b:4"]


def test_it_tells_what_was_carried_out(tmp_path, capsys):
    jem, out, bay = jem_map(), tmp_path / "mission.json", tmp_path / "bay.json"
    near = abs(jem.positions[:, 0] - 2.9) < 0.2
    near &= [face in ("deck", "forward") for face in jem.faces]
    jem.subset(near, "bay").save(bay)
    world = ["carry", "--robot", "mlivr3", "--map", str(bay), "--cargo", "10", "0.2", "0.2", "0.2"]
    code = main([*world, "--limb", "0", *POINTS, "--out", str(out)])
    lines, mission = capsys.readouterr().out.splitlines(), json.loads(out.read_text())
    assert (code, mission["limb"], lines[-2]) == (0, 0, "stowed")
    assert [part["part"] for part in mission["parts"]] == ["pick up", "fold", "carry", "stow"]
    for part in mission["parts"]:
        assert any(line.startswith(part["part"]) for line in lines)
