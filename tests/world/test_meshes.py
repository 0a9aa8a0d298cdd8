"""Boxes of a mesh cover its surface and reach no farther than the excess that is stated."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from map_data import LADDER, POINT, SEGMENT
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, stance_graph
from mlivr_gym.errors import MapError
from mlivr_gym.world.mesh_plates import cubes_of_triangles
from mlivr_gym.world.meshes import largest_excess, merged_cells, mesh_boxes

trimesh = pytest.importorskip("trimesh")

SHAPES = {
    "sphere": lambda: trimesh.creation.icosphere(2, 0.5),
    "cylinder": lambda: trimesh.creation.cylinder(0.4, 1.5),
    "plate": lambda: trimesh.creation.box((1.5, 0.9, 0.01)),
    "slivers": lambda: trimesh.Trimesh(
        np.random.default_rng(4).normal(scale=0.4, size=(15, 3)), np.arange(15).reshape(-1, 3)
    ),
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
    centres, halves, turns = (
        np.array([getattr(box, k) for box in boxes]) for k in ("centre", "half", "rotation")
    )
    points = surface(mesh, 3000, rng)
    local = np.einsum("bij,pbi->pbj", turns, points[:, None] - centres)
    inside = (np.abs(local) <= halves + 1e-6).all(axis=2)
    assert inside.any(axis=1).all()
    assert inside.sum() < 1.01 * len(points)  # no two boxes overlap
    where = rng.integers(len(boxes), size=400)
    drawn = halves[where] * rng.uniform(-1.0, 1.0, (400, 3))
    drawn = centres[where] + np.einsum("bij,bj->bi", turns[where], drawn)
    _, away, _ = trimesh.proximity.closest_point_naive(mesh, drawn)
    assert away.max() <= largest_excess(resolution)


@pytest.mark.parametrize("shape", ["sphere", "slivers"])
def test_cubes_of_triangles_are_those_in_which_something_is_left_of_them(shape):
    """Cut along the faces of a cube, by another library."""
    triangles = SHAPES[shape]().triangles[:15] * [3.0, 5.0, 8.0] + 0.1
    for triangle in triangles:
        low, high = np.floor(triangle.min(axis=0)), np.ceil(triangle.max(axis=0))
        expected = set()
        for cube in np.argwhere(np.ones((high - low).astype(int))) + low:
            left = triangle, np.array([[0, 1, 2]])
            for inward, corner in ((np.eye(3), cube), (-np.eye(3), cube + 1.0)):
                for normal in inward:
                    if len(left[1]):
                        left = trimesh.intersections.slice_faces_plane(*left, normal, corner)[:2]
            if len(left[1]):
                expected.add(tuple(cube.astype(int).tolist()))
        found = [cubes for cubes, _ in cubes_of_triangles(triangle[None])]
        assert set(map(tuple, np.concatenate(found).tolist())) == expected


@pytest.mark.parametrize("resolution", [0.07, 0.5])
def test_walls_along_the_axes_are_covered_exactly(resolution, tmp_path):
    """A rail on a floor, with a locker on it, is as free as without the mesh's floor."""
    corners = [[(-1.0, -1.0, -0.05), (2.8, 1.0, 0.0)], [(1.2, 0.61, 0.0), (1.5, 0.9, 0.4)]]
    solids = [trimesh.creation.box(bounds=one) for one in corners]
    trimesh.util.concatenate(solids).export(tmp_path / "room.stl")
    boxes = mesh_boxes(tmp_path / "room.stl", resolution)
    assert len(boxes) == 11  # the faces of two solids, of which two lie in one plane
    low, high = np.array([box.bounds for box in boxes]).transpose(1, 0, 2)
    thickness = (high - low).min(axis=1)
    assert thickness.max() < 3e-4
    faces = [(axis, one[side][axis]) for one in corners for side in (0, 1) for axis in range(3)]
    for a, b, thin in zip(low, high, (high - low).argmin(axis=1), strict=True):
        assert np.abs([0.5 * (a + b)[axis] - at for axis, at in faces if axis == thin]).min() < 1e-4
    graphs = [
        stance_graph(GraspMap.from_dict(LADDER)),
        stance_graph(GraspMap.from_mesh(tmp_path / "room.stl", resolution=resolution, **LADDER)),
    ]
    assert len(graphs[0]) == len(graphs[1])


@settings(max_examples=60, deadline=None)
@given(arrays(np.bool_, st.tuples(*[st.integers(1, 6)] * 3)))
def test_merged_cells_cover_each_marked_cell_once(touched):
    count = np.zeros(touched.shape, dtype=int)
    for first, last in merged_cells(touched):
        count[tuple(slice(a, b) for a, b in zip(first, last, strict=True))] += 1
    np.testing.assert_array_equal(count, touched)


def turned(ladder, turn, shift):
    """The segments of a map, moved by a rigid transform."""

    def move(place):
        return (turn @ np.array(place) + shift).tolist()

    return [
        segment | {
            "start": move(segment["start"]), "end": move(segment["end"]),
            "normal": (turn @ np.array(segment["normal"])).tolist(),
        }
        for segment in ladder["segments"]
    ]  # fmt: skip


