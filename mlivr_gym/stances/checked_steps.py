"""The releases and steps of a robot on a map, among the present obstacles."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.errors import StanceError
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath, Integer
from mlivr_gym.settings import Settings
from mlivr_gym.stances.obstacles import ChangingWorld
from mlivr_gym.transitions.records import StanceArrays
from mlivr_gym.transitions.state import State, Successors
from mlivr_gym.world.grasp_map import GraspMap

Pieces = Callable[[str, int], Iterable[slice]]
"""A function that divides a number of items of some kind into pieces, to work on them in turn."""


def at_once(kind: str, count: int) -> Iterable[slice]:
    """Return one piece with all items."""
    return (slice(count),)


MOST_RELEASES = 1 << 16
"""Number of releases without obstacles that are kept for other obstacles; they take some 30 MB."""


class CheckedSteps(ChangingWorld):
    """Releases and steps between stances whose postures are given; releases are stored."""

    def __init__(
        self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings, solver: PostureSolver
    ) -> None:
        """Start with no results."""
        super().__init__(grasp_map, robot, settings, solver)
        self._releases: dict[tuple[bytes, int], Any] = {}
        self._free_releases: dict[tuple[bytes, int], Any] = {}

    def _world_changed(self) -> None:
        self._releases = {}

    @abstractmethod
    def posture_of(self, state: State) -> Postures:
        """Return the posture of a state: that of its stance, or the pose that a user gave."""

    @abstractmethod
    def neighbouring_nodes(
        self, stance: tuple[int, ...], pieces: Pieces = at_once
    ) -> tuple[IntArray, Postures]:
        """Return the nodes in which one limb holds another point, shape (k, N), and their postures.

        They are in the order of limbs and points; steps to them are not checked.
        """

    @property
    @abstractmethod
    def max_displacement(self) -> float:
        """An upper bound of the base displacement of one step [m]."""

    def is_node(self, postures: Postures) -> BoolArray:
        """Return which stances are nodes of the graph, given by their postures, shape (k,)."""
        node: BoolArray = np.all(postures.branch_sets > 0, axis=1)
        return node

    @property
    def limbs(self) -> int:
        """Number of limbs."""
        return self.robot.limbs

    def releasable_branches(self, stance: tuple[int, ...], posture: Postures, limb: int) -> int:
        """Return the branches on which a limb can be released at a stance, 0 if none."""
        stances = self.checks.stances(np.array([stance]), posture)
        self._check_releases(stances, np.array([[0, limb]]))
        return int(stances.releases["branches"][0, limb])

    def all_releases(self, points: IntArray, postures: Postures) -> Any:
        """Return the releases of all limbs at stances: rows of `ReleaseRecord`, shape (k, N)."""
        stances = self.checks.stances(points, postures)
        self._check_releases(stances, np.indices(points.shape).reshape(2, -1).T)
        return stances.releases

    def _check_releases(self, stances: StanceArrays, todo: IntArray) -> None:
        """Compute releases that are not known, given by rows and limbs, shape (k, 2), once."""
        new = []
        todo = todo[~stances.releases["known"][todo[:, 0], todo[:, 1]]]
        for row, limb in todo.tolist():
            key = (stances.points[row].tobytes() + stances.base[row].tobytes(), limb)
            found = self._releases.get(key)
            if found is None:
                new.append((row, limb, key))
            else:
                stances.releases[row, limb] = found
        if not new:
            return
        unknown = np.array([k[:2] for k in new], dtype=np.int64)
        rows, limbs = unknown.T
        known, found = self._known_releases(stances, unknown)
        stances.releases[rows[known], limbs[known]] = found[known]
        if self.obstacles:
            self._check_releases_among_obstacles(stances, unknown, known, [key for *_, key in new])
        else:
            self.checks.release(stances, unknown[~known], self.checks.world(None))
        stances.releases["branches"][rows, limbs] &= stances.branch_sets[rows, limbs]
        for row, limb, key in new:
            self._releases[key] = stances.releases[row, limb].copy()

    @abstractmethod
    def _known_releases(self, stances: StanceArrays, todo: IntArray) -> tuple[BoolArray, Any]:
        """Return which releases are known without obstacles, shape (k,), and rows with those.

        They are given by rows and limbs, shape (k, 2); the rows are of `ReleaseRecord`.
        """

    @abstractmethod
    def _free_stances(self, stances: StanceArrays, rows: IntArray) -> StanceArrays:
        """Return some stances with the branches on which limbs may hold without obstacles."""

    def _check_releases_among_obstacles(
        self, stances: StanceArrays, todo: IntArray, known: BoolArray, keys: list[tuple[bytes, int]]
    ) -> None:
        """Compute releases among obstacles, each with its key; some are known without, (k,).

        The motion by which a limb is released is chosen without obstacles, which only remove
        branches from it: so obstacles never add a step. It is kept for other obstacles, and stays
        as it is out of their reach.
        """
        kept = self._free_releases
        if len(kept) > MOST_RELEASES:
            kept.clear()
        new = np.array([key not in kept for key in keys], dtype=np.bool_) & ~known
        if new.any():
            rows, limbs = todo[new].T
            free, items = self._free_stances(stances, rows), np.arange(len(rows))
            # Branches on which a table says that a limb cannot be released need no check.
            releases = free.releases[items, limbs]
            told = releases["known"]
            free.branch_sets[items[told], limbs[told]] = releases["branches"][told]
            self.checks.release(free, np.stack([items, limbs], axis=1), self.checks.world(None))
            for k, release in zip(
                np.flatnonzero(new).tolist(), free.releases[items, limbs], strict=True
            ):
                kept[keys[k]] = release.copy()
        for k in np.flatnonzero(~known).tolist():
            stances.releases[*todo[k]] = kept[keys[k]]
        every = stances._replace(branch_sets=np.full_like(stances.branch_sets, ALL))
        close = todo[self.may_touch_obstacles(stances.base["position"][todo[:, 0]])]
        self.checks.release(
            every, close, self.checks.world(self.obstacle_grid, obstacles_only=True)
        )

    def branch_set_after_grasp(self, state: State, limb: int) -> int:
        """Return the branches and flips that a limb may be on after it has grasped."""
        Integer(0, self.limbs - 1).read(limb, FieldPath("limb", StanceError))
        posture = self.posture_of(state)
        if not self.settings.transitions:
            return int(posture.branch_sets[0, limb])
        return self.releasable_branches(state.stance, posture, limb)

    def branch_sets_after(
        self,
        states: Sequence[State],
        here: Postures,
        before: IntArray,
        stances: IntArray,
        after: Postures,
    ) -> Any:
        """Return the branch sets after steps from states, shape (k, N); 0 without a step.

        Step k leaves the state of index `before[k]`, with the posture of that index in `here`, and
        leads to stance k with posture k of `after`.
        """
        if not self.settings.transitions or not len(stances):
            return after.branch_sets.copy()
        points = np.concatenate([np.array([s.stance for s in states], dtype=np.int64), stances])
        found = self.checks.stances(points, join(here, after))
        branch_sets = np.array([s.branch_sets for s in states], dtype=np.int64)[before]
        steps = self.checks.steps(found, before, np.arange(len(states), len(points)))
        return self.branch_sets_of_steps(steps, found, branch_sets)

    def successors_by_pieces(self, state: State, pieces: Pieces) -> Successors:
        """Return all steps that leave a state, checked piece by piece."""
        stances, postures = self.neighbouring_nodes(state.stance, pieces)
        posture, found = self.posture_of(state), [postures.branch_sets[:0]]
        for piece in pieces("steps", len(stances)):
            after, first = stances[piece], np.zeros(len(stances[piece]), dtype=np.int64)
            found.append(
                self.branch_sets_after([state], posture, first, after, postures.take(piece))
            )
        branch_sets = np.concatenate(found)
        kept = branch_sets.all(axis=1)
        limb = (stances[kept] != state.stance).argmax(axis=1)
        point, position = stances[kept, limb], postures.base_position[kept]
        return Successors(limb, point, position, branch_sets[kept])

    def branch_sets_of_steps(
        self, steps: Any, stances: StanceArrays, before: IntArray, *, are_free: bool = False
    ) -> IntArray:
        """Return the branch sets of all limbs after steps, shape (k, N); 0 for what is no step.

        The steps are those of `StepChecks.steps`, the branch sets before them have shape (k, N);
        stances receive the releases that are computed. `are_free` says that `StepRecord.kept` has
        what supports keep without obstacles.
        """
        world = self.checks.world(self.obstacle_grid, obstacles_only=are_free)
        possible = np.arange(len(steps))
        if not are_free and not stances.releases["known"].all():
            # Releases take longer to compute than whether the support limbs can follow.
            possible = np.flatnonzero(self.checks.can_follow(steps, stances, world))
        if self.settings.collisions:
            possible = self._releasable_steps(stances, steps, possible, before)
        chosen = steps[possible]
        self.checks.check(chosen, stances, world)
        kept, limb = chosen["kept"][:, : self.limbs] & before[possible], chosen["limb"]
        branch_sets: IntArray = np.zeros((len(steps), self.limbs), dtype=np.int64)
        branch_sets[possible] = kept
        grasped = stances.releases["branches"] if self.settings.collisions else stances.branch_sets
        branch_sets[possible, limb] = grasped[chosen["after"], limb]
        branch_sets[~branch_sets.all(axis=1)] = 0
        return branch_sets

    def _releasable_steps(
        self, stances: StanceArrays, steps: Any, able: IntArray, before: IntArray
    ) -> IntArray:
        """Return the indices of steps whose limb can be released before and after them.

        The releases of these limbs are then known. Branch sets before steps have shape (k, N).
        """
        for end in ("before", "after"):
            row, limb = steps[end][able], steps["limb"][able]
            if not stances.releases["known"][row, limb].all():
                self._check_releases(stances, np.unique(np.stack([row, limb], axis=1), axis=0))
            branches = stances.releases["branches"][row, limb]
            if end == "before":
                able = able[before[able, limb] & branches != 0]
            else:
                able = able[branches != 0]
        return able

    def kept_on_step(self, state: State, after: Sequence[int], posture: Postures) -> dict[int, int]:
        """Return the branches of a state that supports keep on a step, by limb; empty if none is.

        `posture` has the postures of both stances.
        """
        points = np.array([state.stance, tuple(after)], dtype=np.int64)
        stances = self.checks.stances(points, posture)
        steps = self.checks.steps(stances, np.zeros(1, np.int64), np.ones(1, np.int64))
        limb = int(steps["limb"][0])
        if self.settings.collisions:
            self._check_releases(stances, np.array([[0, limb], [1, limb]]))
        branch_sets = np.tile(np.array(state.branch_sets, dtype=np.int64), (2, 1))
        stances = stances._replace(branch_sets=branch_sets)
        self.checks.check(steps, stances, self.checks.world(self.obstacle_grid))
        return {i: int(kept) for i, kept in enumerate(steps["kept"][0]) if kept}


def join(*groups: Postures) -> Postures:
    """Return the postures of several groups in order."""
    return Postures(*(np.concatenate([getattr(g, name) for g in groups]) for name in FIELDS))
