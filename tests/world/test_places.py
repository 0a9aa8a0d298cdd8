"""The maps that ship beside the JEM, against published figures, and walks through their hatches."""

import math
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, jem_map, stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MapError
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.simulation.execution import execute
from mlivr_gym.world.grasp_map import PLACES, as_map

TRUSS, LAB = as_map("truss"), as_map("uslab")
POSES = {
    "stow": ((-3.2258, -0.86, -1.09314), (0.0, 0.0)),
    "deck_3": ((-0.025, -0.67729, -1.09314), (0.0, 90.0)),
    "port_1": ((-0.0402, -1.1, 0.1), (-90.0, 90.0)),
    "stbd_4": ((2.06, 1.09, 0.6), (90.0, -90.0)),
}
"""Some published handrails: place [m], roll and yaw [degrees]."""


def test_a_name_is_a_map_and_the_jem_is_one_of_them():
    assert [as_map(name).name for name in PLACES] == list(PLACES)
    assert as_map("jem").fingerprint == jem_map().fingerprint


def test_a_wrong_name_is_refused_with_the_names():
    names = "jem, truss, uslab, columbus, hatch, station"
    with pytest.raises(MapError, match=f"unknown map 'Truss'; valid names are {names}"):
        stance_graph("Truss")


def test_the_truss_has_the_published_size_and_its_points_lie_on_it():
    low = np.min([box.centre - np.array(box.half) for box in TRUSS.boxes], axis=0)
    high = np.max([box.centre + np.array(box.half) for box in TRUSS.boxes], axis=0)
    np.testing.assert_allclose(high - low, [13.4 + 2 * 13.7, 4.6, 4.0])
    inside = (TRUSS.positions >= low - 1e-9) & (TRUSS.positions <= high + 1e-9)
    assert inside.all()
    for outward in (1e-3, -1e-3):
        moved = TRUSS.positions + outward * TRUSS.normals
        assert ((moved >= low) & (moved <= high)).all(axis=1).all() == (outward < 0.0)


def test_handrails_of_the_lab_lie_in_the_room_and_as_published():
    """A pose is read as roll after yaw; so read, z points into the room on every wall."""
    low, high = LAB.cabin
    rails = {segment.id: segment for segment in LAB.segments if segment.face == "handrails"}
    assert len(rails) == 14
    for rail in rails.values():
        ends = np.array([rail.start, rail.end])
        assert (ends >= low).all()
        assert (ends <= high).all()
        middle = ends.mean(axis=0)
        assert np.dot(rail.normal, middle) < 0.0
        assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(41.5 * 0.0254, abs=1e-4)
    for name, (place, (roll, yaw)) in POSES.items():
        turn = Rotation.from_euler("XYZ", [roll, 0.0, yaw], degrees=True).as_matrix()
        np.testing.assert_allclose(turn[:, 2], rails[name].normal, atol=1e-9)
        along = np.subtract(rails[name].end, rails[name].start)
        np.testing.assert_allclose(along / np.linalg.norm(along), turn[:, 0], atol=1e-6)
        above = np.subtract(rails[name].start, place)
        np.testing.assert_allclose(above, 0.0757 * turn[:, 2], atol=1e-6)


def test_racks_of_the_lab_have_standard_tracks_at_the_standard_pitch():
    """Racks are 42 inches apart (Boeing), each with the two tracks of those of the JEM."""
    jem = {segment.id: segment for segment in jem_map().segments}
    length = math.dist(jem["D1a"].start, jem["D1a"].end)
    apart = abs(jem["D1a"].start[0] - jem["D1b"].start[0])
    tracks = {segment.id: segment for segment in LAB.segments if " " not in segment.face}
    racks = {name[:2] for name in tracks if re.fullmatch("[DOPS][1-6][ab]", name)}
    assert len(racks) == 23
    for rack in racks:
        first, second = tracks[f"{rack}a"], tracks[f"{rack}b"]
        assert math.dist(first.start, first.end) == pytest.approx(length, abs=0.006)
        assert second.start[0] - first.start[0] == pytest.approx(apart, abs=0.003)
    for side in "DPS":
        places = [tracks[f"{side}{k}a"].start[0] for k in range(1, 7)]
        assert (places[-1] - places[0]) / 5 == pytest.approx(42 * 0.0254, abs=0.006)


def test_handrails_of_the_lab_stand_at_its_tracks():
    """Two publications that know nothing of each other: the handrails' world, and the mesh."""
    tracks = [segment for segment in LAB.segments if segment.face in ("deck", "port", "starboard")]
    for rail in LAB.segments:
        if rail.face != "handrails" or rail.id == "stow":
            continue
        axis = int(np.abs(rail.normal).argmax())
        foot = np.subtract(rail.start, 0.0757 * np.array(rail.normal))
        near = min(
            (abs(track.start[0] - foot[0]), abs(track.start[axis] - foot[axis]))
            for track in tracks
            if np.dot(track.normal, rail.normal) > 0.99
        )
        assert near[0] < 0.06
        assert near[1] < 0.03


def test_tracks_at_45_degrees_run_along_the_four_corners_of_the_lab():
    tracks = [segment for segment in LAB.segments if " " in segment.face]
    assert len({segment.face for segment in tracks}) == 4
    for track in tracks:
        np.testing.assert_allclose(np.abs(track.normal), [0.0, 0.5**0.5, 0.5**0.5])
        for end in (track.start, track.end):
            assert np.dot(end, track.normal) == pytest.approx(-1.51, abs=0.02)
        assert abs(track.start[1] - track.end[1]) + abs(track.start[2] - track.end[2]) < 1e-9
    some = LAB.subset(np.arange(len(LAB)) % 2 == 0, "some")
    held = {some.faces[point] for point in np.unique(stance_graph(some).points)}
    assert held == set(LAB.faces)


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
