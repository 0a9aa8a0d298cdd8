"""The shapes of limbs: where MuJoCo has them, what Coal measures, and which are not compared."""

import itertools
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from coal_ruler import Ruler, behind, mujoco_pairs
from compiled import called
from scipy.spatial.transform import Rotation
from wrist_arms import iiwa_from_file

from mlivr_gym import Box, Capsule, robot_spec, stance_graph
from mlivr_gym.collisions.against_boxes import GraspSurface, compare_base_with_boxes
from mlivr_gym.collisions.against_robot import (
    compare_limb_with_body,
    compare_limb_with_itself,
    compare_limbs,
)
from mlivr_gym.collisions.allowed_collisions import (
    ALLOWED_COLLISIONS,
    ANY,
    BOXES,
    OTHER,
    SAME,
)
from mlivr_gym.collisions.always_close import always_close_links
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.contacts import capsule_ends, contacts
from mlivr_gym.collisions.distances import CLEAR, OBSTACLE, SELF, segments_distance
from mlivr_gym.collisions.joint_lines import BaseMove, LimbPlace
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.placement import Shapes
from mlivr_gym.compiled.bit_sets import EVERY
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.simulation.scene import scene_spec, set_configuration

ROBOT = robot_spec("mlivr2")
SHAPES = LimbShapes(ROBOT)


def test_capsules_lie_where_mujoco_has_them(jem):
    model = scene_spec(jem, ROBOT).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(5):
        turn = Rotation.random(None, rng).as_quat(scalar_first=True)
        here = (
            rng.uniform(-1, 1, 3),
            turn if turn[0] > 0 else -turn,
            rng.uniform(-np.pi, np.pi, (2, 6)),
        )
        set_configuration(model, data, *here)
        ends = capsule_ends(ROBOT, SHAPES, here)
        for i in range(2):
            for c, name in enumerate(SHAPES.names):
                geom = model.geom(f"limb{i}/{name}/0").id
                axis = data.geom_xmat[geom].reshape(3, 3)[:, 2] * model.geom_size[geom, 1]
                found = np.stack([data.geom_xpos[geom] - axis, data.geom_xpos[geom] + axis])
                order = np.argsort(np.linalg.norm(found - ends[i, c, 0], axis=1))
                np.testing.assert_allclose(found[order], ends[i, c], atol=1e-7)
                assert model.geom_size[geom, 0] == pytest.approx(SHAPES.radii[c])


def test_the_plain_definition_measures_what_coal_measures():
    """All pairs of shapes closer than 0.3 m are found, a rotated box among them, and no others."""
    rng, ruler = np.random.default_rng(6), Ruler(ROBOT)
    met = set()
    for _ in range(40):
        turn = Rotation.random(None, rng).as_quat(scalar_first=True)
        here = (rng.uniform(-1.0, 1.0, 3), turn, rng.uniform(-3.0, 3.0, (2, 6)))
        axes = Rotation.random(None, rng).as_matrix()
        half = tuple(rng.uniform(0.01, 0.3, 3))
        middle = tuple(here[0] + rng.normal(0.0, 0.25, 3))
        box = Box("box", "obstacle", middle, half, Box.rows(axes))
        found = contacts(ROBOT, (box,), here, 0.3)
        ours = {frozenset((c.first, c.second.removeprefix("box/"))): c.distance for c in found}
        theirs = ruler.among([box]).measured(here, below=0.3)
        assert {frozenset(pair) for _, *pair in theirs} == set(ours)
        for gap, *pair in theirs:
            if gap > 1e-6:
                assert ours[frozenset(pair)] == pytest.approx(gap, abs=1e-6)
                met |= {name for name in pair if "box" in pair}
            else:
                assert ours[frozenset(pair)] <= 1e-6
    assert {"body", "limb0/base/0", "limb1/forearm/0"} <= met


def test_at_a_grasp_a_gripper_may_come_close_to_what_coal_leaves_out_too():
    """The farthest corner of rotated boxes at the gripper protrudes a little, or not."""
    rng, ruler, left_out = np.random.default_rng(7), Ruler(ROBOT), 0
    for k in range(60):
        turn = Rotation.random(None, rng).as_quat(scalar_first=True)
        here = (rng.uniform(-1.0, 1.0, 3), turn, rng.uniform(-3.0, 3.0, (2, 6)))
        place = capsule_ends(ROBOT, SHAPES, here)[0, -1].mean(axis=0)
        normal, axes = (Rotation.random(None, rng).as_matrix() for _ in range(2))
        box = Box("box", "obstacle", tuple(place), tuple(rng.uniform(0.01, 0.2, 3)), Box.rows(axes))
        highest = np.abs(normal[0] @ axes) @ box.half
        grasp = 0, place + (highest + (-0.001, -0.003)[k % 2]) * normal[0], normal[0]
        left_out += behind(box, *grasp[1:])
        found = contacts(ROBOT, (box,), here, 0.05, [grasp])
        theirs = ruler.among([box]).measured(here, [grasp], below=0.05)
        ours = {frozenset((c.first, c.second.removeprefix("box/"))) for c in found}
        assert ours == {frozenset(pair) for _, *pair in theirs}
    assert left_out == 30


