import heapq
import itertools
import json
from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
import rustworkx as rx
from paper import NO_COLLISIONS

from mlivr_gym import GraspMap, Limb, Settings, State, jem_map, robot_spec, stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import GoalError, MlivrError, PlanError, SettingError, StanceError
from mlivr_gym.kinematics.holding import base_path
from mlivr_gym.kinematics.ur import forward_kinematics
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.stances.lazy_graph import LazyGraph

COSTS = [("base", None), ("steps", None), ("weighted", 0.1)]


def weight(cost, price, displacement):
    return {"base": displacement, "steps": 1.0, "weighted": displacement + (price or 0.0)}[cost]


def branch_graph(graph):
    """Every (stance, branch of limb 0, branch of limb 1) as a node of a networkx graph: the plain definition.

    Edges carry the base displacement.
    """
    out = nx.DiGraph()
    full = [
        State(tuple(graph.points[s].tolist()), tuple(graph.mask[s].tolist()))
        for s in range(len(graph))
    ]
    for s, state in enumerate(full):
        for pair in itertools.product(*([b for b in range(16) if m >> b & 1] for m in state.masks)):
            out.add_node((s, *pair))
    for s, state in enumerate(full):
        steps = graph.successors(state)
        for limb, point, position, masks in zip(*steps, strict=True):
            stance = list(state.stance)
            stance[limb] = int(point)
            t, held = graph.find(tuple(stance)), 1 - limb
            displacement = float(np.linalg.norm(position - graph.position[s]))
            kept = [b for b in range(16) if masks[held] >> b & 1]
            old = [b for b in range(16) if state.masks[limb] >> b & 1]
            new = [b for b in range(16) if graph.mask[t, limb] >> b & 1]
            for b in kept:
                for first, then in itertools.product(old, new):
                    here = (s, b, first) if held == 0 else (s, first, b)
                    there = (t, b, then) if held == 0 else (t, then, b)
                    out.add_edge(here, there, displacement=displacement)
    return out


@pytest.fixture(scope="module")
def tiny():
    """Few enough stances for an exhaustive search over branches."""
    full = jem_map()
    keep = np.array([point.split(":")[0] in {"D1a", "F1b", "F2b"} for point in full.ids])
    keep &= np.array([int(point.split(":")[1]) % 2 == 0 for point in full.ids])
    return stance_graph(full.subset(keep, "tiny"), settings=NO_COLLISIONS)


@pytest.fixture(scope="module")
def tiny_truth(tiny):
    return branch_graph(tiny)


@pytest.mark.parametrize(("cost", "price"), COSTS)
def test_plans_are_optimal_by_exhaustive_search_of_another_library(tiny, tiny_truth, cost, price):
    truth, planner = tiny_truth, Planner(tiny)
    rng = np.random.default_rng(0)
    for _ in range(5):
        s, g = (int(v) for v in rng.integers(0, len(tiny), 2))
        goal = np.clip(tiny.position[g], *tiny.grasp_map.cabin)
        goals = {v for v in truth if np.linalg.norm(tiny.position[v[0]] - goal) <= 0.2}
        sources = {v for v in truth if v[0] == s}
        reached = nx.multi_source_dijkstra_path_length(
            truth, sources, weight=lambda _, __, edge: weight(cost, price, edge["displacement"])
        )
        expected = min((reached[v] for v in goals if v in reached), default=np.inf)
        table = planner.cost_to_go(goal, cost, regrasp_price=price)
        assert table.values[s] == pytest.approx(expected, abs=1e-9)
        for heuristic in ("cost_to_go", "consistent", "zero"):
            result = planner.plan(
                tiny.points[s].tolist(), goal, cost, regrasp_price=price, heuristic=heuristic
            )
            found = result.plan.cost if result.plan else np.inf
            assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("cost", "price"), COSTS)
