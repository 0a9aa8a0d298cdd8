"""Plans refined: other base poses on the same footholds, with less base translation or reaction.

The stance graph gives each stance one base pose, that of the largest margin over the thresholds.
With the footholds fixed any pose that meets the thresholds will do, as long as each step is an edge
by the same checks. The path of minimum base translation is sought first among all candidate poses
of each stance, then among seeded samples around the poses of the best path. Each round is an exact
A* over a layered graph, one layer of poses for each stance, with the translation to the last layer,
steps not checked, as its heuristic; a step is checked when the search is about to use it.

Other costs of a step, such as its reaction, are known only once the robot is committed to it, and
take much longer to compute than its check. For these `varied` is a local search: one pose at a time
is moved and turned at random, and the change is kept if the sum of the costs falls (an evolution
strategy with one parent and one child: Rechenberg, Evolutionsstrategie, 1973).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count, pairwise
from typing import NamedTuple

import numpy as np
import scipy

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import PlanError
from mlivr_gym.motion.commitment import CommittedSteps, committed_motion
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_parts import Motion, Step, World
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.records import StanceArrays
from mlivr_gym.transitions.state import State

ROUNDS, SHRINK = 12, 0.8
"""Number of sampling rounds, and the factor by which the spread of the samples shrinks in each."""

SPREAD = (0.12, 0.3)
"""Standard deviations of the samples in the first round [m, rad]."""

SAMPLES = 60
"""Number of samples for each stance and round."""

STEP_BATCH = 8
"""Number of steps that are checked in one batch."""

VARIATIONS = 16
"""Number of times that `varied` tries to change each base pose."""

FIRST_VARIATION, GROWTH, DECAY = 0.5, 1.3, 0.8
"""Size of the first changes, as a fraction of `SPREAD`, and the factors by which the size for a
stance changes after a change that is kept and after one that is not."""

IMPOSSIBLE = "a step of the plan is not possible on this graph as the world is now"
"""Message if the search finds no path through the given base poses."""


def refined(graph: StanceGraph, plan: Plan, seed: int = 0) -> Plan:
    """Return a plan with the same footholds and no more base translation.

    The first base pose and the branches stay, the last base pose stays in the goal region. Query
    and counts are those of the plan, the cost is that of the new base path; if none is shorter, the
    plan itself is returned. Raises a `PlanError` if the plan belongs to another map or robot, or is
    not possible in the present world.
    """
    footholds = _Footholds(graph, plan)
    rng = np.random.default_rng(seed)
    layers = footholds.layers(footholds.candidate_poses())
    best, chosen = plan, footholds.search(layers)
    if chosen is None:
        raise PlanError(IMPOSSIBLE)
    for done in range(ROUNDS + 1):
        motion = committed_motion(graph, chosen.states, chosen.postures).motion
        if motion is not None:
            best = min(best, footholds.plan_of(motion), key=lambda p: p.base_translation)
        if done == ROUNDS:
            break
        layers = footholds.layers(
            footholds.samples(chosen.postures, rng, SHRINK**done), chosen.postures
        )
        chosen = footholds.search(layers) or chosen
    return best


def varied(
    graph: StanceGraph, plan: Plan, step_cost: Callable[[JointPath], float], seed: int = 0
) -> Plan:
    """Return a plan with the same footholds and no larger sum of the costs of its steps.

    What stays, and the errors, are those of `refined`; the base translation may grow. The search
    uses the preferred swing of each step.
    """
    footholds, cache = _Footholds(graph, plan), CommittedSteps(graph)
    known: dict[tuple[int, Step], float] = {}

    def cost_of(motion: Motion) -> float:
        total = 0.0
        for k, step in enumerate(motion.steps):
            if (k, step) not in known:
                known[k, step] = step_cost(motion.joint_path(graph.robot, k))
            total += known[k, step]
        return total

    postures = footholds.given_postures()
    states = footholds.states_along(postures, (footholds.start,), 0)
    if states is None:
        raise PlanError(IMPOSSIBLE)
    best, least = plan.motion, cost_of(plan.motion)
    rng, sizes = np.random.default_rng(seed), np.full(len(states), FIRST_VARIATION)
    for _ in range(VARIATIONS):
        layers = footholds.layers(footholds.variations(postures, rng, sizes), postures)
        for k, layer in enumerate(layers):
            for row in range(1, len(layer.w_b)):
                new = layer.take(slice(row, row + 1))
                tried = join(postures.take(slice(k)), new, postures.take(slice(k + 1, None)))
                along = footholds.states_along(tried, states, k - 1)
                motion = along and committed_motion(graph, along, tried, cache).motion
                if along and motion and cost_of(motion) < least:
                    postures, states, best, least = tried, along, motion, cost_of(motion)
                    sizes[k] *= GROWTH
                    break
            else:
                sizes[k] *= DECAY
    return footholds.plan_of(best)


class _PosedPath(NamedTuple):
    """The states of a path, and the postures in them."""

    states: tuple[State, ...]
    postures: Postures


class _PoseNode(NamedTuple):
    """A posture of a stance that the search reached."""

    layer: int
    row: int
    """Index of the posture among those of all stances."""
    branch_sets: tuple[int, ...]
    cost: float
    parent: _PoseNode | None


class _PendingSteps(NamedTuple):
    """Unchecked steps from a node to the next stance, the lowest estimate first."""

    node: _PoseNode
    rows: IntArray
    """Indices of the postures, shape (k,)."""
    estimate: Array
    """Length of the whole base path through each posture [m], shape (k,)."""


Poses = list[tuple[Array, Array]]
"""Base positions, shape (k, 3) [m], and rotations, shape (k, 3, 3), for each stance."""


def check_fits(graph: StanceGraph, plan: Plan) -> None:
    """Raise a `PlanError` if a plan was made for another map or robot than a graph."""
    plan.check_map(graph.grasp_map)
    if plan.world.robot != graph.robot:
        raise PlanError(
            f"the plan was made for robot {plan.world.robot.name!r}, which is not the "
            f"{graph.robot.name!r} of this graph"
        )


class _Footholds:
    """The stances of a plan, with the poses and branches that are fixed."""

    def __init__(self, graph: StanceGraph, plan: Plan) -> None:
        check_fits(graph, plan)
        self.graph, self.plan, self.query = graph, plan, plan.query
        self.stances = [graph.indices(stance) for stance in plan.stances]
        motion = plan.motion
        self.given = [
            graph.given_pose_of(*parts)
            for parts in zip(
                self.stances, motion.base_positions, motion.base_quaternions, strict=True
            )
        ]
        self.start = graph.state(self.stances[0], self.given[0], motion.joint_positions[0])
        distance = float(np.linalg.norm(motion.base_positions[-1] - np.array(self.query.goal)))
        self.ends_at_goal = distance <= self.query.goal_tolerance
        """Whether the plan ends in its goal region; if not, its last pose is fixed."""

    def candidate_poses(self) -> Poses:
        """Return all candidate base poses of each stance."""
        return [self.graph.solver.candidate_poses(stance) for stance in self.stances]

    def samples(self, postures: Postures, rng: np.random.Generator, fraction: float) -> Poses:
        """Return base poses sampled around some postures, one for each stance.

        Their spread is a fraction of `SPREAD`, for half of the samples three tenths of it.
        """
        size = fraction * np.where(np.arange(SAMPLES) % 2, 1.0, 0.3)[:, None]
        return [
            _moved(postures, k, size * rng.normal(size=(2, SAMPLES, 3)))
            for k in range(len(self.stances))
        ]

    def variations(self, postures: Postures, rng: np.random.Generator, sizes: Array) -> Poses:
        """Return two base poses for each stance, moved and turned by opposite random amounts.

        The amounts are fractions of `SPREAD`, with the standard deviations `sizes`, shape (K,).
        """
        amounts = [size * rng.normal(size=(2, 1, 3)) for size in sizes.tolist()]
        return [
            _moved(postures, k, np.concatenate([one, -one], axis=1))
            for k, one in enumerate(amounts)
        ]

    def given_postures(self) -> Postures:
        """Return the postures of the plan."""
        graph, branch_sets = self.graph, self.start.branch_sets
        states = zip(self.stances, self.given, strict=True)
        return graph.postures_of([State(stance, branch_sets, pose) for stance, pose in states])

    def states_along(
        self, postures: Postures, known: tuple[State, ...], first: int
    ) -> tuple[State, ...] | None:
        """Return the states of the plan in given postures; None if a step is no edge.

        States are known up to stance `first`, and all of them if only the posture of the next one
        is new.
        """
        states = known
        for k in range(first, len(self.stances) - 1):
            both = postures.take(slice(k, k + 2))
            after = self.graph.state_after(states[k], self.stances[k + 1], both)
            if after is None:
                return None
            if k > first and states[k + 1 : k + 2] == (after,):
                break
            states = (*states[: k + 1], after, *states[k + 2 :])
        return states

    def plan_of(self, motion: Motion) -> Plan:
        """Return the plan with a motion on its footholds, and the cost of that."""
        plan, spent = self.plan, self.plan.statistics
        cost = plan.query.cost_of(motion.base_positions)
        bound = spent.bound
        if bound is not None and cost > spent.cost:
            bound = bound * cost / spent.cost if spent.cost > 0.0 else None
        statistics = replace(spent, cost=cost, bound=bound)
        return Plan(plan.query, World.of(self.graph), motion, statistics)

    def layers(self, poses: Poses, known: Postures | None = None) -> list[Postures]:
        """Return the postures from which each stance may take one, the present posture first."""
        graph = self.graph
        thresholds = graph.settings.thresholds(graph.limbs)
        layers, last = [], len(self.stances) - 1
        for k, (stance, (positions, rotations)) in enumerate(zip(self.stances, poses, strict=True)):
            given = State(stance, self.start.branch_sets, self.given[k])
            first = graph.posture_of(given) if known is None else known.take(slice(k, k + 1))
            if k == 0 or (k == last and not self.ends_at_goal):
                layers.append(first)
                continue
            points = np.tile(np.array(stance, dtype=np.int64), (len(positions), 1))
            found = graph.postures_at(points, positions, rotations, thresholds)
            both = join(first, found)
            good = graph.is_node(both)
            if k == last:
                distance = np.linalg.norm(both.base_position - np.array(self.query.goal), axis=1)
                good &= distance <= self.query.goal_tolerance
            layers.append(both.take(good))
        return layers

    def search(self, layers: list[Postures]) -> _PosedPath | None:
        """Return the path of minimum base translation over some postures of each stance."""
        graph, last = self.graph, len(layers) - 1
        postures = join(*layers)
        sizes = [len(layer.w_b) for layer in layers]
        starts = np.concatenate([[0], np.cumsum(sizes)])
        points = np.repeat(np.array(self.stances, dtype=np.int64), sizes, axis=0)
        stances, costs_to_go = graph.checks.stances(points, postures), _costs_to_go(layers)
        order, closed = count(), dict[int, list[tuple[int, ...]]]()
        first = _PoseNode(0, 0, self.start.branch_sets, 0.0, None)
        queue: list[tuple[float, int, _PoseNode | _PendingSteps]] = [(0.0, next(order), first)]
        while queue:
            _, _, item = heapq.heappop(queue)
            if isinstance(item, _PoseNode):
                if _is_dominated(item, closed):
                    continue
                if item.layer == last:
                    return self._posed_path(postures, item)
                after = slice(starts[item.layer + 1], starts[item.layer + 2])
                distance = np.linalg.norm(
                    postures.base_position[after] - postures.base_position[item.row], axis=1
                )
                estimate = item.cost + distance + costs_to_go[after]
                best = np.argsort(estimate, kind="stable")
                item = _PendingSteps(item, best + after.start, estimate[best])
            else:
                for node in self._expand(stances, item, postures):
                    total = node.cost + float(costs_to_go[node.row])
                    heapq.heappush(queue, (total, next(order), node))
                item = _PendingSteps(item.node, item.rows[STEP_BATCH:], item.estimate[STEP_BATCH:])
            if len(item.rows) and np.isfinite(item.estimate[0]):
                heapq.heappush(queue, (float(item.estimate[0]), next(order), item))
        return None

    def _expand(
        self, stances: StanceArrays, ahead: _PendingSteps, postures: Postures
    ) -> Iterator[_PoseNode]:
        """Yield the nodes that the first pending steps lead to, if they are edges."""
        graph, node, rows = self.graph, ahead.node, ahead.rows[:STEP_BATCH]
        if graph.settings.transitions:
            before = np.tile(np.array(node.branch_sets, dtype=np.int64), (len(rows), 1))
            steps = graph.checks.steps(stances, np.full(len(rows), node.row), rows)
            branch_sets = graph.branch_sets_of_steps(steps, stances, before)
        else:
            branch_sets = stances.branch_sets[rows]
        positions = postures.base_position
        for row, after in zip(rows.tolist(), branch_sets.tolist(), strict=True):
            if all(after):
                cost = node.cost + float(np.linalg.norm(positions[row] - positions[node.row]))
                yield _PoseNode(node.layer + 1, row, tuple(after), cost, node)

    def _posed_path(self, postures: Postures, node: _PoseNode) -> _PosedPath:
        """Return the path to a node; `postures` are those of all stances."""
        nodes = [node]
        while nodes[-1].parent is not None:
            nodes.append(nodes[-1].parent)
        nodes.reverse()
        after = (State(self.stances[node.layer], node.branch_sets) for node in nodes[1:])
        postures = postures.take(np.array([node.row for node in nodes]))
        return _PosedPath((self.start, *after), postures)


def _moved(postures: Postures, k: int, amounts: Array) -> tuple[Array, Array]:
    """Return base poses near that of stance `k`, positions (n, 3) [m] and rotations (n, 3, 3).

    They are moved in the world, and then turned, by `amounts` of `SPREAD`, shape (2, n, 3).
    """
    moves, turns = (spread * some for spread, some in zip(SPREAD, amounts, strict=True))
    turned = scipy.spatial.transform.Rotation.from_rotvec(turns).as_matrix()
    return postures.base_position[k] + moves, turned @ postures.base_rotation[k]


def _costs_to_go(layers: list[Postures]) -> Array:
    """Return the minimum base translation to the last stance, steps not checked [m]."""
    ahead = [np.zeros(len(layers[-1].w_b))]
    for there, here in pairwise(layers[::-1]):
        distance = np.linalg.norm(here.base_position[:, None] - there.base_position[None], axis=2)
        ahead.append((distance + ahead[-1]).min(axis=1, initial=np.inf))
    return np.concatenate(ahead[::-1])


def _is_dominated(node: _PoseNode, closed: dict[int, list[tuple[int, ...]]]) -> bool:
    """Return whether a posture was reached before with all branches of a node; record it if not."""
    known = closed.setdefault(node.row, [])
    for branch_sets in known:
        if all(a & ~b == 0 for a, b in zip(node.branch_sets, branch_sets, strict=True)):
            return True
    known.append(node.branch_sets)
    return False
