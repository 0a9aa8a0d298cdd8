"""The command `table1`."""

import json


def test_table1_holds_every_relation(run, tmp_path):
    code, _, _ = run("table1", "--out", str(tmp_path / "results"))
    assert code == 0
    made = {path.name for path in (tmp_path / "results").iterdir()}
    assert made == {
        "table1.md",
        "table1.json",
        "scene_start.png",
        "scene_goal.png",
        *(f"case{k}{kind}.png" for k in (1, 2, 3, 4) for kind in ("", "_collisions")),
    }
    data = json.loads((tmp_path / "results" / "table1.json").read_text())
    assert len(data["relations"]) == 16
    assert all(data["relations"].values())