def test_node_only_plans_agree_with_rustworkx(small_map, cost, price):
    graph = stance_graph(small_map, settings=Settings(collisions=False, transitions=False))
    truth = rx.PyDiGraph()
    truth.add_nodes_from(range(len(graph)))
    for held in range(2):
        for s in range(len(graph)):
            for t in graph.row(held, s).tolist():
                truth.add_edge(
                    s,
                    t,
                    weight(
                        cost, price, float(np.linalg.norm(graph.position[s] - graph.position[t]))
                    ),
                )
    planner, rng = Planner(graph), np.random.default_rng(1)
    for _ in range(10):
        s, g = (int(v) for v in rng.integers(0, len(graph), 2))
        goal = np.clip(graph.position[g], *small_map.cabin)
        reached = rx.dijkstra_shortest_path_lengths(truth, s, float)
        goals = np.flatnonzero(np.linalg.norm(graph.position - goal, axis=1) <= 0.2)
        expected = (
            0.0 if s in goals else min((reached[t] for t in goals if t in reached), default=np.inf)
        )
        for heuristic in ("cost_to_go", "consistent", "zero"):
            result = planner.plan(
                graph.points[s].tolist(), goal, cost, regrasp_price=price, heuristic=heuristic
            )
            found = result.plan.cost if result.plan else np.inf
            assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("cost", "price"), COSTS)
def test_astar_equals_dijkstra_on_the_whole_module(graph, cost, price):
    planner, rng = Planner(graph), np.random.default_rng(2)
    for _ in range(4):
        s, g = (int(v) for v in rng.integers(0, len(graph), 2))
        goal = np.clip(graph.position[g], *graph.grasp_map.cabin)
        start = graph.points[s].tolist()
        costs = [
            planner.plan(start, goal, cost, regrasp_price=price, **how).unwrap().cost
            for how in ({}, {"heuristic": "consistent"}, {"method": "dijkstra"})
        ]
        planner.prepare(goal, cost, regrasp_price=price)
        costs.append(planner.plan(start, goal, cost, regrasp_price=price).unwrap().cost)
        assert np.ptp(costs) < 1e-9
        greedy = planner.plan(start, goal, cost, regrasp_price=price, method="greedy").unwrap()
        inflated = planner.plan(
            start, goal, cost, regrasp_price=price, heuristic="consistent", inflation=1.5
        ).unwrap()
        assert greedy.cost >= costs[0] - 1e-9
        assert costs[0] - 1e-9 <= inflated.cost <= 1.5 * costs[0] + 1e-9


def test_compiled_and_plain_search_agree(small_map, small_graph):
    lazy = Planner(LazyGraph(small_map, small_graph.robot, small_graph.settings))
    ours, rng = Planner(small_graph), np.random.default_rng(3)
    for cost in ("base", "steps"):
        for _ in range(3):
            s, g = (int(v) for v in rng.integers(0, len(small_graph), 2))
            goal = np.clip(small_graph.position[g], *small_map.cabin)
            start = small_graph.points[s].tolist()
            a = ours.plan(start, goal, cost).plan
            b = lazy.plan(start, goal, cost, heuristic="consistent", inflation=1.0).plan
            assert (a is None) == (b is None)
            if a is not None:
                assert a.cost == pytest.approx(b.cost, abs=1e-9)


def test_heuristics_never_overestimate_and_the_papers_does(graph):
    from mlivr_gym.planners.costs import Cost

    goal = np.array([6.0, 0.0, 0.42])
    distance = np.linalg.norm(graph.position - goal, axis=1)
    over = 0
    for name in ("base", "steps"):
        truth = Planner(graph).cost_to_go(goal, name).values
        ours = Cost.named(name).heuristic("consistent", distance, 0.2, graph.max_step)
        assert (ours <= truth + 1e-9).all()
        steps = [np.random.default_rng(0).integers(0, len(graph)) for _ in range(50)]
        for s in steps:
            for t in graph.row(0, s):
                edge = weight(
                    name, None, float(np.linalg.norm(graph.position[s] - graph.position[t]))
                )
                assert ours[s] <= edge + ours[t] + 1e-9
        over += (
            Cost.named(name).heuristic("paper", distance, 0.2, graph.max_step) > truth + 1e-9
        ).sum()
    assert over > 0


