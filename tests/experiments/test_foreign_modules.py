"""The trial with published modules: points of a table, and tracks that are found in a mesh."""

import foreign_modules
import numpy as np
import trimesh

from mlivr_gym import GraspMap
from mlivr_gym.world.grasp_map import as_map


def test_points_of_the_table_are_those_of_the_map_that_ships(tmp_path):
    """Two ways from the same publication: a table of points, and bars that carry points."""
    (tmp_path / "handrails.csv").write_text(foreign_modules.handrail_table())
    made, lab = GraspMap.load(tmp_path / "handrails.csv"), as_map("uslab")
    held = np.array([face == "handrails" for face in lab.faces])
    assert made.ids == tuple(np.array(lab.ids)[held].tolist())
    np.testing.assert_allclose(made.positions, lab.positions[held], atol=1e-4)
    np.testing.assert_allclose(made.rotations, lab.rotations[held], atol=1e-4)


def test_tracks_are_found_by_their_size_and_left_out_of_the_mesh():
    """A track on the deck and one on a side, among a floor and a rod along the module."""
    size, wide = foreign_modules.TRACK[0], 0.025
    floor = trimesh.creation.box((4.0, 2.0, 0.1), np.eye(4))
    floor.apply_translation([0.0, 0.0, -1.2])
    deck, side = (trimesh.creation.box(edges) for edges in ((wide, size, wide), (wide, wide, size)))
    deck.apply_translation([1.0, 0.0, -1.0])
    side.apply_translation([1.0, 1.1, 0.0])
    rod = trimesh.creation.box((size, wide, wide))
    parts = [floor, deck, rod, side]
    first, second = foreign_modules.tracks_of(parts)
    np.testing.assert_allclose(first["start"], [1.0, -0.5 * size, -1.0 + 0.5 * wide])
    np.testing.assert_allclose(second["end"], [1.0, 1.1 - 0.5 * wide, 0.5 * size])
    assert (first["normal"], second["normal"]) == ([0.0, 0.0, 1.0], [0.0, -1.0, 0.0])
    rest = foreign_modules.without(parts, [first, second])
    assert len(rest.split()) == 2
