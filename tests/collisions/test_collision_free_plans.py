"""Stances and plans that are called free touch nothing; MuJoCo and coal are the rulers."""

import mujoco
import numpy as np
import pytest
from coal_ruler import Ruler, grasps_of
from limb_motions import ROBOT

from mlivr_gym import stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.scene import scene_spec, set_configuration
from mlivr_gym.transitions.state import State


def penetrating(model, data, held):
    """Names of a pair that overlaps, grippers with the track they hold left out."""
    mujoco.mj_forward(model, data)
    for k in range(data.ncon):
        a, b = (model.geom(g).name for g in data.contact.geom[k])
        if data.contact.dist[k] < -1e-6 and (a, b) not in held and (b, a) not in held:
            return a, b
    return None


def tracks(graph, stance):
    return {
        (f"limb{i}/gripper/0", "box/" + graph.grasp_map.ids[p].split(":")[0])
        for i, p in enumerate(stance)
    }


def test_free_stances_penetrate_nothing_in_mujoco(checked_graph):
    graph = checked_graph
    model = scene_spec(graph.grasp_map, graph.robot).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    for s in rng.choice(len(graph), 300, replace=False):
        stance = tuple(graph.points[s].tolist())
        masks = (
            1 << int(rng.choice([b for b in range(16) if m >> b & 1]))
            for m in graph.mask[s].tolist()
        )
        set_configuration(model, data, *graph.configuration(State(stance, tuple(masks))))
        assert penetrating(model, data, tracks(graph, stance)) is None


@pytest.mark.parametrize(("robot", "seed"), [("mlivr2", 0), ("mlivr2", 1), ("mlivr3", 0)])
def test_plans_penetrate_nothing_in_mujoco(jem, checked_graph, robot, seed):
    graph = checked_graph if robot == "mlivr2" else stance_graph(jem, robot)
    model = scene_spec(jem, graph.robot).compile()
    data = mujoco.MjData(model)
    start, goal = sample_task(graph, np.random.default_rng(seed), 0.2)
    plan = Planner(graph).plan(start.stance, goal, "weighted", regrasp_price=0.2).unwrap()
    for k, step in enumerate(plan.steps):
        assert step.swing in ("direct", "over", "folded", "sampled")
        motion = step_motion(graph, plan, k, 12)
        held = set().union(*(tracks(graph, graph.indices(plan.stances[n])) for n in (k, k + 1)))
        np.testing.assert_allclose(
            motion.joint_positions[0], plan.motion.joint_positions[k], atol=1e-6
        )
        np.testing.assert_allclose(
            motion.joint_positions[-1], plan.motion.joint_positions[k + 1], atol=1e-6
        )
        for n in range(len(motion.phase)):
            set_configuration(
                model,
                data,
                motion.base_positions[n],
                motion.base_quaternions[n],
                motion.joint_positions[n],
            )
            assert penetrating(model, data, held) is None


CLEARANCE = 0.02


def nearest(graph, plan, ruler, samples):
    """Distances at samples of a plan's steps, grippers at grasps left out, the least first."""
    found = []
    for k, step in enumerate(plan.steps):
        motion = step_motion(graph, plan, k, samples)
        before, after = (graph.indices(plan.stances[n]) for n in (k, k + 1))
        for n, phase in enumerate(motion.phase):
            points = [(i, p) for i, p in enumerate(before) if i != step.limb]
            # It departs along one normal and approaches along the other; between it is at no grasp.
            points += {
                0: [(step.limb, before[step.limb])],
                1: [],
                2: [(step.limb, after[step.limb])],
            }[int(phase)]
            here = motion.base_positions[n], motion.base_quaternions[n], motion.joint_positions[n]
            found += ruler.measured(here, grasps_of(graph, points), 2.0 * CLEARANCE)
    return sorted(found)


@pytest.mark.parametrize(("robot", "plans"), [("mlivr2", 5), ("mlivr3", 8)])
def test_all_along_plans_coal_finds_the_clearance(jem, checked_graph, robot, plans):
    """Between all shapes that are compared, at every sample of every step."""
    graph = checked_graph if robot == "mlivr2" else stance_graph(jem, robot)
    rng, ruler, planner = np.random.default_rng(5), Ruler(graph.robot, jem.boxes), Planner(graph)
    found = []
    for n in range(plans):
        start, goal = sample_task(graph, rng, 1.0)
        cost = ("base", "steps")[n % 2] if graph.limbs == 2 else "weighted"
        price = {} if graph.limbs == 2 else {"regrasp_price": 0.2}
        plan = planner.plan(start.stance, goal, cost, **price).unwrap()
        found += nearest(graph, plan, ruler, 12)
    assert min(found)[0] >= CLEARANCE - 1e-9
    # They come so close that the clearance decides.
    ids = {box.id for box in jem.boxes}
    assert min(gap for gap, _, other in found if other in ids) < 1.5 * CLEARANCE
    if robot == "mlivr3":
        between = [gap for gap, a, b in found if {a[:4], b[:4]} == {"limb"} and a[:5] != b[:5]]
        assert min(between) < 2.0 * CLEARANCE


def test_free_stances_keep_the_clearance(checked_graph, jem):
    """All shapes that are compared, on random ones of the branches allowed."""
    graph, rng, ruler = checked_graph, np.random.default_rng(3), Ruler(ROBOT, jem.boxes)
    found = []
    for s in rng.choice(len(graph), 500, replace=False):
        stance = tuple(graph.points[s].tolist())
        allowed = ([b for b in range(16) if mask >> b & 1] for mask in graph.mask[s].tolist())
        bits = tuple(1 << int(rng.choice(some)) for some in allowed)
        here = graph.configuration(State(stance, bits))
        found += ruler.measured(here, grasps_of(graph, enumerate(stance)), 0.05)
    assert CLEARANCE - 1e-9 <= min(found)[0] < 1.1 * CLEARANCE