def test_the_papers_heuristic_loses_optimality_on_some_task(graph):
    planner = Planner(graph)
    lost = []
    for seed in range(5):
        start, goal = sample_task(graph, np.random.default_rng(seed), 0.2)
        best = planner.plan(start.stance, goal).unwrap().cost
        lost.append(planner.plan(start.stance, goal, heuristic="paper").unwrap().cost - best)
    assert min(lost) > -1e-9
    assert max(lost) > 1e-3


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_a_plan_can_be_carried_out(jem, limbs):
    """Grasps are met, holding joints are continuous and follow the base path, thresholds and limits hold."""
    from scipy.spatial.transform import Rotation

    graph = stance_graph(jem, f"mlivr{limbs}", NO_COLLISIONS)
    robot = graph.robot
    from mlivr_gym.envs.tasks import sample_task

    start, goal = sample_task(graph, np.random.default_rng(limbs), 0.2)
    plan = Planner(graph).plan(start.stance, goal).unwrap()
    assert len(plan.steps) > 0
    assert np.linalg.norm(plan.base_positions[-1] - goal) <= 0.2
    assert plan.w_m_min >= graph.limb_threshold
    assert plan.w_b_min >= graph.base_threshold
    assert np.abs(plan.joint_positions).max() <= 2 * np.pi + 1e-6 + 1e-12
    for k, stance in enumerate(plan.stances):
        base = Rotation.from_quat(plan.base_quaternions[k], scalar_first=True).as_matrix()
        for i, point in enumerate(stance):
            frame = forward_kinematics(plan.joint_positions[k, i], robot.limb.lengths)[6]
            tip = robot.mount_positions[i] + robot.mount_rotations[i] @ (
                frame[:3, 3] + 0.05 * frame[:3, 2]
            )
            index = jem.index(point)
            np.testing.assert_allclose(
                plan.base_positions[k] + base @ tip, jem.positions[index], atol=1e-6
            )
            axis = base @ robot.mount_rotations[i] @ frame[:3, 2]
            np.testing.assert_allclose(axis, -jem.normals[index], atol=1e-6)
    for k, step in enumerate(plan.steps):
        ends = []
        for j in (k, k + 1):
            ends += [
                plan.base_positions[j],
                Rotation.from_quat(plan.base_quaternions[j], scalar_first=True).as_matrix(),
            ]
        kind = {"straight": 0, "arc": 1}[step.path]
        positions, rotations = base_path(*ends, kind, np.array(step.pivot), np.linspace(0, 1, 200))
        for i in range(limbs):
            if i == step.limb:
                assert plan.stances[k][i] == step.from_point
                assert plan.stances[k + 1][i] == step.to_point
                continue
            assert plan.stances[k][i] == plan.stances[k + 1][i]
            q = track(
                plan.joint_positions[k, i],
                positions,
                rotations,
                jem,
                robot,
                i,
                jem.index(plan.stances[k][i]),
            )
            np.testing.assert_allclose(q, plan.joint_positions[k + 1, i], atol=1e-5)


def track(q, positions, rotations, jem, robot, limb, point):
    """Joint angles after following a base path by Newton steps on the grasp error, with no use of closed form."""
    from mlivr_gym.kinematics.ur import jacobian

    x, z = jem.rotations[point][:, 0], -jem.normals[point]
    grip = jem.positions[point] + robot.tool_length * jem.normals[point]
    q = q.copy()
    sign = None
    for position, rotation in zip(positions, rotations, strict=True):
        mount = rotation @ robot.mount_rotations[limb]
        for _ in range(6):
            frame = forward_kinematics(q, robot.limb.lengths)[6]
            sign = sign or float(np.sign((mount @ frame[:3, 0]) @ x))
            want = mount.T @ np.column_stack([sign * x, np.cross(z, sign * x), z])
            place = mount.T @ (grip - position - rotation @ robot.mount_positions[limb])
            spin = 0.5 * sum(np.cross(frame[:3, c], want[:, c]) for c in range(3))
            q += np.linalg.solve(
                jacobian(q, robot.limb.lengths), np.concatenate([place - frame[:3, 3], spin])
            )
    return q


