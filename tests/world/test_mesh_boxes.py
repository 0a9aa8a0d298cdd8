"""Boxes of a mesh cover its surface and reach no farther than the excess that is stated."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mlivr_gym import GraspMap
from mlivr_gym.errors import MapError
from mlivr_gym.world.mesh_boxes import largest_excess, merged_cells, mesh_boxes

trimesh = pytest.importorskip("trimesh")

SHAPES = {
    "sphere": lambda: trimesh.creation.icosphere(2, 0.5),
    "cylinder": lambda: trimesh.creation.cylinder(0.4, 1.5),
    "plate": lambda: trimesh.creation.box((1.5, 0.9, 0.01)),
}


def surface(mesh, count, rng):
    """Points of a surface, drawn by area without the library's help."""
    a, b, c = np.swapaxes(mesh.triangles, 0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    rows = rng.choice(len(a), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    return a[rows] + u * (b - a)[rows] + v * (c - a)[rows]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", [0, 1])
def test_they_cover_the_surface_and_little_more(shape, seed, tmp_path):
    rng, resolution = np.random.default_rng(seed), 0.07
    mesh = SHAPES[shape]()
    if seed:
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    mesh.export(tmp_path / "part.stl")
    boxes = mesh_boxes(tmp_path / "part.stl", resolution)
    centres, halves = (np.array([getattr(box, k) for box in boxes]) for k in ("centre", "half"))
    points = surface(mesh, 3000, rng)
    inside = (np.abs(points[:, None] - centres) <= halves + 1e-6).all(axis=2)
    assert inside.any(axis=1).all()
    assert inside.sum() < 1.01 * len(points)  # no two boxes overlap
    where = rng.integers(len(boxes), size=400)
    drawn = centres[where] + halves[where] * rng.uniform(-1.0, 1.0, (400, 3))
    _, away, _ = trimesh.proximity.closest_point_naive(mesh, drawn)
    assert away.max() <= largest_excess(resolution)


@settings(max_examples=60, deadline=None)
@given(arrays(np.bool_, st.tuples(*[st.integers(1, 6)] * 3)))
def test_merged_cells_cover_each_marked_cell_once(touched):
    count = np.zeros(touched.shape, dtype=int)
    for first, last in merged_cells(touched):
        count[tuple(slice(a, b) for a, b in zip(first, last, strict=True))] += 1
    np.testing.assert_array_equal(count, touched)


def test_a_map_names_a_mesh_beside_it(tmp_path):
    mesh = trimesh.creation.box((2000.0, 1000.0, 10.0))
    mesh.export(tmp_path / "panel.stl")
    data = {
        "points": [
            {"id": "A", "face": "f", "position": [0, 0, 1], "normal": [0, 0, 1], "rail": [1, 0, 0]}
        ],
        "mesh": {"file": "panel.stl", "scale": 0.001, "resolution": 0.1},
    }
    path = tmp_path / "map.json"
    path.write_text(json.dumps(data))
    found = GraspMap.load(path)
    assert len(found.boxes) == 1
    np.testing.assert_allclose(found.boxes[0].centre, [0.0, 0.0, 0.0], atol=0.1)
    low, high = found.boxes[0].bounds
    assert (low <= [-1.0, -0.5, -0.005]).all()
    assert (high >= [1.0, 0.5, 0.005]).all()
    data["mesh"].pop("scale")
    path.write_text(json.dumps(data))
    with pytest.raises(MapError, match=r"2000 m long.*0\.001"):
        GraspMap.load(path)


@pytest.mark.parametrize(
    ("content", "options", "match"),
    [
        (None, {}, "cannot read mesh"),
        (b"no mesh at all", {}, "mesh"),
        ("large", {"resolution": 0.001}, "larger resolution"),
        ("tilted", {"resolution": 0.01}, "larger resolution"),
    ],
)
def test_a_fault_is_one_line(tmp_path, content, options, match):
    path = tmp_path / "part.stl"
    if content == "large":
        trimesh.creation.box((20.0, 20.0, 20.0)).export(path)
    elif content == "tilted":
        mesh = trimesh.creation.icosphere(3, 0.8)
        mesh.export(path)
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(MapError, match=match) as error:
        mesh_boxes(path, **options)
    assert "\n" not in str(error.value)
