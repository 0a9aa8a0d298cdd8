"""Bounds of how far shapes move hold, and exceed the real motion at most threefold."""

import mujoco
import numpy as np
from compiled import called
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, robot_spec
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.placement import (
    Placed,
    bound_capsules,
    bound_from_grasp,
    bound_in_world,
    bound_links,
    motion_from_link,
)
from mlivr_gym.kinematics.turns import Turns
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.simulation.scene import scene_spec

ROBOT = robot_spec("mlivr2")
SHAPES = LimbShapes(ROBOT)
LINK, ENDS = SHAPES.links, SHAPES.ends
FLOOR = {"id": "R", "face": "deck", "start": [-0.4, 0, 0], "end": [0.4, 0, 0], "normal": [0, 0, 1]}
MODEL = scene_spec(GraspMap.from_dict({"segments": [FLOOR]}), ROBOT).compile()
DATA = mujoco.MjData(MODEL)
BODIES = [MODEL.body("limb0" if link == "base" else f"limb0/{link}").id for link in LINKS[:7]]
FIRST = int(MODEL.joint("limb0/joint1").qposadr[0])
LOOSE = 3.0
"""Largest ratio of a bound to the farthest motion found."""


def numbers(low, high, count=6):
    return st.lists(st.floats(low, high), min_size=count, max_size=count).map(np.array)


def turns():
    """Return changes of six joint angles, often of a few joints alone [rad]."""
    one = st.one_of(st.just(0.0), st.floats(-0.3, 0.3))
    return st.lists(one, min_size=6, max_size=6).map(np.array)


def postures(rng):
    """Return joint angles that nearly reach the bounds: arms bent in all directions in a plane."""
    right = 0.5 * np.pi * np.arange(4)
    plane = np.stack(np.meshgrid(right, right, right), axis=-1).reshape(-1, 3)
    other = rng.uniform(-np.pi, np.pi, (len(plane), 3))
    return np.column_stack([other[:, 0], plane, other[:, 1:]])


def ends_seen(q):
    """Return the ends of moving capsules seen from each of the links 0 to 6 [m], (7, c, 2, 3)."""
    DATA.qpos[FIRST : FIRST + 6] = q
    mujoco.mj_kinematics(MODEL, DATA)
    origins, axes = DATA.xpos[BODIES], DATA.xmat[BODIES].reshape(-1, 3, 3)
    world = origins[LINK][:, None] + np.einsum("cij,cej->cei", axes[LINK], ENDS)
    return np.einsum("rcei,rij->rcej", world - origins[:, None, None], axes)


def farthest(q, minus, plus, shares=(-1.0, -0.6, -0.3, 0.3, 0.6, 1.0)):
    """Return how far each end moves from the midpoint of a motion [m], shape (7, c, 2).

    Joint angles follow a parabola from `q + minus` through `q` to `q + plus`, a line where these
    are opposite.
    """
    middle, out = ends_seen(q), np.zeros((7, len(LINK), 2))
    for s in shares:
        here = q + 0.5 * s * (plus - minus) + 0.5 * s**2 * (plus + minus)
        out = np.maximum(out, np.linalg.norm(ends_seen(here) - middle, axis=3))
    return out


def turns_of(minus, plus):
    """Return the largest rotations of joints and of sums of joints on that motion."""
    out, along = Turns.row(), np.linspace(-1.0, 1.0, 401)[:, None]
    angles = 0.5 * along * (plus - minus) + 0.5 * along**2 * (plus + minus)
    for name in Turns.dtype.names:
        joints = range(int(name[1]) - 1, int(name[-1]))
        out[name] = np.abs(angles[:, list(joints)].sum(axis=1)).max()
    return out


