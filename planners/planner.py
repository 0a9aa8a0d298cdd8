"""The planner: from a start stance and a goal position to a plan."""

from __future__ import annotations

import sys
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.errors import NoPlanError, SettingError, StanceError, choice, nonnegative
from mlivr_gym.kinematics.holding import quaternion
from mlivr_gym.motion.commitment import assemble
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.cost_to_go import CostToGo
from mlivr_gym.planners.costs import HEURISTICS, Cost
from mlivr_gym.planners.estimates import CACHED_TABLES, Estimates, unchecked
from mlivr_gym.planners.lazy_search import lazy_search
from mlivr_gym.planners.pair_search import EXHAUSTED, FOUND, LIMIT, search
from mlivr_gym.postures.given_pose import given_joints
from mlivr_gym.postures.solver import Postures
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import State, join

Array = NDArray[np.float64]

METHODS = ("astar", "dijkstra", "greedy", "algorithm1")
"""Names of the search methods."""

GOAL_TOLERANCE = 0.2
"""Radius of the goal region in the paper [m]."""

MOST_BLOCKED = 50
"""Steps left out of one query, at most, because a limb would leave its joint limits while it holds."""

PATIENCE = 100
"""States explored before the estimate is brought nearer to the truth by a search backward; four times as many each time."""

CHEAP = 10
"""Times as many where steps are not checked for collisions: such a check takes a tenth of the time."""

LEARNING = 8
"""Entries taken from the queue of the backward search for each state explored until then; most need no new step checked."""


@dataclass(frozen=True)
class PlanningResult:
    """Outcome of a query.

    Attributes:
        plan: The plan, or None.
        reason: `""`, or why there is none: `"start infeasible"`, `"goal outside the reachable
            set"`, `"search exhausted"`, `"limit reached"`, `"joint limits"`.
        message: One sentence for people.
        expanded: States expanded.
        generated: States generated.
        feasibility_time: Time spent on postures and stances for this query [s].
        search_time: Time spent on search and step checks [s].
        tree: Base positions at both ends of each explored step, shape (e, 2, 3) [m].
    """

    plan: Plan | None
    reason: str
    message: str
    expanded: int
    generated: int
    feasibility_time: float
    search_time: float
    tree: Array

    def __bool__(self) -> bool:
        """Whether there is a plan."""
        return self.plan is not None

    def unwrap(self) -> Plan:
        """The plan.

        Raises:
            NoPlanError: If there is none; the message says why.
        """
        if self.plan is None:
            raise NoPlanError(self.message)
        return self.plan


class _Path:
    """A path found by either search: states, postures, counts and the explored tree."""

    def __init__(
        self,
        status: int,
        states: list[State],
        postures: Postures,
        cost: float,
        counts: tuple[int, int],
        tree: Array,
    ) -> None:
        self.status, self.states, self.postures, self.cost, self.tree = (
            status,
            states,
            postures,
            cost,
            tree,
        )
        self.expanded, self.generated = counts