def test_same_input_gives_the_same_plan(jem):
    plans = [
        Planner(stance_graph(jem, settings=NO_COLLISIONS))
        .plan(("D1a:4", "D1b:4"), (6.0, 0.0, 0.42), cost)
        .unwrap()
        .to_dict()
        for cost in ("steps", "steps")
    ]
    for plan in plans:
        plan.pop("search_time"), plan.pop("feasibility_time")
    assert plans[0] == plans[1]


def test_a_plan_survives_json(graph, tmp_path):
    plan = Planner(graph).plan(("D1a:4", "D1b:4"), (6.0, 0.0, 0.42)).unwrap()
    path = tmp_path / "plan.json"
    plan.save(path)
    assert Plan.load(path, graph.grasp_map).to_dict() == plan.to_dict()
    assert [p.name for p in tmp_path.iterdir()] == ["plan.json"]


def test_faulty_plan_files_are_named(graph, small_map, tmp_path):
    plan = Planner(graph).plan(("D1a:4", "D1b:4"), (3.0, 0.0, 0.0)).unwrap()
    path = tmp_path / "plan.json"
    plan.save(path)
    with pytest.raises(PlanError, match="made on map 'jem'.*not on 'small'"):
        Plan.load(path, small_map)
    good = json.loads(path.read_text())
    for change, words in (
        ({"format": 99}, "99"),
        ({"w_b": [1.0]}, "w_b has shape"),
        ({"actions": []}, "0 actions"),
        ({"goal": "there"}, "faulty field"),
    ):
        path.write_text(json.dumps(good | change))
        with pytest.raises(PlanError, match=words):
            Plan.load(path)
    good.pop("stances")
    path.write_text(json.dumps(good))
    with pytest.raises(PlanError, match="lacks field 'stances'"):
        Plan.load(path)
    with pytest.raises(PlanError, match="cannot read plan"):
        Plan.load(tmp_path / "none.json")
    with pytest.raises(MlivrError, match="cannot write"):
        plan.save(tmp_path / "no" / "plan.json")


def test_no_path_says_why(graph, jem):
    planner = Planner(graph)
    start = ("D1a:4", "D1b:4")
    result = planner.plan(("D1a:4", "D2b:4"), (6.0, 0.0, 0.42))
    assert (result.reason, bool(result)) == ("start infeasible", False)
    assert "limb manipulability" in result.message
    result = planner.plan(start, (9.5, 0.0, 0.0))
    assert result.reason == "goal outside the reachable set"
    assert "[9.5, 0.0, 0.0]" in result.message
    result = planner.plan(start, (6.0, 0.0, 0.42), heuristic="zero", limit=10)
    assert result.reason == "limit reached"
    assert result.expanded == 10
    with pytest.raises(PlanError, match="limit reached"):
        result.unwrap()
    far = {"D1a", "D1b", "D6a", "D6b", "F6a", "F6b"}
    split = jem.subset(np.array([point.split(":")[0] in far for point in jem.ids]), "split")
    result = Planner(stance_graph(split, settings=NO_COLLISIONS)).plan(start, (6.6, 0.0, -0.4))
    assert result.reason == "goal outside the reachable set"