def test_links_that_are_not_compared_never_meet():
    """No posture brings uncompared links two joints apart closer than touching."""
    pairs = [(row.first, row.second) for row in ALLOWED_COLLISIONS if row.checked]
    left_out = {tuple(sorted(map(LINKS.index, pair))) for pair in pairs}
    compared = {tuple(SHAPES.links[[i, j]].tolist()) for i, j in SHAPES.pairs}
    rng = np.random.default_rng(1)
    least = dict.fromkeys(left_out, np.inf)
    for _ in range(3000):
        here = (np.zeros(3), np.array([1.0, 0, 0, 0]), rng.uniform(-np.pi, np.pi, (2, 6)))
        ends = capsule_ends(ROBOT, SHAPES, here)[0]
        for i, j in itertools.combinations(range(len(SHAPES)), 2):
            pair = tuple(SHAPES.links[[i, j]].tolist())
            if pair in left_out and pair not in compared:
                gap = segments_distance(
                    tuple(ends[i, 0]),
                    tuple(ends[i, 1] - ends[i, 0]),
                    tuple(ends[j, 0]),
                    tuple(ends[j, 1] - ends[j, 0]),
                )
                least[pair] = min(least[pair], gap - SHAPES.radii[i] - SHAPES.radii[j])
    assert min(least.values()) > 0.0


def test_what_moves_with_the_base_contains_body_and_mounts():
    """A box of 1 mm anywhere in the body or a mount is reported; one 22 cm away is not."""
    robot, rng = robot_spec("mlivr3"), np.random.default_rng(0)
    shapes = LimbShapes(robot)
    mounts, radius = shapes.mounts["ends"], shapes.mounts["radius"]
    half, origin = shapes.robot["half"], pose(np.zeros(3), np.eye(3))

    def answer(point):
        speck = Box("speck", "obstacle", tuple(point), (5e-4, 5e-4, 5e-4))
        grid, rests, nothing = box_grid((speck,)), BaseMove.row(), GraspSurface.row()
        return called(compare_base_with_boxes)(shapes.robot, origin, rests, 0.0, grid, 0.0, nothing)

    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half
    inside = [*corners, *rng.uniform(-half, half, (200, 3))]
    for m in range(len(mounts)):
        share, out = rng.uniform(size=(50, 1)), rng.normal(size=(50, 3))
        out *= radius[m] * rng.uniform(size=(50, 1)) / np.linalg.norm(out, axis=1, keepdims=True)
        inside += [*(mounts[m, 0] + share * (mounts[m, 1] - mounts[m, 0]) + out)]
    assert all(answer(point) == OBSTACLE for point in inside)
    outside = rng.normal(size=(200, 3))
    outside *= 0.22 / np.linalg.norm(outside, axis=1, keepdims=True)
    assert all(answer(point) == CLEAR for point in outside)


CLEARANCE = 0.02


def with_balls(gap):
    """Two UR5e with a ball on axis 4 and one at the wrist point, whose surfaces are a gap apart."""
    robot = robot_spec("mlivr2")
    # The lengths a3, d4 and d5 of the maker's DH table.
    radius = 0.5 * (np.hypot(0.1333, 0.0997) - gap)
    elbow, here = (-0.3922, 0.0, 0.0), (0.0, 0.0, 0.0)
    balls = Capsule("forearm", elbow, elbow, radius), Capsule("wrist_2", here, here, radius)
    return replace(robot, capsules=balls)


@pytest.mark.parametrize(("gap", "pairs"), [(0.0199, (("forearm", "wrist_2"),)), (0.0201, ())])
def test_balls_about_joint_axes_are_close_at_every_angle_or_at_none(gap, pairs):
    robot = with_balls(gap)
    assert always_close_links(robot, CLEARANCE) == pairs
    assert always_close_links(replace(robot, apart=(("forearm", "wrist_2"),)), CLEARANCE) == ()


@pytest.mark.parametrize("name", ["mlivr2", "mlivr2-ur3e", "mlivr2-iiwa", "mlivr3", "ssrms2"])
def test_robots_that_ship_have_none(name):
    assert always_close_links(robot_spec(name), CLEARANCE) == ()


def test_a_robot_without_a_stance_is_told_which_links_and_what_would_help(small_map):
    words = (
        r"touch the robot itself: forearm and wrist_2 of a limb are within 0.02 m of each other in "
        r"every posture; give a smaller clearance, .* or apart=\[\('forearm', 'wrist_2'\)\] "
        r"\(--allow-touching\)"
    )
    with pytest.raises(RobotError, match=words) as caught:
        stance_graph(small_map, with_balls(0.0))
    assert "\n" not in str(caught.value)
    robot = replace(with_balls(0.0), apart=(("forearm", "wrist_2"),))
    assert len(stance_graph(small_map, robot)) > 0


FAT = {"base": 2.5, "shoulder": 1.0}


