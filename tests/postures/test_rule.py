"""The rule that gives a stance its base pose, compared with its plain definition."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from branches import arm_of, solutions
from coal_ruler import grasps_of
from compiled import called
from oracle import at_grasp, flange, pinocchio_arm
from scipy.spatial.transform import Rotation
from stance_axes import axes_of

from mlivr_gym import Settings, State, robot_spec, stance_graph
from mlivr_gym.collisions.base_path import lift_path
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.collisions.followers import followed_branches, set_follower
from mlivr_gym.collisions.intervals import WHOLE
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.errors import RobotError, StanceError
from mlivr_gym.kinematics.manipulability import base_manipulability, limb_manipulability
from mlivr_gym.kinematics.poses import pose as pose_row
from mlivr_gym.planners import Planner
from mlivr_gym.robot.capsules import Capsule
from mlivr_gym.stances.point_pairs import count_farther

TIE = 1e-9


def choices(graph, stance, position, rotation):
    """Return the branches of each limb at a base pose.

    Each has its number, joint angles, `w_m`, and the Jacobian at the grasp in body axes.
    """
    robot, arm, out = graph.robot, pinocchio_arm(graph.robot.limb), []
    for i, point in enumerate(stance):
        mount = rotation @ robot.mount_rotations[i]
        origin = position + rotation @ robot.mount_positions[i]
        p, r = (
            mount.T @ (graph.solver.grasps[point]["flange"]["position"] - origin),
            mount.T @ graph.solver.grasps[point]["flange"]["rotation"],
        )
        (branch_sets, q), found = solutions(arm_of(robot.limb), p, r), []
        for b in range(8):
            if branch_sets >> b & 1:
                pose, jacobian = flange(arm, q[b])
                w_m = limb_manipulability(jacobian, robot.characteristic_length)
                found.append((b, q[b], w_m, at_grasp(robot, i, pose, jacobian)[0]))
        out.append(found)
    return out


def candidates(graph, stance):
    """Return margin, order, base pose, branches and joint angles of every candidate of a stance."""
    grasp_map, robot = graph.grasp_map, graph.robot
    grasps, normals = grasp_map.positions[stance], grasp_map.normals[stance]
    centre, rail = grasps.mean(axis=0), grasp_map.rotations[stance[0], :, 0]
    frame, out, line, opposed = axes_of(grasps - centre, normals, rail)
    assert not opposed
    whole, found = Settings().thresholds(robot.limbs)[1], []
    for roll, height in product(robot.rolls, robot.heights):
        turn = Rotation.from_rotvec(roll * line).as_matrix()
        position, rotation = centre + height * turn @ out, turn @ frame
        geometry = (grasps - position) @ rotation
        for limbs in product(*choices(graph, stance, position, rotation)):
            w_m = min(limb[2] for limb in limbs) / 0.1
            if w_m < 0.3:
                continue
            w_b = base_manipulability(
                np.array([limb[3] for limb in limbs]), geometry, robot.characteristic_length
            )
            labels = tuple(limb[0] for limb in limbs)
            order = (round(abs(roll), 9), roll < 0.0, height, labels[::-1])
            quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
            pose = (position, quaternion, np.array([limb[1] for limb in limbs]))
            found.append((min(w_m, w_b / whole), order, pose, labels))
    return found


def among(graph):
    """Return the clearance and boxes that postures keep; the robot never penetrates itself."""
    if graph.settings.collisions:
        return graph.settings.clearance, graph.grasp_map.boxes
    return 0.0, ()


def chosen_by_definition(graph, stance):
    """Return the posture chosen by definition, and how many candidates tied in the margin."""
    clearance, boxes = among(graph)
    grasps = grasps_of(graph, enumerate(stance))
    untried = sorted(candidates(graph, stance), key=lambda c: -c[0])
    while untried:
        tied = [c for c in untried if c[0] >= untried[0][0] * (1.0 - TIE)]
        untried = untried[len(tied) :]
        free = [c for c in tied if not contacts(graph.robot, boxes, c[2], clearance, grasps)]
        if free:
            gaps = [contacts(graph.robot, (), c[2], np.inf)[0].distance for c in free]
            best = [c for c, gap in zip(free, gaps, strict=True) if gap >= max(gaps) - 1e-9]
            return min(best, key=lambda c: c[1]), len(tied)
    return None, 0


@pytest.mark.parametrize("collisions", [False, True])
def test_the_base_pose_is_the_one_of_the_rule(graph, checked_graph, collisions):
    """Of the first two stances the order decides alone, between rolls and between branches."""
    here, rng, ties = checked_graph if collisions else graph, np.random.default_rng(7), []
    by_order = [] if collisions else [58, 18]
    for s in (*by_order, *rng.integers(0, len(here), 5)):
        stance = here.points[s]
        found = here.solver.solve(stance[None])  # not what a table that ships says
        (margin, _, pose, labels), tied = chosen_by_definition(here, stance)
        assert min(found.w_m.min() / 0.1, found.w_b[0] / 0.001) == pytest.approx(margin, rel=1e-7)
        np.testing.assert_allclose(found.base_position[0], pose[0], atol=1e-6)
        np.testing.assert_allclose(
            found.base_rotation[0],
            Rotation.from_quat(pose[1], scalar_first=True).as_matrix(),
            atol=1e-5,
        )
        assert tuple(found.branch[0]) == labels
        ties.append(tied)
    assert max(ties) > 4  # mirror postures and elbows


def test_the_base_pose_of_three_limbs_is_the_one_of_the_rule(jem):
    """Groups of combinations of branches are skipped; the best one must not be among them.

    The rule starts with the limb whose grasp is closest to the centroid, whichever it is.
    """
    graph = stance_graph(jem, "mlivr3", Settings(collisions=False))
    points = np.array(graph.indices(("D2a:2", "D2b:2", "D2b:8")))
    grasps = jem.positions[points]
    away = np.linalg.norm(grasps - grasps.mean(axis=0), axis=1)
    points = np.roll(points, -away.argmin())
    (margin, _, pose, labels), _ = chosen_by_definition(graph, points)
    for turn in range(3):
        found = graph.posture(np.roll(points, -turn))
        ours = found.w_m.min() / 0.1, found.w_b[0] / Settings().thresholds(3)[1]
        assert min(ours) == pytest.approx(margin, rel=1e-7)
        np.testing.assert_allclose(found.base_position[0], pose[0], atol=1e-6)
        assert tuple(np.roll(found.branch[0], turn)) == labels


def departing(graph, s, i, branches):
    """Return the branches and flips on which a limb can depart from its point along a path."""
    grasp, limits = graph.solver.grasps[graph.points[s, i]], graph.solver.thresholds[0]
    base = pose_row(graph.base_position[s], graph.base_rotation[s])
    lines, robot = LineScratch.row(), graph.solver.shapes.robot
    called(lift_path)(lines["line"]["path"], base, grasp, graph.robot.lift)
    lines["floor"] = float(limits["floor"]) * graph.robot.characteristic_length**3
    called(set_follower)(i, grasp["flange"], lines)
    branch_set = sum(0x101 << b for b in branches)
    return called(followed_branches)(i, branch_set, WHOLE, robot, graph.solver.boxes, lines)


def branch_sets_by_definition(graph, s):
    """Return the branches and flips on which limbs may hold: a product set grown from a posture."""
    stance, robot = graph.points[s], graph.robot
    base, axes = graph.base_position[s], graph.base_rotation[s]
    geometry = (graph.grasp_map.positions[stance] - base) @ axes
    found = [{c[0]: c for c in limb} for limb in choices(graph, stance, base, axes)]
    quaternion = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    clearance, boxes = among(graph)
    grasps = grasps_of(graph, enumerate(stance))

    def close(labels, around):
        """Limbs of pairs that are too close; None stands for body, mounts and what is around."""
        joints = np.array([limb[b][1] for limb, b in zip(found, labels, strict=True)])
        pairs = contacts(robot, around, (base, quaternion, joints), clearance, grasps)
        fixed = "body", "box", *(f"limb{i}/base" for i in range(len(found)))
        names = [(contact.first, contact.second) for contact in pairs]
        return {
            frozenset(None if one.startswith(fixed) else int(one[4]) for one in pair)
            for pair in names
        }

    def fits(labels):
        w_b = base_manipulability(
            np.array([limb[b][3] for limb, b in zip(found, labels, strict=True)]),
            geometry,
            robot.characteristic_length,
        )
        both = frozenset(range(len(found)))
        return w_b >= graph.base_threshold and both not in close(labels, ())

    first = graph.posture(tuple(stance.tolist())).branch[0].tolist()
    branch_sets, allowed = [], []
    for i, limb in enumerate(found):
        able = [b for b, choice in limb.items() if choice[2] >= graph.limb_threshold]
        branch_sets.append(departing(graph, s, i, able))
        free = [b for b in able if branch_sets[i] & 0x101 << b]
        labels = [[*first[:i], b, *first[i + 1 :]] for b in free]
        mine = ({i}, {i, None})
        alone = [not close(one, boxes) & set(map(frozenset, mine)) for one in labels]
        allowed.append([b for b, ok in zip(free, alone, strict=True) if ok])
    kept = [{b} for b in first]
    for i in range(len(found)):
        for b in allowed[i]:
            others = [kept[j] if j != i else {b} for j in range(len(found))]
            if all(fits(labels) for labels in product(*others)):
                kept[i].add(b)
    return [branch_sets[i] & sum(0x101 << b for b in kept[i]) for i in range(len(found))]


@pytest.mark.parametrize("collisions", [False, True])
def test_limbs_may_hold_on_the_branches_of_the_definition(graph, ladder, collisions):
    """Every combination meets the threshold of `w_b` and keeps the limbs apart."""
    here = stance_graph(ladder) if collisions else graph
    rng, less = np.random.default_rng(3), 0
    for s in rng.choice(len(here), 25, replace=False):
        found = here.solver.solve(here.points[[s]]).branch_sets[0]
        assert found.tolist() == branch_sets_by_definition(here, s)
        less += (here.branch_sets[s] < 0xFFFF).any()
    assert less > 5


def best_configuration(graph, s):
    branch_sets = tuple((1 << graph.branch[s]).tolist())
    return graph.configuration(State(tuple(graph.points[s].tolist()), branch_sets))


def test_the_pose_differs_with_collisions_only_where_the_rules_choice_comes_too_close(
    graph, checked_graph
):
    """Self-penetration is excluded without collision checks too."""
    at = {tuple(p): s for s, p in enumerate(graph.points.tolist())}
    rng, moved = np.random.default_rng(3), 0
    for c in rng.integers(0, len(checked_graph), 150):
        points = checked_graph.points[c]
        s = at[tuple(points.tolist())]
        same = (checked_graph.branch[c] == graph.branch[s]).all() and np.allclose(
            checked_graph.base_position[c], graph.base_position[s], atol=1e-6
        )
        grasps = grasps_of(graph, enumerate(points))
        here = best_configuration(graph, s)
        assert same == (not contacts(graph.robot, graph.grasp_map.boxes, here, 0.02, grasps))
        assert not contacts(graph.robot, (), here, 0.0, grasps)
        moved += not same
    assert 0 < moved < 75


def test_the_order_of_the_candidates_shows_in_nothing(small_map):
    """Three shuffles of heights and rolls change no stance and no plan."""
    map_ = small_map.subset(np.arange(len(small_map)) % 2 == 0, "smaller")
    rng, spec = np.random.default_rng(0), robot_spec("mlivr2")
    whole = None
    for _ in range(3):
        heights, rolls = (tuple(rng.permutation(v).tolist()) for v in (spec.heights, spec.rolls))
        graph = stance_graph(map_, replace(spec, heights=heights, rolls=rolls))
        arrays = [
            graph.points,
            graph.base_position,
            graph.base_rotation,
            graph.w_m,
            graph.branch,
            graph.branch_sets,
        ]
        result = Planner(graph).plan(graph.ids(graph.points[92]), (2.73, -0.04, -0.32), "base")
        steps = result.plan and (
            result.plan.stances,
            result.plan.steps,
            result.plan.motion.joint_positions.tolist(),
        )
        if whole is None:
            whole, walk = arrays, steps
        for first, other in zip(whole, arrays, strict=True):
            np.testing.assert_array_equal(first, other)
        assert walk == steps
    assert walk is not None
    assert len(walk[1]) > 1


def test_stances_whose_every_posture_penetrates_the_robot_are_left_out_and_named(small_map):
    """A ball on the body occupies the place of the limbs, then a body encloses their mounts."""
    settings, spec = Settings(collisions=False, manipulability=False), robot_spec("mlivr2")
    graph = stance_graph(small_map, spec, settings)
    ball = Capsule("base", (-0.3, 0.0, 0.4), (-0.3, 0.0, 0.4), 0.1)
    restricted = stance_graph(
        small_map, replace(spec, capsules=(*spec.mounted[0].capsules, ball)), settings
    )
    assert 0 < len(restricted) < len(graph)
    assert restricted.listed.counts["self"] > 0
    missing = next(
        s
        for s in graph.points.tolist()
        if restricted.find(s) < 0 and restricted.posture(s).cause[0]
    )
    with pytest.raises(StanceError, match="the robot itself"):
        restricted.state(missing)
    with pytest.raises(RobotError, match="touch the robot itself"):
        stance_graph(small_map, replace(spec, body_size=1.1), settings)


def test_what_is_left_out_without_thresholds_is_counted(small_map):
    """Compare with a second graph without the floor, and with distances."""
    settings, spec = Settings(collisions=False, manipulability=False), robot_spec("mlivr2")
    graph = stance_graph(small_map, spec, settings)
    unchecked = stance_graph(small_map, spec, replace(settings, transitions=False))
    assert graph.listed.counts["no_departure"] == len(unchecked) - len(graph) > 0
    assert unchecked.listed.counts["no_departure"] == 0
    apart = np.linalg.norm(small_map.positions[:, None] - small_map.positions[None], axis=2)
    short = replace(spec, span=1.2)
    reach = 2.0 * (0.1 + spec.limb.reach + 0.05)
    assert count_farther(small_map, short) == ((apart > 1.2 + 1e-9) & (apart <= reach)).sum()