def test_search_exhausted_where_the_only_step_cannot_be_carried_out(jem, graph):
    """Three points: both stances can be held, but the limb that stays cannot follow the base."""
    rng, reasons = np.random.default_rng(0), set()
    while "search exhausted" not in reasons:
        s = int(rng.integers(len(graph)))
        row = graph.row(0, s)
        for t in row[graph.edge_masks(0, s, row) & graph.mask[s, 0] & graph.mask[row, 0] == 0][
            :5
        ].tolist():
            keep = np.zeros(len(jem), dtype=bool)
            keep[[*graph.points[s], *graph.points[t]]] = True
            three = stance_graph(jem.subset(keep, "three"), settings=NO_COLLISIONS)
            result = Planner(three).plan(
                graph.ids(graph.points[s]), graph.position[t], goal_tolerance=0.01
            )
            reasons.add(result.reason)
            if result.reason == "search exhausted":
                assert "after 1 expansions" in result.message or result.expanded < 12


def test_bad_arguments_are_named(graph):
    planner, start, goal = Planner(graph), ("D1a:4", "D1b:4"), (6.0, 0.0, 0.42)
    for error, words, change in (
        (SettingError, "cost is 'fast'.*'steps'", {"cost": "fast"}),
        (SettingError, "regrasp_price", {"cost": "weighted"}),
        (SettingError, "regrasp_price", {"regrasp_price": 0.1}),
        (SettingError, "regrasp_price is -1", {"cost": "weighted", "regrasp_price": -1}),
        (SettingError, "method is 'rrt'", {"method": "rrt"}),
        (SettingError, "heuristic is 'best'", {"heuristic": "best"}),
        (SettingError, "greedy", {"method": "greedy", "heuristic": "zero"}),
        (SettingError, "inflation is 0.5", {"inflation": 0.5}),
        (SettingError, "limit is 0", {"limit": 0}),
        (SettingError, "goal_tolerance is -1", {"goal_tolerance": -1}),
        (StanceError, "'Z'", {"start": ("D1a:4", "Z")}),
        (GoalError, "outside the cabin", {"goal": (60.0, 0.0, 0.0)}),
        (GoalError, "finite", {"goal": (float("nan"), 0.0, 0.0)}),
    ):
        with pytest.raises(error, match=words):
            planner.plan(**({"start": start, "goal": goal} | change))
    many = Planner(stance_graph(graph.grasp_map, "mlivr3", NO_COLLISIONS))
    with pytest.raises(SettingError, match="two limbs"):
        many.cost_to_go(goal)


def test_start_inside_the_goal_is_a_plan_without_steps(graph):
    start = graph.state(("D1a:4", "D1b:4"))
    here = graph.posture(start.stance).position[0]
    plan = Planner(graph).plan(start.stance, here).unwrap()
    assert plan.steps == ()
    assert plan.cost == 0.0
    assert plan.base_translation == 0.0


def test_the_table_is_an_expert(graph):
    """Following the best action from the table costs exactly what the table says."""
    goal = np.array([6.0, 0.0, 0.42])
    for cost in ("base", "steps"):
        table = Planner(graph).cost_to_go(goal, cost)
        state, total = graph.state(("D1a:4", "D1b:4")), 0.0
        expected = table.value(state)
        while not table.is_goal[graph.find(state.stance)]:
            steps = graph.successors(state)
            k = table.best(state, steps)
            total += weight(
                cost,
                None,
                float(np.linalg.norm(steps.position[k] - graph.posture(state.stance).position[0])),
            )
            stance = list(state.stance)
            stance[steps.limb[k]] = int(steps.point[k])
            state = State(tuple(stance), tuple(steps.masks[k].tolist()))
        assert total == pytest.approx(expected, abs=1e-9)
        assert Planner(graph).plan(("D1a:4", "D1b:4"), goal, cost).unwrap().cost == pytest.approx(
            expected, abs=1e-9
        )


def test_narrow_joint_limits_are_kept_along_the_plan(jem):
    limits = ((-np.pi, np.pi),) * 6
    robot = replace(robot_spec("mlivr2"), limb=Limb(joint_limits=limits))
    plan = (
        Planner(stance_graph(jem, robot, NO_COLLISIONS))
        .plan(("D1a:4", "D1b:4"), (4.0, 0.0, 0.0), "steps")
        .unwrap()
    )
    assert np.abs(plan.joint_positions).max() <= np.pi + 1e-6 + 1e-12


