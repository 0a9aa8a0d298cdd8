"""The command `carry` tells each part of a mission, and refuses one without a bag."""

import json
from types import SimpleNamespace

import numpy as np

from mlivr_gym.cli.main import main
from mlivr_gym.files import FileError
from mlivr_gym.world.grasp_map import jem_map

POINTS = ["--start", "D3a:8", "D3a:1", "D3a:4", "--pick", "D2b:3", "--stow", "F2b:4"]


def test_it_tells_what_was_carried_out(tmp_path, capsys):
    jem, out, bay = jem_map(), tmp_path / "mission.json", tmp_path / "bay.json"
    near = abs(jem.positions[:, 0] - 2.9) < 0.2
    near &= [face in ("deck", "forward") for face in jem.faces]
    jem.subset(near, "bay").save(bay)
    world = ["carry", "--robot", "mlivr3", "--map", str(bay), "--cargo", "10", "0.2", "0.2", "0.2"]
    code = main([*world, "--cargo-limb", "0", *POINTS, "--out", str(out)])
    lines, mission = capsys.readouterr().out.splitlines(), json.loads(out.read_text())
    assert (code, mission["limb"], lines[-2]) == (0, 0, "stowed")
    assert [part["part"] for part in mission["parts"]] == ["pick up", "fold", "carry", "stow"]
    for part in mission["parts"]:
        assert any(line.startswith(part["part"]) for line in lines)


def test_a_film_that_cannot_be_written_leaves_no_other_file(tmp_path, capsys, monkeypatch):
    """Of a mission that is neither planned nor simulated."""
    peaks = SimpleNamespace(grasp_force=np.ones(3))
    part = SimpleNamespace(
        name="stow", recording=SimpleNamespace(times=[1.0]), peaks=peaks, miss=0.0, failure=None
    )
    plan = SimpleNamespace(steps=(), to_dict=dict)
    mission = SimpleNamespace(
        limb=0, cost=1.0, plans=[plan, plan], motions=[], execute=lambda _: [part]
    )

    def fail(*_):
        raise FileError("cannot write the film")

    cargo = "mlivr_gym.closed_loop.cargo_mission.plan_cargo_mission"
    monkeypatch.setattr(cargo, lambda *_, **__: mission)
    monkeypatch.setattr("mlivr_gym.pictures.mission_film.mission_film", fail)
    files = ["--out", str(tmp_path / "mission.json"), "--film", str(tmp_path / "mission.gif")]
    code = main(
        ["carry", "--robot", "mlivr3", "--cargo", "10", "0.2", "0.2", "0.2", *POINTS, *files]
    )
    assert (code, capsys.readouterr().err) == (2, "mlivr-gym: cannot write the film\n")
    assert not list(tmp_path.iterdir())
