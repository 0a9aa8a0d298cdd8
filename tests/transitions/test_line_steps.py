"""Steps of two limbs on lines of their support, by their plain definition and at samples."""

from collections import Counter

import numpy as np
import pytest
from coal_ruler import Ruler, grasps_of
from compiled import called
from joint_lines import configurations
from paper import NO_COLLISIONS
from plain_checks import PlainChecks, branch_set_of, members
from plain_line_steps import PlainLineStep, codes_of
from random_steps import asked, two_stances
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, stance_graph
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.compiled.bit_sets import ALL, code_of
from mlivr_gym.robot.link_frames import rigid
from mlivr_gym.transitions.line_steps import ON_LINE, check_all_alone
from mlivr_gym.transitions.records import (
    STORED_ALONE,
    STORED_FIRST,
    StepContext,
    StepRecord,
    StepScratch,
)

SHARES = np.linspace(0.0, 1.0, 41)


def checked(graph, stances, limb, wanted=ALL, ends=(0, 1), world=None, known=None, recheck=0):
    """A step between two stances, checked; `known` is the same step as it was found before."""
    steps = StepRecord.rows(1) if known is None else known.copy().reshape(1)
    steps["limb"], steps["before"], steps["after"] = limb, *ends
    steps["branches"][0, 1 - limb], steps["recheck"] = wanted, recheck
    context = StepContext(stances, graph.checks.robots, world or graph.checks.world(None))
    check_all_alone(0, 1, steps, context, StepScratch.rows(1))
    return steps[0]


def swing_codes(step):
    """The code of the swing of each branch that is kept."""
    kept = {b for b, _ in members(step["kept"][1 - step["limb"]])}
    return {b: int(called(code_of)(int(step["swings"]), b)) for b in kept}


