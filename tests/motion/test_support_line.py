"""What is committed for two limbs is what the check of steps compares: the same lines."""

from collections import Counter

import numpy as np
from compiled import called
from plain_checks import PlainChecks
from plain_line_steps import PlainLineStep
from random_steps import asked, two_stances

from mlivr_gym.compiled.bit_sets import ALL, code_of
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.motion.support_line import SupportLine
from mlivr_gym.motion.swings import swing_knot
from mlivr_gym.transitions.line_steps import ON_LINE, check_all_alone
from mlivr_gym.transitions.records import StepContext, StepRecord, StepScratch


def folds_of(graph, stances, limb, bit):
    """The first fold of both releases in which one hold is kept, -1 if none is."""
    steps = StepRecord.rows(1)
    steps["limb"], steps["before"], steps["after"] = limb, 0, 1
    steps["branches"][0, 1 - limb] = 1 << bit
    context = StepContext(stances, graph.checks.robots, graph.checks.world(None))
    check_all_alone(0, 1, steps, context, StepScratch.rows(1))
    if not steps["kept"][0, 1 - limb]:
        return -1
    code = int(called(code_of)(int(steps["swings"][0]), bit % 8))
    return -1 if code == ON_LINE else code


def test_a_line_is_clear_in_the_fold_that_the_check_of_steps_finds(small_checked_graph):
    graph, rng, found = small_checked_graph, np.random.default_rng(4), Counter()
    for _ in range(40):
        limb, before, after = two_stances(graph, rng)
        stances, *_ = asked(graph, limb, before, after, [ALL, ALL], False)
        of_step = PlainLineStep(PlainChecks(graph, stances), limb, 0, 1)
        both = int(np.bitwise_and.reduce(stances.releases["folds"][:, limb]))
        folds = [k for k in range(len(graph.robot.folds)) if both >> k & 1]
        for bit in range(16):
            line = of_step.line(bit % 8, bit // 8)
            kept = int(stances.branch_sets[1, 1 - limb]) >> bit & 1
            if line is None or not kept or not of_step.is_regular(line):
                continue
            joints = np.zeros((2, 2, 6))
            joints[:, 1 - limb] = line
            ends = StepEnds(
                limb, before, after[limb], stances.base["position"], stances.base["rotation"],
                (0, 0, 0), joints,
            )  # fmt: skip
            support = SupportLine(graph, ends)
            still = [of_step.plain.folds[k] for k in folds]
            knots = [(swing_knot(0.0, q), swing_knot(1.0, q)) for q in still]
            clear = [k for k, pair in zip(folds, knots, strict=True) if support.is_clear(*pair)]
            assert folds_of(graph, stances, limb, bit) == (clear[0] if clear else -1)
            for pair in knots[:1]:
                np.testing.assert_array_equal(support.knots(*pair)[:, 1 - limb], line)
            found[bool(clear)] += 1
    assert min(found.values()) > 10
