"""The maps that ship beside the JEM, against the published figures, and their names."""

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym import jem_map, stance_graph
from mlivr_gym.errors import MapError
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


@pytest.mark.parametrize("name", ["kibo", "Truss", "trus"])
def test_a_wrong_name_is_refused_with_the_names(name):
    with pytest.raises(
        MapError,
        match=f"unknown map '{name}'; valid names are jem, truss, uslab, columbus, hatch, station",
    ):
        stance_graph(name)
    with pytest.raises(
        MapError, match="valid names are jem, truss, uslab, columbus, hatch, station"
    ):
        gymnasium.make("mlivr_gym:MLIVR-JEM-v0", map=name)


def test_a_file_that_is_missing_is_refused_as_before():
    with pytest.raises(MapError, match="cannot read map"):
        as_map("missing.json")


def test_a_file_in_the_folder_may_have_any_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    jem_map().save("ladder")
    assert as_map("ladder").fingerprint == jem_map().fingerprint


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
    assert len(LAB.segments) == 14
    low, high = LAB.cabin
    rails = {segment.id: segment for segment in LAB.segments}
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


@pytest.mark.parametrize("name", ["MLIVR-USLab-v0", "MLIVR-Truss-v0"])
def test_an_environment_of_the_place_follows_its_mask(name):
    env = gymnasium.make(f"mlivr_gym:{name}")
    _, info = env.reset(seed=0)
    for _ in range(3):
        action = int(np.flatnonzero(info["action_mask"])[-1])
        _, _, terminated, _, info = env.step(action)
        assert not info["invalid_action"]
        if terminated:
            break
