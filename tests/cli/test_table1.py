"""The command `table1`."""

import json

import pytest

from mlivr_gym.cli import table1
from mlivr_gym.paper import case_graph
from mlivr_gym.planners import Plan
from mlivr_gym.planners.walks import edges_along


def test_table1_holds_every_relation(run, tmp_path):
    code, _, _ = run("table1", "--out", str(tmp_path / "new" / "results"))
    assert code == 0
    made = {path.name for path in (tmp_path / "new" / "results").iterdir()}
    assert made == {
        "table1.md",
        "table1.json",
        "scene_start.png",
        "scene_goal.png",
        *(f"case{k}{kind}.png" for k in (1, 2, 3, 4) for kind in ("", "_collisions")),
    }
    data = json.loads((tmp_path / "new" / "results" / "table1.json").read_text())
    assert len(data["relations"]) == 16
    assert all(data["relations"].values())
    for name, collisions in (("measured", False), ("measured_with_collisions", True)):
        rows = data[name]
        assert sorted(rows) == ["1", "2", "3", "4"]
        for number in ("2", "4"):
            graph = case_graph(int(number), data["setup"], collisions)
            assert rows[number]["stances"] == len(graph)
            plan = rows[number]["stances_of_plan"]
            assert edges_along(graph, plan) == len(plan) - 1 == rows[number]["steps"]
    assert data["measured_with_collisions"]["2"]["stances"] < data["measured"]["2"]["stances"]


@pytest.mark.parametrize("held", [True, False])
def test_a_relation_that_does_not_hold_is_named_and_ends_with_1(
    run, tmp_path, monkeypatch, plan_file, checked_graph, held
):
    plan = Plan.load(plan_file, checked_graph.grasp_map)
    data = {"relations": {"shorter is shorter": True, "longer is shorter": held}}
    monkeypatch.setattr(table1, "run_cases", lambda *_: ({3: plan}, data))
    monkeypatch.setattr(table1, "draw", lambda *_: None)
    code, out, _ = run("table1", "--out", str(tmp_path))
    assert code == (0 if held else 1)
    assert ("relation does not hold: longer is shorter" in out) != held
    assert "shorter is shorter" not in out