@pytest.mark.parametrize("angles", [(45, 0, 0), (200, 70, -140)])
def test_rails_may_lie_on_a_tilted_panel(angles, tmp_path):
    """As many stances are left as without the panel, on which the rails lie."""
    turn = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
    shift = np.array([7.3, -4.1, 2.7])
    rails = turned(LADDER, turn, shift)
    panel = trimesh.creation.box(bounds=[(-1.0, -1.0, -0.05), (2.8, 1.0, 0.0)])
    panel.apply_transform(np.block([[turn, shift[:, None]], [np.zeros(3), 1.0]]))
    panel.export(tmp_path / "panel.stl")
    found = GraspMap.from_mesh(tmp_path / "panel.stl", segments=rails)
    assert len(found.boxes) == 6 + len(rails)
    free = stance_graph(GraspMap.from_dict({"segments": rails}))
    assert len(stance_graph(found)) == len(free) > 100


TURN = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 0, 1), (0.3, 0.1, 0.0))
BODY = {"wall": (trimesh.creation.box((1.5, 0.1, 1.0)), TURN), "ball": (SHAPES["sphere"](), None)}
"""Meshes with their places in a scene."""


@pytest.mark.parametrize("suffix", ["gltf", "obj"])
def test_each_format_gives_the_same_body(suffix, tmp_path):
    """In glTF each part is a node with a transform; STL has triangles in one frame."""
    scene = trimesh.Scene()
    for name, (mesh, place) in BODY.items():
        scene.add_geometry(mesh, node_name=name, geom_name=name, transform=place)
    whole = scene.to_mesh()
    whole.export(tmp_path / "body.stl")
    given = scene if suffix in ("glb", "gltf") else whole
    path = tmp_path / f"body.{suffix}"
    if suffix == "gltf":
        for name, content in given.export(file_type="gltf").items():
            path.with_name("body.gltf" if name == "model.gltf" else name).write_bytes(content)
    else:
        given.export(path)
    made = [
        [box.bounds for box in GraspMap.from_mesh(one, points=[POINT], resolution=0.07).boxes]
        for one in (tmp_path / "body.stl", path)
    ]
    assert len(made[0]) == len(made[1])
    np.testing.assert_allclose(made[0], made[1], atol=3e-4)


def test_rails_on_a_mesh_are_a_map_in_one_call(tmp_path):
    trimesh.creation.box((2.0, 2.0, 0.1)).export(tmp_path / "panel.obj")
    entries = {"segments": LADDER["segments"][:1], "spacing": 0.4, "cabin": LADDER["cabin"]}
    found = GraspMap.from_mesh(tmp_path / "panel.obj", scale=0.5, **entries)
    data = {"mesh": {"file": str(tmp_path / "panel.obj"), "scale": 0.5}}
    assert found == GraspMap.from_dict(entries | data, name="panel")
    assert found.ids == ("R0:0", "R0:1", "R0:2")
    found.save(tmp_path / "map.json")
    assert GraspMap.load(tmp_path / "map.json") == found  # without the mesh's file
    scaled = {"segments": [SEGMENT | {"end": [0, 1, 400], "start": [0, 1, 0]}], "unit": "mm"}
    for options in ({}, {"resolution": 50.0}):
        other = GraspMap.from_mesh(tmp_path / "panel.obj", scale=0.5, **scaled, **options)
        assert other.boxes[:6] == found.boxes[:6]


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
    low, high = np.array([box.bounds for box in found.boxes]).transpose(1, 0, 2)
    np.testing.assert_allclose(low.min(axis=0), [-1.0, -0.5, -0.005], atol=2e-4)
    np.testing.assert_allclose(high.max(axis=0), [1.0, 0.5, 0.005], atol=2e-4)
    data["mesh"].pop("scale")
    path.write_text(json.dumps(data))
    with pytest.raises(MapError, match=r"2000 m long.*0\.001"):
        GraspMap.load(path)


GLTF = {
    "asset": {"version": "2.0"}, "buffers": [{"uri": "gone.bin", "byteLength": 12}],
    "bufferViews": [{"buffer": 0, "byteLength": 12}], "scenes": [{"nodes": []}],
}  # fmt: skip
CORNERS = "v 0 0 0\nv 20 0 0\nv 0 20 0\n"
SECOND = "v {} 1 1\nf 1 2 3\nf 2 3 4\n"
"""A triangle after a sound one."""


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("part.step", "x", "has the suffix '.step'; valid ones are .glb, .gltf, .obj, .ply, .stl$"),
        ("part.obj", "v 1 2\nf 1 2 3", "it is no OBJ file of triangles, or damaged$"),
        ("part.gltf", json.dumps(GLTF), "it names the file 'gone.bin', which is missing$"),
        ("part.obj", CORNERS + SECOND.format("nan"), "a corner that is not finite"),
        ("part.obj", CORNERS + SECOND.format("inf"), "a corner that is not finite"),
        ("part.obj", CORNERS + SECOND.format(1), "larger resolution"),
    ],
)
def test_a_file_that_makes_no_boxes_is_told_in_one_line(name, content, words, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(MapError, match=words) as error:
        mesh_boxes(tmp_path / name, resolution=0.001)
    assert "\n" not in str(error.value)
    assert name in str(error.value)
