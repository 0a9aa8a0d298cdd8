"""What steps may keep at most: their plain definition, and whatever steps are found to keep."""

import numpy as np
import pytest
from paper import NO_COLLISIONS
from plain_checks import PlainChecks, members
from plain_steps import PlainStep
from random_steps import asked, two_stances

from mlivr_gym import stance_graph
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.transitions.records import StepRecord


@pytest.mark.parametrize(
    ("robot", "settings"), [("mlivr3", None), ("mlivr4", None), ("mlivr4", NO_COLLISIONS)]
)
def test_steps_keep_at_most_what_the_plain_definition_says(small_map, robot, settings):
    graph, rng = stance_graph(small_map, robot, settings), np.random.default_rng(3)
    checks, kinds = graph.checks, dict.fromkeys(("none", "less", "all"), 0)
    for _ in range({3: 24, 4: 12}[graph.limbs]):
        limb, before, after = two_stances(graph, rng)
        stances, step, _ = asked(graph, limb, before, after)
        world, most, back = checks.world(None), *StepRecord.rows(2)[:, None]
        for one, ends in ((most, (0, 1)), (back, (1, 0))):
            one["limb"], (one["before"], one["after"]), one["kept"] = limb, ends, ALL
            checks.relax(one, stances, world)
        supports = [i for i in range(graph.limbs) if i != limb]
        both = [one["kept"][0, supports] for one in (most, back)]
        if all(one.all() for one in both):
            assert (both[0] == both[1]).all()
        else:
            assert not any(one.all() for one in both)
        plain = PlainChecks(graph, stances)
        releases = None
        if settings is None:
            releases = [[plain.release(s, i) for i in range(graph.limbs)] for s in (0, 1)]
        of_step = PlainStep(plain, limb, 0, 1)
        found = {i: members(most["kept"][0, i]) for i in of_step.held}
        assert found == of_step.most(releases)
        assert (step["kept"] & ~most["kept"][0] == 0).all()
        for _ in range(8):
            few = [int(rng.integers(1, ALL + 1)) for _ in range(graph.limbs)]
            _, kept, _ = asked(graph, limb, before, after, few)
            assert (kept["kept"] & ~most["kept"][0] == 0).all()
        standing = of_step.alone(collisions=False)
        kind = "all" if found == standing else "less" if any(found.values()) else "none"
        kinds[kind] += 1
    assert kinds["all"] > 0
    assert settings is not None or kinds["none"] > 0