def bounds(minus, plus):
    """Return the bound of each end's motion as seen from each of the links 0 to 4 [m], (5, c, 2).

    It is NaN for ends on that link or before it.
    """
    placed = Placed.row()
    placed["turns"], placed["fraction"] = turns_of(minus, plus), 1.0
    called(bound_links)(SHAPES.limb["arm"], placed)
    out = np.full((5, len(LINK), 2), np.nan)
    for row in range(5):
        for c in np.flatnonzero(row < LINK):
            out[row, c] = called(motion_from_link)(row, SHAPES.limb["capsules"][c], placed)
    placed["fraction"] = 0.5
    called(bound_capsules)(SHAPES.limb, placed)
    np.testing.assert_allclose(placed["in_body"]["motion"][: len(LINK)], 0.5 * out[0], rtol=1e-12)
    return out


def from_grasp(minus, plus):
    """Return the bound of each end's motion from the grasp [m], infinite if none exists, (c, 2)."""
    placed = Placed.row()
    placed["turns"] = turns_of(minus, plus)
    placed["in_world"]["motion"] = np.inf
    called(bound_from_grasp)(SHAPES.limb, placed)
    return placed["in_world"]["motion"][: len(LINK)]


@given(numbers(-np.pi, np.pi), turns(), turns(), st.booleans())
@examples(max_examples=150, deadline=None)
def test_no_end_moves_farther_than_its_bound(q, minus, plus, line):
    minus = -plus if line else minus
    found = farthest(q, minus, plus)
    limit = bounds(minus, plus)
    assert not (found[:5] > limit + 1e-12).any()
    assert (found[6] <= from_grasp(minus, plus) + 1e-12).all()


@given(turns())
@examples(max_examples=25, deadline=None)
def test_bounds_are_no_more_than_three_times_what_some_posture_needs(plus):
    """Compare with the farthest motion on lines in joint space among many postures."""
    many = postures(np.random.default_rng(0))
    found = np.max([farthest(q, -plus, plus, (1.0,)) for q in many], axis=0)
    for row, limit in enumerate(bounds(-plus, plus)):
        # Seen from the base the shoulder rotates in place.
        after = max(row, 1) < LINK
        assert limit[after].max() <= LOOSE * found[row][after].max() + 1e-9
    followed = from_grasp(-plus, plus)
    # Ends of the upper arm have a bound from the grasp only where their anchor is the elbow.
    assert np.isfinite(followed[LINK > 2]).all()
    assert np.isfinite(followed[LINK == 2]).any()
    assert followed[LINK > 2].max() <= LOOSE * found[6][LINK > 2].max() + 1e-9


@given(
    numbers(-1.0, 1.0, 3),
    st.floats(0.0, 0.2),
    st.floats(0.0, 0.3),
    st.floats(0.0, 0.05),
    st.integers(0, 999),
)
@examples(max_examples=100, deadline=None)
def test_a_moving_base_adds_no_more_than_its_bound(place, travel, swing, moved, seed):
    """An end moves by `moved` in the body frame while the base travels and rotates."""
    rng = np.random.default_rng(seed)
    placed = Placed.row()
    placed["in_body"]["ends"], placed["in_body"]["motion"] = (place, -place), moved
    called(bound_in_world)(SHAPES.limb, travel, swing, placed)
    out = placed["in_world"]["motion"][: len(SHAPES)]
    across = np.cross(place, rng.normal(size=3))
    farthest = 0.0
    for axis in (across, rng.normal(size=3)):
        axis = axis / max(np.linalg.norm(axis), 1e-12)
        for share in (0.5, 1.0):
            turn = Rotation.from_rotvec(share * swing * axis).as_matrix()
            away = turn @ place - place
            for along in (away, rng.normal(size=3)):
                length = np.linalg.norm(along)
                along = along / length if length > 1e-12 else np.array([1.0, 0.0, 0.0])
                end = place + moved * (turn.T @ along)
                gone = share * travel * along + turn @ end - place
                farthest = max(farthest, float(np.linalg.norm(gone)))
    assert farthest <= out.min() + 1e-12
    assert out.max() <= LOOSE * farthest + 1e-9
