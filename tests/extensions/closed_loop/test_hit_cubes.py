"""What was seen is forgotten once it is gone, and only then."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym.extensions.closed_loop.hit_cubes import CAUTIONS, CUBE, FREEING_LOOKS, HitCubes

NOISE = 0.003
ORIGIN, SHAPE = np.full(3, -1.5), (60, 60, 60)
BEHIND = 4.0
"""Distance at which a ray ends that hits nothing before."""


class Thing:
    """A box or an ellipsoid, in its own frame a cube or a ball of half length 1."""

    def __init__(self, half, turn, is_box, centre=(0.0, 0.0, 0.0)):
        self.half, self.turn, self.is_box = np.array(half), turn, is_box
        self.centre = np.array(centre)

    def distances(self, origin, rays):
        """Distance along each ray at which it enters the thing; infinite if it does not."""
        begin = (origin - self.centre) @ self.turn / self.half
        along = rays @ self.turn / self.half
        if self.is_box:
            planes = np.stack([(-1.0 - begin) / along, (1.0 - begin) / along])
            enter, leave = planes.min(axis=0).max(axis=1), planes.max(axis=0).min(axis=1)
            return np.where((enter < leave) & (enter > 0.0), enter, np.inf)
        a, b, c = np.sum(along**2, axis=1), along @ begin, begin @ begin - 1.0
        root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
        return np.where((b**2 > a * c) & (b < 0.0), (-b - root) / a, np.inf)

    def surface(self, rng, count):
        """Random points on the surface."""
        on = rng.normal(size=(count, 3))
        norm = np.abs(on).max(axis=1) if self.is_box else np.linalg.norm(on, axis=1)
        return on / norm[:, None] * self.half @ self.turn.T + self.centre


def look(cubes, things, origins, rng, pixels=60):
    """Look from some places at the origin of the frame; return the number of freed cubes."""
    hits, begins = [], []
    for origin in origins:
        axis = -origin / np.linalg.norm(origin)
        side = np.cross(axis, [0.3, 0.5, 0.8])
        side /= np.linalg.norm(side)
        u, v = np.meshgrid(*[np.linspace(-1.0, 1.0, pixels)] * 2)
        rays = axis + u.reshape(-1, 1) * side + v.reshape(-1, 1) * np.cross(axis, side)
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        each = [thing.distances(origin, rays) for thing in things]
        distance = np.minimum(np.min(each, axis=0), BEHIND) if each else np.full(len(rays), BEHIND)
        distance = distance + NOISE * rng.standard_normal(len(rays))
        hits.append(origin + distance[:, None] * rays)
        begins.append(np.broadcast_to(origin, rays.shape))
    hits, begins = np.concatenate(hits), np.concatenate(begins)
    cells = np.floor((hits - ORIGIN) / CUBE).astype(int)
    inside = ((cells >= 0) & (cells < SHAPE)).all(axis=1)
    cubes.count(hits[inside], cells[inside])
    freed = cubes.see_through(hits, begins)
    cubes.find_solid(2)
    return freed


def places(rng, count):
    """Random places about the origin, from where its surroundings are seen."""
    away = rng.normal(size=(count, 3))
    return away / np.linalg.norm(away, axis=1)[:, None] * rng.uniform(0.7, 1.4, (count, 1))


def covered(cubes, points, margin=0.03):
    """Share of points that are within a margin of boxes of the cubes."""
    boxes = cubes.boxes_of(cubes.is_solid, cubes.is_solid, CAUTIONS[-1])
    apart = [
        np.linalg.norm(np.maximum(np.abs(points - np.array(b.centre)) - b.half, 0.0), axis=1)
        for b in boxes
    ]
    return np.mean(np.min(apart, axis=0) <= margin) if boxes else 0.0


@pytest.mark.parametrize("is_box", [True, False])
def test_a_thing_is_believed_as_long_as_it_is_there(is_box):
    """Whoever moves about it, at any angle, and whoever stands still and sees little of it."""
    rng, cubes = np.random.default_rng([0, is_box]), HitCubes(ORIGIN, SHAPE, NOISE)
    turn = Rotation.random(random_state=0).as_matrix()
    thing = Thing(rng.uniform(0.05, 0.35, 3), turn, is_box)
    points = thing.surface(rng, 3000)
    for _ in range(10):
        look(cubes, [thing], places(rng, 4), rng)
    before = covered(cubes, points)
    assert before > 0.97
    freed, still = 0, places(rng, 4)
    for k in range(60):
        freed += look(cubes, [thing], places(rng, 3), rng, pixels=20 + k % 40)
    for _ in range(2 * FREEING_LOOKS):
        freed += look(cubes, [thing], still, rng, pixels=16)
    # Noise puts a few hits into cubes beside those of the surface.
    assert freed <= 0.01 * cubes.is_solid.sum()
    assert covered(cubes, points) >= before - 0.002

    # Another thing hides it, or nobody looks at it: it is still believed when it has gone.
    count = int(cubes.is_solid.sum())
    screen = Thing(thing.half + 0.02, turn, True)
    for _ in range(5 * FREEING_LOOKS):
        away = places(rng, 4)
        assert look(cubes, [screen], 1.4 * away / np.linalg.norm(away, axis=1)[:, None], rng) == 0
        assert look(cubes, [], [np.array([3.0, 3.0, 3.0])], rng, pixels=2) == 0
    assert int(cubes.is_solid.sum()) >= count

    # It has gone, and so has the screen.
    freed = sum(look(cubes, [], places(rng, 4), rng) for _ in range(10 * FREEING_LOOKS))
    assert freed > 0.95 * count
    assert covered(cubes, points, margin=0.0) < 0.02


def test_a_grille_is_believed_though_rays_pass_between_its_rods():
    rng, cubes = np.random.default_rng(7), HitCubes(ORIGIN, SHAPE, NOISE)
    rods = [
        Thing((0.3, 0.008, 0.008), np.eye(3), True, (0.0, y, 0.0))
        for y in np.arange(-0.2, 0.21, 0.04)
    ]
    points = np.concatenate([rod.surface(rng, 300) for rod in rods])
    for _ in range(10):
        look(cubes, rods, places(rng, 4), rng)
    before = covered(cubes, points)
    assert before > 0.97
    freed = sum(look(cubes, rods, places(rng, 3), rng) for _ in range(60))
    assert freed <= 0.01 * cubes.is_solid.sum()
    assert covered(cubes, points) >= before - 0.002


@pytest.mark.parametrize("caution", CAUTIONS)
def test_a_box_extends_by_its_margin_beyond_the_hits(caution):
    """Less what noise adds to their extent: the mean of the largest of so many normal numbers."""
    rng, cubes = np.random.default_rng(2), HitCubes(ORIGIN, SHAPE, NOISE)
    count = 40
    hits = np.array([0.3, 0.0, -0.2]) + CUBE * rng.uniform(0.1, 0.9, (count, 3))
    cells = np.floor((hits - ORIGIN) / CUBE).astype(int)
    assert (cells == cells[0]).all()
    cubes.count(hits, cells)
    cubes.find_solid(caution.hits)
    (box,) = cubes.boxes_of(cubes.is_solid, cubes.is_solid, caution)
    beyond = np.concatenate([hits.min(axis=0) - box.bounds[0], box.bounds[1] - hits.max(axis=0)])
    largest = rng.standard_normal((20_000, count)).max(axis=1).mean()
    expected = caution.margin - caution.is_denoised * NOISE * largest
    np.testing.assert_allclose(beyond, expected, atol=1e-9 + 0.02 * NOISE * caution.is_denoised)


@pytest.mark.parametrize("margin", [0.0, 0.005, 0.01])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_cube_has_grown_by_more_than_the_margin_or_half_a_centimetre(margin, side):
    for share in (0.98, 1.02):
        cubes, middle = HitCubes(ORIGIN, SHAPE, NOISE), np.full(3, 0.5 * CUBE)
        cell = np.floor((middle[None] - ORIGIN) / CUBE).astype(int)
        cubes.count(middle[None], cell)
        cubes.rows["graph_extent"] = cubes.rows["extent"]
        assert not cubes.has_grown("graph_extent", margin).any()
        beyond = middle + side * share * max(margin, 0.005) * np.array([0.0, 1.0, 0.0])
        cubes.count(beyond[None], cell)
        assert cubes.has_grown("graph_extent", margin).tolist() == [share > 1.0]