def test_moving_a_limb_pays_its_price(graph):
    planner, start, goal = Planner(graph), ("D1a:7", "D1b:0"), (5.9, -0.1, 0.35)
    plans = [
        planner.plan(start, goal, "weighted", regrasp_price=price).unwrap()
        for price in (0.0, 0.05, 0.5, 5.0)
    ]
    assert all(len(a.steps) >= len(b.steps) for a, b in itertools.pairwise(plans))
    assert all(
        a.base_translation <= b.base_translation + 1e-9 for a, b in itertools.pairwise(plans)
    )
    assert len(plans[-1].steps) == len(planner.plan(start, goal, "steps").unwrap().steps)


def test_ties_prefer_what_is_further_along(small_map):
    """Equal f: larger g first, then the earlier entry; compared with a plain heap on the same order."""
    from mlivr_gym.planners.pair_search import _sift_down, _sift_up

    rng = np.random.default_rng(0)
    f, g = rng.integers(0, 4, 300).astype(float), rng.integers(0, 4, 300).astype(float)
    heap, size, plain = np.empty(300, dtype=np.int64), 0, []
    for k in range(300):
        heap[size] = k
        size += 1
        _sift_up(heap, size, f, g)
        heapq.heappush(plain, (f[k], -g[k], k))
    while size:
        assert heap[0] == heapq.heappop(plain)[2]
        size -= 1
        if size:
            heap[0] = heap[size]
            _sift_down(heap, size, f, g)


def test_a_users_own_map_plans(ladder):
    graph = stance_graph(ladder, settings=Settings(collisions=False, limb_threshold=0.05))
    assert isinstance(ladder, GraspMap)
    s, g = 0, int(np.argmax(np.linalg.norm(graph.position - graph.position[0], axis=1)))
    result = Planner(graph).plan(graph.points[s].tolist(), graph.position[g])
    assert result.unwrap().map_name == "ladder"


def test_a_hold_that_would_leave_the_joint_limits_is_planned_round(jem):
    """A task on which the first path found turns a joint of a holding limb by more than its limits allow."""
    from mlivr_gym.envs.tasks import sample_task

    graph = stance_graph(jem, "mlivr3", NO_COLLISIONS)
    start, _ = sample_task(graph, np.random.default_rng(0), 0.2)
    plan = (
        Planner(graph).plan(start.stance, (2.5, -0.4, -0.3), "weighted", regrasp_price=0.1).unwrap()
    )
    assert np.abs(plan.joint_positions).max() <= 2 * np.pi + 1e-6 + 1e-12
    for a, b in itertools.pairwise(range(len(plan.stances))):
        held = [i for i in range(3) if plan.stances[a][i] == plan.stances[b][i]]
        assert (
            np.abs(plan.joint_positions[b, held] - plan.joint_positions[a, held]).max()
            < np.pi * 1.5
        )


def test_steps_taken_out_of_a_graph_come_back(small_graph):
    s = 0
    t = int(small_graph.row(0, s)[0])
    before, after = (tuple(small_graph.points[k].tolist()) for k in (s, t))
    row = np.array([t])
    known = int(small_graph.edge_masks(0, s, row)[0])
    with small_graph.without([(before, after), (before, after)]):
        assert small_graph.edge_masks(0, s, row)[0] == 0
    assert small_graph.edge_masks(0, s, row)[0] == known


def test_unchecked_plans_do_without_joint_limits(small_map):
    """Where steps are not checked, limits over a hold are not either, and nothing fails for it."""
    robot = replace(robot_spec("mlivr2"), limb=Limb(joint_limits=((-1.0, 1.0),) * 6))
    graph = stance_graph(small_map, robot, Settings(collisions=False, transitions=False))
    plan = (
        Planner(graph)
        .plan(graph.points[0].tolist(), graph.position[-1], goal_tolerance=0.3)
        .unwrap()
    )
    assert np.isfinite(plan.joint_positions).all()
    assert {step.path for step in plan.steps} == {"unchecked"}