def fat(robot):
    """Return a robot whose capsules are so thick that only joints separate its links."""
    shapes = tuple(
        replace(c, radius=FAT.get(c.link, 2.0) * c.radius) for c in robot.mounted[0].capsules
    )
    return replace(robot, name="fat", capsules=shapes)


ROBOTS = [robot_spec("mlivr3"), fat(robot_spec("mlivr3")), iiwa_from_file(0.0)]


def left_out(robot):
    """Return the pairs of links that the table omits, and whether they belong to one limb."""
    checked = robot.name in ("mlivr2", "mlivr3")
    rows = [
        row for row in ALLOWED_COLLISIONS if row.whose != BOXES and (checked or not row.checked)
    ]
    found = set()
    for row in rows:
        pair = tuple(sorted((row.first, row.second)))
        found |= {(*pair, whose) for whose in (SAME, OTHER) if row.whose in (whose, ANY)}
    return {entry for entry in found if "body" not in entry or entry[2] == SAME}


def shaped(robot, pairs):
    """Return those of some pairs of which the robot has shapes."""
    there = {"body", *(shape.link for shape in robot.mounted[0].capsules)}
    return {pair for pair in pairs if {*pair[:2]} <= there}


def every_pair():
    """Return all pairs of links, of one limb and of two, and of the body with each link."""
    links = list(itertools.combinations_with_replacement(sorted(LINKS), 2))
    return {(*pair, whose) for pair in links for whose in (SAME, OTHER)} | {
        (*sorted(("body", link)), SAME) for link in LINKS
    }


def compared_by_name(names):
    """Return pairs of links from pairs of names like `limb0/forearm/0` and `body`."""
    found = set()
    for pair in names:
        (limb, *first), (other, *second) = (name.split("/") for name in pair)
        links = sorted(rest[0] if rest else "body" for rest in (first, second))
        found.add((*links, SAME if "body" in links or limb == other else OTHER))
    return found


def compared_by_kernels(robot):
    """Return the pairs that a kernel reports when they, and no other shapes, overlap."""
    shapes = LimbShapes(robot)
    count, still = len(shapes), LimbPlace.row()
    lonely = np.empty((count, 2, 3))
    lonely[:] = 10.0 * np.arange(1, count + 1)[:, None, None]

    def at(ends):
        out = Shapes.row()
        out["ends"][:count] = ends
        return out

    def against_own(ends, row=shapes.robot):
        """A limb against itself, the body and the mounts."""
        limb, here = row["limbs"][0], at(ends)
        still["in_body"] = here
        itself, _ = called(compare_limb_with_itself)(limb, still, EVERY, 0.0)
        return max(itself, called(compare_limb_with_body)(row, limb, here, EVERY, 0.0)[0])

    assert against_own(lonely) == CLEAR
    found = set()
    for a, b in itertools.combinations(range(count), 2):
        ends = lonely.copy()
        ends[b] = ends[a]
        if against_own(ends) == SELF:
            found.add((*sorted((shapes.names[a], shapes.names[b])), SAME))
    mounts, half = shapes.mounts["ends"], shapes.robot["half"]
    for c, name in enumerate(shapes.names):
        places = {("body", SAME): [0.0, 0.0, half[2]]} | {
            ("base", SAME if m == 0 else OTHER): 2.0 * mounts[m, 1] for m in range(robot.limbs)
        }  # fmt: skip
        for (other, whose), place in places.items():
            ends = lonely.copy()
            ends[c] = np.array(place)
            thin = shapes.rows.copy()[0]
            thin["limbs"][0]["capsules"]["radius"] = 0.01 if other == "body" else 0.14
            if other == "body":
                thin["mounts"]["radius"] = 1e-3
            if against_own(ends, thin) == SELF:
                found.add((*sorted((other, name)), whose))
        for d, other in enumerate(shapes.names):
            away = lonely + 1000.0
            away[d] = lonely[c]
            limbs = shapes.limb, at(lonely), shapes.robot["limbs"][1], at(away)
            if called(compare_limbs)(*limbs, EVERY, 0.0)[0] == SELF:
                found.add((*sorted((name, other)), OTHER))
    return found


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_the_kernels_leave_out_what_the_table_says(robot):
    found = every_pair() - compared_by_kernels(robot)
    assert shaped(robot, found) == shaped(robot, left_out(robot))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_mujoco_leaves_out_what_the_table_says(ladder, robot):
    box = Box.between("crate", "obstacle", (1.0, 1.0, 1.0), (2.0, 2.0, 2.0))
    pairs = mujoco_pairs(scene_spec(ladder, robot, (box,)).compile())
    shapes = {pair for pair in pairs if all(name.startswith(("body", "limb")) for name in pair)}
    assert shaped(robot, every_pair() - compared_by_name(shapes)) == shaped(robot, left_out(robot))
    links = {shape.link for shape in robot.mounted[0].capsules}
    names = {f"limb{i}/{link}/0" for i in range(robot.limbs) for link in links} | {"body"}
    with_box = {pair for pair in pairs if "box/crate" in pair}
    assert {name for pair in with_box for name in pair if name != "box/crate"} == names