def random_steps(graph, seed, count):
    """Limb that moves, points after the step, and the stances with their releases."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        limb, before, after = two_stances(graph, rng)
        stances, *_ = asked(graph, limb, before, after, [ALL, ALL], False)
        yield rng, limb, after, stances


def test_holds_that_an_edge_keeps_are_those_of_the_plain_definition(small_checked_graph):
    """Of every second step the limb that moves has no fold at both stances."""
    kinds = Counter()
    for n, (rng, limb, _, stances) in enumerate(random_steps(small_checked_graph, 0, 24)):
        wanted = int(rng.integers(1, ALL + 1))
        if n % 2:
            stances.releases["folds"] = 0
        step = checked(small_checked_graph, stances, limb, wanted)
        plain = PlainChecks(small_checked_graph, stances)
        there = members(wanted & int(stances.branch_sets[1, 1 - limb]))
        releases = [plain.release(s, limb) for s in (0, 1)]
        if n % 2:
            releases = [release._replace(folds=set()) for release in releases]
        kept, line = PlainLineStep(plain, limb, 0, 1).check(there, *releases)
        assert members(step["kept"][1 - limb]) == set(kept)
        assert step["line_branches"] == line
        assert swing_codes(step) == codes_of(kept)
        kinds["none"] += not kept
        kinds["line"] += ON_LINE in kept.values()
        kinds["fold"] += bool(kept) and min(kept.values()) < ON_LINE
    assert min(kinds[kind] for kind in ("none", "line", "fold")) > 0


def test_holds_are_looked_at_each_on_its_own_and_both_ways(small_checked_graph):
    """What an edge keeps does not depend on what is asked, and the step back keeps the same."""
    some = 0
    for _, limb, _, stances in random_steps(small_checked_graph, 1, 30):
        step = checked(small_checked_graph, stances, limb)
        kept = int(step["kept"][1 - limb])
        back = checked(small_checked_graph, stances, limb, ends=(1, 0))
        sets = stances.branch_sets[:, 1 - limb]
        assert int(back["kept"][1 - limb]) & int(sets[1]) == kept & int(sets[0])
        if not any(code == ON_LINE for code in swing_codes(step).values()):
            for bit in range(16):
                alone = checked(small_checked_graph, stances, limb, 1 << bit)
                assert int(alone["kept"][1 - limb]) == kept & 1 << bit
            some += kept != 0
    assert some > 5


def test_without_collisions_every_line_above_the_floor_is_kept(small_map):
    graph = stance_graph(small_map, settings=NO_COLLISIONS)
    for _, limb, _, stances in random_steps(graph, 2, 30):
        step, plain = checked(graph, stances, limb), PlainChecks(graph, stances)
        of_step = PlainLineStep(plain, limb, 0, 1)
        there = members(stances.branch_sets[1, 1 - limb])
        lines = {pair: of_step.line(*pair) for pair in there}
        kept = {
            pair for pair, line in lines.items() if line is not None and of_step.is_regular(line)
        }
        assert members(step["kept"][1 - limb]) == kept


def configurations_of(graph, stances, step, after, bit):
    """The robot at samples of a step on one hold, with its swing, as far as that is a fold."""
    limb = int(step["limb"])
    of_step = PlainLineStep(PlainChecks(graph, stances), limb, 0, 1)
    joints = np.zeros((2, 2, 6))
    joints[:, 1 - limb] = of_step.line(bit % 8, bit // 8)
    joints[:, limb] = of_step.plain.folds[int(called(code_of)(int(step["swings"]), bit % 8))]
    flange = graph.solver.grasps[after[1 - limb]]["flange"]
    turn = np.diag([-1.0, -1.0, 1.0]) if bit >= 8 else np.eye(3)
    frame = rigid(flange["rotation"] @ turn, flange["position"])
    return configurations(graph.robot, joints, 1 - limb, frame, SHARES)


def test_kept_holds_are_clear_at_samples_and_lead_from_base_to_base(small_checked_graph):
    """Coal and MuJoCo measure; the support holds its point all along, by forward kinematics."""
    graph, done = small_checked_graph, 0
    ruler = Ruler(graph.robot, graph.grasp_map.boxes)
    for rng, limb, after, stances in random_steps(graph, 3, 40):
        step = checked(graph, stances, limb)
        bits = [b for b in range(16) if int(step["kept"][1 - limb]) >> b & 1]
        bits = [b for b in bits if swing_codes(step)[b % 8] < len(graph.robot.folds)]
        if not bits:
            continue
        bit = int(rng.choice(bits))
        where = configurations_of(graph, stances, step, after, bit)
        for end, s in ((where[0], 0), (where[-1], 1)):
            base = stances.base[s]
            turned = Rotation.from_matrix(base["rotation"]).as_quat(scalar_first=True)
            np.testing.assert_allclose(end[0], base["position"], atol=1e-9)
            assert abs(turned @ end[1]) > 1.0 - 1e-9
        held = grasps_of(graph, [(1 - limb, after[1 - limb])])
        closest = [ruler.measured(here, held, 0.05)[:1] for here in where]
        least = min((found[0][0] for found in closest if found), default=1.0)
        assert least >= graph.settings.clearance - 1e-9
        done += 1
    assert done > 15


@pytest.mark.parametrize("only_obstacles", [True, False])
def test_among_obstacles_an_edge_keeps_what_is_clear_of_them_too(
    small_checked_graph, only_obstacles
):
    """Known edges are checked by their stored swings first; the answer is that of a full check."""
    graph, differ, rng = small_checked_graph, Counter(), np.random.default_rng(9)
    for _, limb, _, stances in random_steps(graph, 4, 40):
        free = checked(graph, stances, limb)
        if not free["kept"][1 - limb] or free["line_branches"] >= 0:
            continue
        middle = 0.5 * (stances.base[0]["position"] + stances.base[1]["position"])
        at = tuple(middle + rng.uniform(-0.8, 0.8, 3))
        obstacles = box_grid([Box("b", "obstacle", at, (0.1, 0.1, 0.1))])
        every = graph.checks.world(obstacles)
        full = checked(graph, stances, limb, world=every)
        among = graph.checks.world(obstacles, obstacles_only=True)
        kind = STORED_ALONE if only_obstacles else STORED_FIRST
        known = checked(graph, stances, limb, world=among, known=free, recheck=kind)
        ours, truth = (int(one["kept"][1 - limb]) for one in (known, full))
        folds = branch_set_of(
            {(b, f) for b, f in members(truth) if swing_codes(full)[b] != ON_LINE}
        )
        assert ours & ~truth == 0
        if not only_obstacles:
            assert ours == folds
        differ[truth != int(free["kept"][1 - limb])] += 1
    assert min(differ.values()) > 3
