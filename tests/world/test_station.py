"""The places made of modules, against published lengths; plans and walks through their hatches."""

import numpy as np
import pytest

from mlivr_gym import GraspMap, stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.simulation.execution import execute
from mlivr_gym.world.grasp_map import as_map

STATION = as_map("station")
QUERIES = {
    "hatch": (("node/D1a:2", "node/F1a:0"), (1.6, 7.5, 0.2)),
    "station": (("columbus1/D1a:2", "columbus1/F1a:0"), (32.5, -5.0, 0.2)),
}


def planned(name):
    graph = stance_graph(name)
    return graph, Planner(graph).plan(
        *QUERIES[name], "steps", options=SearchOptions(inflation=1.2)
    ).unwrap()


@pytest.mark.parametrize(("name", "length"), [("columbus", 6.871), ("lab", 8.5), ("node", 7.2)])
def test_a_module_has_its_published_length_from_end_to_end(name, length):
    made = GraspMap.load(asset_path(f"{name}.json"))
    along = np.array([box.bounds[:, 0] for box in made.boxes])
    ends = 2 if name != "columbus" else 1
    # Half a vestibule of 16 inches is part of the length; a closed end has its bulkhead inside.
    assert along.min() == pytest.approx(-0.5 * length, abs=1e-9)
    assert along.max() == pytest.approx(0.5 * length - 0.16 * (2 - ends), abs=1e-9)
    racks = {point[:2] for point in made.ids if "/" not in point}
    assert len(racks) == {"columbus": 16, "lab": 24, "node": 8}[name]


CENTRES = np.array([box.centre for box in STATION.boxes])
HALVES = np.array([box.half for box in STATION.boxes])
AXES = np.array([box.rotation for box in STATION.boxes])


def is_free(place):
    """Whether a place is in no box."""
    local = np.einsum("ki,kij->kj", place - CENTRES, AXES)
    return not (np.abs(local) < HALVES).all(axis=1).any()


def test_modules_meet_at_open_hatches_and_the_others_are_closed():
    """Straight lines along the axes of the modules, and beside the openings."""
    row = np.linspace(-3.3, 34.7, 2000)
    assert all(is_free((x, 0.0, 0.0)) for x in row)
    assert not all(is_free((x, 0.8, 0.0)) for x in row)
    assert not is_free((-3.6, 0.0, 0.0))
    for x in (1.6, 17.3, 33.0):
        assert all(is_free((x, y, 0.0)) for y in np.linspace(-5.0, 0.0, 500))
    for x in (1.6, 17.3):
        assert all(is_free((x, y, 0.0)) for y in np.linspace(0.0, 5.0, 500))
    assert not all(is_free((33.0, y, 0.0)) for y in np.linspace(0.0, 5.0, 500))


def test_ten_modules_stand_beside_each_other():
    names = np.array([point.split("/")[0] for point in STATION.ids])
    assert len(set(names)) == 10
    assert 2700 < len(STATION) < 3400
    low = {n: STATION.positions[names == n].min(axis=0) for n in set(names)}
    high = {n: STATION.positions[names == n].max(axis=0) for n in set(names)}
    for a in low:
        for b in low:
            if a < b:
                overlap = np.minimum(high[a], high[b]) - np.maximum(low[a], low[b])
                assert overlap.min() < 0.0
    for point, normal in zip(STATION.positions[::7], STATION.normals[::7], strict=True):
        assert is_free(point + 0.02 * normal)


def test_two_handrails_flank_each_open_hatch_in_each_of_its_modules():
    """They are free, with a wall right behind them but in the JEM, which has its own, measured."""
    rails = [segment for segment in STATION.segments if segment.face == "handrails"]
    assert len({rail.id.rstrip("-+") for rail in rails}) == 2 * 9 == len(rails) / 2
    for rail in rails:
        middle = 0.5 * (np.array(rail.start) + rail.end)
        assert is_free(middle + 0.02 * np.array(rail.normal))
        if not rail.id.startswith("jem"):
            assert not is_free(middle - 0.04 * np.array(rail.normal))


def test_a_walk_through_the_hatch_is_planned_and_carried_out():
    graph, plan = planned("hatch")
    bases = plan.motion.base_positions
    assert np.linalg.norm(bases[-1] - QUERIES["hatch"][1]) <= 0.2
    crossing = bases[np.abs(bases[:, 1] - 2.44).argmin()]
    assert abs(crossing[0] - 1.6) < 0.6325
    assert {point.split("/")[0] for point in plan.stances[-1]} == {"columbus"}
    assert execute(graph, plan).failure is None


@pytest.mark.slow
def test_the_station_is_crossed_in_simulation():
    graph, plan = planned("station")
    assert {point.split("/")[0] for point in plan.stances[-1]} == {"jem2"}
    assert execute(graph, plan).failure is None