class Planner:
    """Plans on one stance graph.

    Example:
        >>> from mlivr_gym import stance_graph
        >>> from mlivr_gym.planners import Planner
        >>> planner = Planner(stance_graph())
        >>> plan = planner.plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), cost="steps").unwrap()
        >>> len(plan.steps)
        4
    """

    def __init__(self, graph: PairGraph | LazyGraph) -> None:
        """Plan on `graph`."""
        self.graph = graph
        self._estimates = Estimates(graph) if isinstance(graph, PairGraph) else None
        self._exact: OrderedDict[tuple[Any, ...], CostToGo] = OrderedDict()

    def plan(
        self,
        start: Sequence[str | int],
        goal: Sequence[float],
        cost: str = "base",
        *,
        regrasp_price: float | None = None,
        method: str = "astar",
        heuristic: str | None = None,
        inflation: float | None = None,
        goal_tolerance: float = GOAL_TOLERANCE,
        start_pose: Sequence[Any] | None = None,
        start_joints: Sequence[Any] | Array | None = None,
        limit: int = 10_000_000,
        progress: Callable[[int], None] | None = None,
    ) -> PlanningResult:
        """Plan from a stance to a goal position of the base.

        Args:
            start: Point id (or index) of each limb.
            goal: x, y, z in the JEM frame [m].
            cost: `"base"` (displacement), `"steps"` or `"weighted"` (displacement plus a price a
                step).
            regrasp_price: Metres charged for a regrasp, with `cost="weighted"`.
            method: `"astar"` (optimal), `"dijkstra"` (optimal, no heuristic), `"greedy"`
                (best-first by heuristic) or `"algorithm1"` (as `"astar"`, in plain Python: slow, to
                read and to compare with).
            heuristic: `"cost_to_go"` (exact cost when steps are not checked; default for two
                limbs), `"consistent"` (default for more and of `"algorithm1"`), `"paper"` (may lose
                optimality; default of `"greedy"`) or `"zero"`.
            inflation: Factor on the heuristic, at least 1; the plan costs at most this many times
                the least. By default 1 for two limbs and `"algorithm1"`, else 2, as the search for
                the least takes long.
            goal_tolerance: Radius of the goal region [m].
            start_pose: Base pose at the start, where the robot stands in another than the start
                stance's own posture: x, y, z [m] and quaternion w, x, y, z. The thresholds do not
                apply to it.
            start_joints: Joint angles at the start, shape (N, 6) [rad], within 0.02 rad of those
                that hold the points at that pose: the plan then keeps their branches and windings
                for as long as each limb holds.
            limit: Most expansions.
            progress: Called with the number of expansions now and then (`"algorithm1"`, or more
                than two limbs).

        Returns:
            The plan, or why there is none. A start that cannot be held is such a reason; ids that
            do not exist, points too close or too far apart and goals outside the cabin raise.

        Raises:
            MlivrError: If an argument cannot be used; the message names it.
        """
        pair = isinstance(self.graph, PairGraph)
        priced = Cost.named(cost, regrasp_price)
        choice("method", method, METHODS)
        plain = method == "algorithm1"
        if heuristic is None:
            # Greedy search needs an estimate without plateaus, and loses nothing by overestimates.
            tables = pair and not plain
            heuristic = "paper" if method == "greedy" else "cost_to_go" if tables else "consistent"
        choice("heuristic", heuristic, HEURISTICS)
        if method == "dijkstra":
            heuristic = "zero"
        if method == "greedy" and heuristic == "zero":
            raise SettingError("method 'greedy' needs a heuristic other than 'zero'")
        if heuristic == "cost_to_go" and not pair:
            raise SettingError(
                f"heuristic 'cost_to_go' needs two limbs; robot {self.graph.robot.name!r} has more"
            )
        if heuristic == "cost_to_go" and plain:
            raise SettingError("method 'algorithm1' needs a heuristic other than 'cost_to_go'")
        if limit < 1:
            raise SettingError(f"limit is {limit!r}; it must be at least 1")
        limit = min(
            limit, sys.maxsize
        )  # no search is that long, and the compiled one takes 64 bits
        inflation = (1.0 if pair or plain else 2.0) if inflation is None else inflation
        if not 1.0 <= inflation < float("inf"):
            raise SettingError(f"inflation is {inflation!r}; it must be finite and at least 1")
        tolerance = nonnegative("goal_tolerance", goal_tolerance)
        target = self.graph.grasp_map.check_goal(goal)
        began = time.perf_counter()
        points = self.graph.indices(start)
        try:
            first = self.graph.state(points, start_pose, start_joints)
        except StanceError as error:
            return self._failure("start infeasible", str(error), time.perf_counter() - began)
        joints = None if start_joints is None else given_joints(self.graph.robot, start_joints)
        feasibility = time.perf_counter() - began
        # The order of the queue depends on the ratio of the two weights alone.
        g_weight = 0.0 if method == "greedy" else 1.0 / inflation
        began = time.perf_counter()
        blocked: list[tuple[tuple[int, ...], tuple[int, ...]]] = []
        while True:
            if plain:
                path = self._algorithm1_path(
                    first, target, tolerance, priced, heuristic, inflation, limit, progress, blocked
                )
            elif isinstance(self.graph, PairGraph):
                # From a pose of the robot's own the first step is no edge of the graph.
                own = [
                    pair for pair in blocked if first.pose is not None and pair[0] == first.stance
                ]
                barred = [pair[1] for pair in own]
                with self.graph.without([pair for pair in blocked if pair not in own]):
                    path = self._pair_path(
                        first,
                        target,
                        tolerance,
                        priced,
                        heuristic,
                        g_weight,
                        limit,
                        not blocked,
                        barred,
                    )
            else:
                path = self._lazy_path(
                    self.graph,
                    first,
                    target,
                    tolerance,
                    priced,
                    heuristic,
                    g_weight,
                    limit,
                    progress,
                    blocked,
                )
            if path is None or path.status != FOUND:
                break
            found = time.perf_counter()
            parts = assemble(self.graph, path.states, path.postures, joints)
            began += time.perf_counter() - found
            if parts.beyond is None or len(blocked) == MOST_BLOCKED:
                break
            # A limb would turn too far while it holds: do without the last step of that hold.
            blocked.append((path.states[parts.beyond].stance, path.states[parts.beyond + 1].stance))
        elapsed = time.perf_counter() - began
        if path is None:
            message = (
                f"no stance that can be reached from the start has its base within {tolerance:g} m of goal "
                f"{target.tolist()}"
            )
            return self._failure("goal outside the reachable set", message, feasibility, elapsed)
        numbers = (path.expanded, path.generated, feasibility, elapsed, path.tree)
        if path.status != FOUND:
            reason = "limit reached" if path.status == LIMIT else "search exhausted"
            told = f" after {path.expanded} expansions, no way from {self.graph.ids(points)} to {target.tolist()}"
            if path.generated <= 1:
                told = f": no step leaves the start {self.graph.ids(points)} on the branches that the limbs may be on"
            return PlanningResult(None, reason, f"{reason}{told}", *numbers)
        if parts.beyond is not None:
            message = "limbs that hold through several steps would leave their joint limits, or find no way to swing"
            return PlanningResult(None, "joint limits", message, *numbers)
        ids = self.graph.ids
        plan = Plan(
            stances=tuple(ids(state.stance) for state in path.states),
            actions=tuple((step.limb, step.to_point) for step in parts.steps),
            steps=parts.steps,
            base_positions=path.postures.position,
            base_quaternions=np.array([quaternion(r) for r in path.postures.rotation]),
            joint_positions=parts.joints,
            branches=parts.branches,
            w_m=parts.w_m,
            w_b=parts.w_b,
            goal=(float(target[0]), float(target[1]), float(target[2])),
            goal_tolerance=tolerance,
            cost_name=priced.name,
            cost=path.cost,
            regrasp_price=regrasp_price,
            method=method,
            heuristic=heuristic,
            expanded=path.expanded,
            generated=path.generated,
            feasibility_time=feasibility,
            search_time=elapsed,
            map_name=self.graph.grasp_map.name,
            map_fingerprint=self.graph.grasp_map.fingerprint,
            obstacles=self.graph.obstacles,
            occupied=ids(sorted(self.graph.occupied)),
            robot=self.graph.robot,
            settings=self.graph.settings,
        )
        return PlanningResult(
            plan, "", f"{len(plan.steps)} steps, {plan.base_translation:.3f} m", *numbers
        )

    def _failure(
        self, reason: str, message: str, feasibility: float, elapsed: float = 0.0
    ) -> PlanningResult:
        return PlanningResult(
            None, reason, message, 0, 0, feasibility, elapsed, np.zeros((0, 2, 3))
        )

    def prepare(
        self,
        goal: Sequence[float],
        cost: str = "base",
        *,
        regrasp_price: float | None = None,
        goal_tolerance: float = GOAL_TOLERANCE,
    ) -> None:
        """Work the `"cost_to_go"` heuristic out for all stances, so that further plans to this goal are fast.

        Where steps are checked it is the exact cost, so that a plan among obstacles explores little
        beside them.
        """
        estimates = self._two_limbs()
        graph, priced = estimates.graph, Cost.named(cost, regrasp_price)
        target, tolerance = (
            graph.grasp_map.check_goal(goal),
            nonnegative("goal_tolerance", goal_tolerance),
        )
        key = (*target.tolist(), tolerance, priced)
        if graph.settings.transitions:
            estimates.keep(
                key,
                self.cost_to_go(
                    goal, cost, regrasp_price=regrasp_price, goal_tolerance=tolerance
                ).values,
            )
        else:
            estimates.keep(key, unchecked(graph, estimates.region(target, tolerance)[1], priced))

    def cost_to_go(
        self,
        goal: Sequence[float],
        cost: str = "base",
        *,
        regrasp_price: float | None = None,
        goal_tolerance: float = GOAL_TOLERANCE,
    ) -> CostToGo:
        """Exact cost from every state to a goal, steps checked: the oracle and expert. Two limbs only.

        Raises:
            SettingError: If the robot has more than two limbs.
        """
        estimates = self._two_limbs()
        graph, priced = estimates.graph, Cost.named(cost, regrasp_price)
        target, tolerance = (
            graph.grasp_map.check_goal(goal),
            nonnegative("goal_tolerance", goal_tolerance),
        )
        key = (*target.tolist(), tolerance, priced, graph.version)
        if key not in self._exact:
            self._exact[key] = CostToGo(graph, target, tolerance, priced)
            if len(self._exact) > CACHED_TABLES:
                self._exact.popitem(last=False)
        return self._exact[key]

    def _two_limbs(self) -> Estimates:
        if self._estimates is None:
            raise SettingError(
                f"cost-to-go tables need two limbs; robot {self.graph.robot.name!r} has more"
            )
        return self._estimates

    def _pair_path(
        self, first: State, target: Array, tolerance: float, cost: Cost, heuristic: str,
        g_weight: float, limit: int, whole: bool,
        barred: Sequence[tuple[int, ...]],
    ) -> _Path | None:  # fmt: skip
        estimates = self._two_limbs()
        graph = estimates.graph
        origin = graph.posture_of(first)
        distance, goal, parts = estimates.region(target, tolerance)
        start, seeds, seed_costs = _seeds(graph, first, origin, cost, barred)
        own = not len(seeds) or int(seeds[0, 1]) < 2
        there = bool(np.linalg.norm(origin.position[0] - target) <= tolerance)
        if own and (there or not len(seeds)):
            return _Path(
                FOUND if there else EXHAUSTED, [first], origin, 0.0, (1, 1), np.zeros((0, 2, 3))
            )
        if not set(graph.components[1][seeds[:, 0]].tolist()) & parts:
            return None
        key = (*target.tolist(), tolerance, cost)
        learnt = estimates.has(key)
        if heuristic == "cost_to_go":
            h = estimates.table(target, tolerance, cost, start)
        else:
            h = cost.heuristic(heuristic, distance, tolerance, graph.max_step)
        patience = limit
        if heuristic == "cost_to_go" and graph.settings.transitions:
            patience = PATIENCE * (1 if graph.settings.collisions else CHEAP)
        bound, explored, made = h, 0, 0
        while True:
            status, generated, node, mask, parent, g = search(
                seeds, seed_costs, goal, h, cost.base_weight, cost.step_weight, g_weight,
                min(limit - explored, patience),
                graph.settings.transitions, graph.rows, graph.row_start, graph.row_position,
                graph.edges,
                np.zeros((len(graph), 2), dtype=np.int64), np.full((len(graph), 2), np.inf),
            )  # fmt: skip
            explored, made = explored + len(node), made + generated
            if status != LIMIT or explored >= limit:
                break
            # Many steps that the estimate counts on are impossible: learn from the other end how it
            # is there.
            h, bound = estimates.learn(
                goal, cost, start, origin.position[0], bound, LEARNING * patience, learnt
            )
            if whole:
                estimates.keep(key, bound)
            patience *= 4
        stance, moved, released = node // 3, node % 3, graph.edges[17][2]
        chain = _chain(parent)
        states = []
        for k in chain:
            masks = graph.mask[stance[k]].tolist()
            if moved[k] < 2:
                masks[1 - moved[k]] = int(mask[k])
                if graph.settings.transitions:
                    masks[moved[k]] = int(released[stance[k], moved[k]]) & 0xFFFF
            a, b = graph.points[stance[k]].tolist()
            states.append(State((a, b), (masks[0], masks[1])))
        postures = graph.node_postures(stance[chain])
        before = np.where(parent[:, None] >= 0, graph.position[stance[parent]], origin.position[0])
        tree = np.stack([before, graph.position[stance]], axis=1)
        if not own:
            return _Path(
                int(status), states, postures, float(g[-1]), (explored, int(made)), tree[1:]
            )
        counts = (explored + 1, int(made) + 1)
        return _Path(
            int(status), [first, *states], join(origin, postures), float(g[-1]), counts, tree
        )

    def _lazy_path(
        self, graph: LazyGraph, first: State, target: Array, tolerance: float, cost: Cost,
        heuristic: str,
        g_weight: float, limit: int, progress: Callable[[int], None] | None,
        blocked: list[tuple[tuple[int, ...], tuple[int, ...]]],
    ) -> _Path | None:  # fmt: skip
        max_step = graph.max_step

        def is_goal(position: Array) -> NDArray[np.bool_]:
            near: NDArray[np.bool_] = np.linalg.norm(position - target, axis=1) <= tolerance
            return near

        def estimate(position: Array) -> Array:
            return cost.heuristic(
                heuristic, np.linalg.norm(position - target, axis=1), tolerance, max_step
            )

        found = lazy_search(
            graph, first, is_goal, estimate, cost, g_weight, limit, progress, blocked
        )
        chain = _chain(np.array(found.parents))
        postures = found.postures[chain[0]]
        for k in chain[1:]:
            postures = join(postures, found.postures[k])
        position = np.concatenate([p.position for p in found.postures])
        parents = np.array(found.parents[1:], dtype=np.int64)
        tree = np.stack([position[parents], position[1:]], axis=1)
        states = [found.states[k] for k in chain]
        return _Path(
            found.status,
            states,
            postures,
            found.costs[-1],
            (len(found.states), found.generated),
            tree,
        )

    def _algorithm1_path(
        self, first: State, target: Array, tolerance: float, cost: Cost, heuristic: str,
        inflation: float, limit: int, progress: Callable[[int], None] | None,
        blocked: list[tuple[tuple[int, ...], tuple[int, ...]]],
    ) -> _Path | None:  # fmt: skip
        found = algorithm1(
            self.graph, first, target, tolerance, cost, heuristic,
            inflation=inflation, limit=limit, blocked=blocked, progress=progress,
        )  # fmt: skip
        states = [found.states[k] for k in _chain(np.array(found.parents))]
        postures = self.graph.posture_of(states[0])
        for state in states[1:]:
            postures = join(postures, self.graph.posture(state.stance))
        position, parents = np.array(found.positions), np.array(found.parents[1:], dtype=np.int64)
        tree = np.stack([position[parents], position[1:]], axis=1)
        counts = len(found.states), found.generated
        return _Path(found.status, states, postures, found.costs[-1], counts, tree)


def _seeds(
    graph: PairGraph, first: State, origin: Postures, cost: Cost, barred: Sequence[tuple[int, ...]]
) -> tuple[int, NDArray[np.int64], Array]:
    """Where a search begins: index of the start, -1 if the robot stands in a pose of its own; seeds and their costs.

    From a pose of its own, or on branches of its own, these are the stances that a first step leads
    to, but for those that are `barred`.
    """
    start = graph.find(first.stance) if first.pose is None else -1
    if start >= 0 and first.masks == tuple(graph.mask[start].tolist()):
        return start, np.array([[start, 2, 0]]), np.zeros(1)
    steps, rows, costs = graph.successors(first), [], []
    for limb, point, position, masks in zip(
        steps.limb.tolist(), steps.point.tolist(), steps.position, steps.masks, strict=True
    ):
        after = (*first.stance[:limb], point, *first.stance[limb + 1 :])
        if after not in barred:
            rows.append((graph.find(after), limb, int(masks[1 - limb])))
            costs.append(
                cost.base_weight * float(np.linalg.norm(position - origin.position[0]))
                + cost.step_weight
            )
    return start, np.array(rows, dtype=np.int64).reshape(-1, 3), np.array(costs)


def _chain(parent: NDArray[np.int64]) -> list[int]:
    """Indices from the first to the last entry along the parents."""
    chain = [len(parent) - 1]
    while parent[chain[-1]] >= 0:
        chain.append(int(parent[chain[-1]]))
    return chain[::-1]
