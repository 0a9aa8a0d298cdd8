"""What the robot believes of the world: its map, what it has seen beside it, and what refused it.

Hits are the surface points that rays of the depth cameras measured. Those that no known box
explains are counted in a grid of cubes. Cubes with enough hits are obstacles, merged into boxes.
Counts are kept: what was seen lasts. Where the robot is at present there is nothing else, so cubes
that may be nearer to it than the clearance are left out as long as it is there.

The graph and the check of a path are told only what they do not know yet: cubes that have become
obstacles, or whose hits have spread. So the graph may be told what the cameras see during a step,
and the robot plans on while it moves.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from mlivr_gym.arguments import InstanceOf, Validators, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.closed_loop.cautions import CAUTIONS, Caution
from mlivr_gym.closed_loop.known_boxes import HITS, NOISE, ROUNDING, KnownBoxes, mark_around
from mlivr_gym.closed_loop.path_check import PathCheck, robot_axes, robot_radii
from mlivr_gym.collisions.contacts import Configuration, checked_configuration
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.schema import Anything, Integer, OrNone
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.mesh_boxes import merged_cells

CUBE = 0.05
"""Edge of the cubes [m]."""

LEAST_GROWTH = 0.005
"""Growth of a sensed box below which it is not told anew, even without a margin [m]."""

APART = 3
"""Number of cubes by which an obstacle must be away from all others to be told as a new one."""

GRID_BORDER = 0.5
"""Distance by which the grid extends beyond the cabin [m]."""

MAX_SAMPLE = 2**31 - 1
"""Largest number of a sample of a trajectory."""

CELL = 4
"""Edge of the cells of `Belief.occupancy`, in cubes."""

SENSED = "sensed"
"""First part of the ids of boxes that were sensed."""

GIVEN: Validators = {
    "graph": InstanceOf(StanceGraph),
    "noise": NOISE,
    "hits": HITS,
    "origins": OrNone(HITS),
    "present": Anything(),  # read by `checked_configuration`
    "trajectory": InstanceOf(Trajectory),
    "first": Integer(0, MAX_SAMPLE),
    "sample": Integer(0, MAX_SAMPLE),
    "state": InstanceOf(State),
}
"""Validators of the arguments."""

_CUBES = np.dtype(
    [
        ("cell", np.int64, 3),  # index along each axis of the grid
        ("count", np.int64),  # number of hits
        ("is_sure", np.bool_),  # whether it has enough hits
        ("extent", np.float64, (2, 3)),  # of the hits: their negative minimum, and maximum [m]
        ("graph_extent", np.float64, (2, 3)),  # what the graph was told of it
        ("path_extent", np.float64, (2, 3)),  # what the check of the present path was told of it
        ("is_in_graph", np.bool_),
    ]
)


class Belief:
    """The stance graph of a robot whose map is incomplete, which grows by what is sensed.

    Attributes
    ----------
    graph
        The stance graph, whose obstacles and occupied points are those believed.
    refused
        Indices of the points that count as occupied after attempts to grasp them.
    avoided
        Indices of the points that count as occupied after paths to them were blocked.
    gone
        Ids of the obstacles that the graph had, through which the cameras have looked.
    doubted
        Ids of those that were given up because no plan existed, see `relax`.
    shapes
        Collision shapes of the robot.
    """

    @checked(GIVEN)
    def __init__(self, graph: StanceGraph, noise: float) -> None:
        """Believe in the map and the obstacles of a graph.

        Parameters
        ----------
        graph
            The stance graph.
        noise
            Standard deviation of a measured distance [m].

        Raises
        ------
        SettingError
            If the noise is no number from 0 to 1 m.
        """
        self.graph, self.refused, self.avoided = graph, set[int](), set[int]()
        self._has_reconsidered = False
        cabin = graph.grasp_map.cabin
        self._origin = cabin[0] - GRID_BORDER
        shape = np.ceil((cabin[1] - cabin[0] + 2.0 * GRID_BORDER) / CUBE).astype(np.int64)
        self._before = graph.obstacles
        grid = self._origin, CUBE, tuple(shape.tolist())
        self._known = KnownBoxes(graph.grasp_map.boxes, noise, grid, graph.obstacles)
        self.gone, self.doubted = list[str](), list[str]()
        self.shapes = LimbShapes(graph.robot)
        self._row = np.full(shape, -1, dtype=np.int64)  # of each cube, -1 for one without hits
        self._is_beside = np.zeros(shape, dtype=np.bool_)  # touches a cube with enough hits
        self._is_told_of = np.zeros(shape, dtype=np.bool_)  # at most `APART` from an obstacle
        self._cubes = np.zeros(0, dtype=_CUBES)
        self._is_solid = np.zeros(0, dtype=np.bool_)  # whether a cube is an obstacle
        self._is_there = self._is_solid  # and not at the robot at present
        self._box_count, self._noise, self._caution = 0, noise, CAUTIONS[0]
        self._is_outdated = False  # whether all boxes of the graph must be replaced
        self._path: PathCheck | None = None

    def refuse(self, point: int) -> None:
        """Let a point count as occupied, since attempts to grasp it failed."""
        self.graph.occupy([point])
        self.refused.add(point)

    def avoid(self, point: int) -> None:
        """Let a point count as occupied, since paths to it were blocked."""
        self.graph.occupy([point])
        self.avoided.add(point)

    def reconsider(self) -> bool:
        """Let the points that are avoided be free again, once; return whether there are any."""
        if self._has_reconsidered or not self.avoided:
            return False
        self._has_reconsidered = True
        self.graph.vacate(sorted(self.avoided))
        self.avoided.clear()
        return True

    def relax(self) -> bool:
        """Doubt obstacles, else `tighten`, else `reconsider`; return whether one of them can be.

        Doubted are those that the graph had and no camera has seen; they may be seen later.
        """
        doubted = self._known.doubt()
        self.doubted += doubted
        return bool(doubted) or self.tighten() or self.reconsider()

    def withdraw(self) -> None:
        """Let the graph have nothing any more that was sensed."""
        names = {box.id for box in self._before}
        others = [box for box in self.graph.obstacles if box.id not in names]
        others = [box for box in others if not box.id.startswith(f"{SENSED}/")]
        self.graph.remove_obstacles()
        self.graph.add_obstacles([*self._before, *others])
        self.graph.vacate(sorted(self.refused | self.avoided))

    @checked(GIVEN)
    def add_hits(self, hits: Array, present: Configuration, origins: Array | None = None) -> int:
        """Take in hits of rays; return the number of cubes that are parts of new obstacles.

        New obstacles are more than `APART` cubes away from all that were seen before. The graph is
        as before until `update_graph`.

        Parameters
        ----------
        hits
            Measured positions of surfaces in the module frame [m], shape (k, 3).
        present
            The present configuration of the robot.
        origins
            Where the rays began [m], shape (k, 3). An obstacle of the graph, but not of the map,
            which enough rays have passed through, see `KnownBoxes`, is gone. By default none goes.

        Raises
        ------
        SettingError
            If the hits are not all finite positions, there are not as many origins, or the
            configuration is not one of the robot. Nothing is taken in then.
        """
        present = checked_configuration(self.graph.robot, present)
        if origins is not None:
            self.gone += self._known.see_through(hits, origins)
        unexplained, cells = self._known.unexplained(hits)
        self._count(unexplained, cells)
        self._find_sure()
        self._is_there = self._apart_from(present)
        there = self._cubes["cell"][self._is_there]
        new = there[~self._is_told_of[tuple(there.T)]]
        mark_around(new, APART, self._is_told_of)
        return len(new)

    def _count(self, hits: Array, cells: IntArray) -> None:
        """Count hits in their cubes, shape (k, 3) each; a cube that has none yet gets a row."""
        number = np.ravel_multi_index(tuple(cells.T), self._row.shape)
        order = np.argsort(number)
        begins = np.flatnonzero(np.diff(number[order], prepend=-1))
        found, hits = cells[order[begins]], hits[order]
        rows, fresh = self._row[tuple(found.T)], found[self._row[tuple(found.T)] < 0]
        if len(fresh):
            rows[rows < 0] = len(self._cubes) + np.arange(len(fresh))
            self._row[tuple(found.T)] = rows
            added = np.zeros(len(fresh), dtype=_CUBES)
            added["cell"] = fresh
            added["extent"] = added["graph_extent"] = added["path_extent"] = -np.inf
            self._cubes = np.concatenate([self._cubes, added])
        if len(rows):
            self._cubes["count"][rows] += np.diff(begins, append=len(number))
            both = np.maximum.reduceat(np.stack([-hits, hits], axis=1), begins)
            self._cubes["extent"][rows] = np.maximum(self._cubes["extent"][rows], both)

    def _find_sure(self) -> None:
        """Find the cubes that have got enough hits, those beside them, and so the obstacles."""
        cubes, is_sure = self._cubes, self._cubes["count"] >= self.caution.hits
        mark_around(cubes["cell"][is_sure & ~cubes["is_sure"]], 1, self._is_beside)
        cubes["is_sure"] = is_sure
        self._is_solid = self._is_beside[tuple(cubes["cell"].T)]

    def _apart_from(self, configuration: Configuration) -> BoolArray:
        """Return which cubes are obstacles and not at the robot in a configuration, shape (k,)."""
        there, solid = self._is_solid.copy(), np.flatnonzero(self._is_solid)
        reach = 0.5 * np.sqrt(3.0) * CUBE + CAUTIONS[0].margin + self.graph.settings.clearance
        centres = self._origin + CUBE * (self._cubes["cell"][solid] + 0.5)
        axes = robot_axes(self.graph.robot, self.shapes, configuration)
        outside = np.maximum(axes.min(axis=(0, 1)) - centres, centres - axes.max(axis=(0, 1)))
        is_within = (outside <= reach + robot_radii(self.shapes).max() + ROUNDING).all(axis=1)
        solid, centres = solid[is_within], centres[is_within]
        first, second = axes.swapaxes(0, 1)
        along = second - first
        square = np.maximum(np.sum(along * along, axis=1), 1e-12)
        share = np.sum((centres[:, None] - first) * along, axis=2) / square
        nearest = first + np.clip(share, 0.0, 1.0)[..., None] * along
        away = np.linalg.norm(centres[:, None] - nearest, axis=2) - robot_radii(self.shapes)
        there[solid[(away <= reach).any(axis=1)]] = False
        return there

    @checked(GIVEN)
    def update_graph(self, state: State) -> None:
        """Let the graph have the obstacles that are believed now, but for a robot in a state.

        It is told of what has come up. Only where obstacles must go, since the robot is there, all
        are replaced. The state has one branch for each limb, unless nothing was sensed yet.
        """
        known = {box.id for box in self.graph.obstacles}
        if gone := known.intersection(self.gone + self.doubted):
            self.graph.remove_obstacles(sorted(gone))
        if not len(self._cubes):
            return
        cubes, replaced = self._cubes, list[str]()
        there = self._apart_from(self.graph.configuration(state))
        new = there & self._has_grown("graph_extent")
        if self._is_outdated or (cubes["is_in_graph"] & ~there).any():
            self._is_outdated = False
            before = (box.id for box in self.graph.obstacles)
            replaced, new = [name for name in before if name.startswith(f"{SENSED}/")], there
        if new.any() or replaced:
            boxes = self._boxes_of(new, there, self._box_count)
            self._box_count += len(boxes)
            self.graph.add_obstacles(boxes, replaced=replaced)
        cubes["is_in_graph"] = there
        cubes["graph_extent"][~there] = -np.inf
        cubes["graph_extent"][new] = cubes["extent"][new]

    def _has_grown(self, known: str) -> BoolArray:
        """Return which cubes have grown beyond an extent that is known, shape (k,)."""
        least = max(self.caution.margin, LEAST_GROWTH)
        grown = self._cubes["extent"] - self._cubes[known] > least
        return np.asarray(grown.any(axis=(1, 2)))

    @property
    def caution(self) -> Caution:
        """How large sensed boxes are now, and how many hits they need."""
        return self._caution

    def tighten(self) -> bool:
        """Take the next of `CAUTIONS` from now on; return whether there is one.

        There is none if nothing was sensed. `update_graph` then replaces all boxes.
        """
        if self._caution == CAUTIONS[-1] or not len(self._cubes):
            return False
        hits, self._caution = self._caution.hits, CAUTIONS[CAUTIONS.index(self._caution) + 1]
        if self._caution.hits > hits:
            self._is_beside[:], self._cubes["is_sure"] = False, False
        self._is_outdated = True
        self._find_sure()
        self._is_there &= self._is_solid
        return True

    @checked(GIVEN)
    def is_blocked(self, trajectory: Trajectory, first: int) -> bool:
        """Return whether the robot comes closer than the clearance to what is new after a sample.

        New is what was sensed since the last call, or on the first one of a trajectory, what the
        graph does not have.
        """
        path, cubes = self.path(trajectory), self._cubes
        fresh = self._has_grown("path_extent") & self._is_there
        cubes["path_extent"][fresh] = cubes["extent"][fresh]
        return path.is_blocked(self._boxes_of(fresh, fresh), first)

    @checked(GIVEN)
    def will_touch(self, trajectory: Trajectory, sample: int, present: Configuration) -> bool:
        """Return whether the robot soon touches something if it stays as far from a trajectory.

        It should be at a sample of the trajectory, and is in its present configuration. What counts
        is the map, the obstacles that the graph had and that are not gone, and what was sensed,
        with the extent of the last of `CAUTIONS`, however close it is.
        """
        present = checked_configuration(self.graph.robot, present)
        path, cells = self.path(trajectory), self._cubes["cell"]
        low, high = path.bounds_ahead(sample)
        corners = self._origin + CUBE * cells
        chosen = self._is_beside[tuple(cells.T)]
        chosen &= ((corners <= high) & (corners + CUBE >= low)).all(axis=1)
        seen = self._boxes_of(chosen, chosen, caution=CAUTIONS[-1])
        return path.will_touch((*self._known.boxes, *seen), sample, present)

    @checked(GIVEN)
    def path(self, trajectory: Trajectory) -> PathCheck:
        """Return the check of a trajectory; that of the last one is kept.

        A trajectory that is not the last one was planned among what the graph has.
        """
        if self._path is None or self._path.trajectory is not trajectory:
            self._path = PathCheck(self.graph, self.shapes, trajectory)
            self._cubes["path_extent"] = self._cubes["graph_extent"]
        return self._path

    def boxes(self) -> tuple[Box, ...]:
        """Return the boxes that were sensed."""
        return self._boxes_of(self._is_there, self._is_there)

    def occupancy(self) -> BoolArray:
        """Return in which cells of the module obstacles are believed, shape (nx, ny, nz).

        Cells have edges of `CELL` cubes; the first begins at the corner of the grid of cubes.
        """
        count = -(-np.array(self._row.shape) // CELL)
        cells = np.zeros(count, dtype=np.bool_)
        cells[tuple((self._cubes["cell"][self._is_there] // CELL).T)] = True
        return cells

    def _boxes_of(
        self, chosen: BoolArray, there: BoolArray, number: int = 0, caution: Caution | None = None
    ) -> tuple[Box, ...]:
        """Return boxes that contain the hits in chosen cubes and the margin about them.

        They may contain other cubes that are there. Their ids count from a number. A caution, by
        default the present one, decides how large they are.
        """
        caution = caution or self.caution
        if not chosen.any():
            return ()
        if not caution.is_merged:
            cubes, begins = np.flatnonzero(chosen), np.arange(np.sum(chosen))
        else:
            cubes, begins = self._merged(chosen, there)
        extent = np.maximum.reduceat(self._cubes["extent"][cubes], begins)
        below, high = extent.swapaxes(0, 1)
        count = np.add.reduceat(self._cubes["count"][cubes], begins)
        excess = caution.is_denoised * self._noise * _outermost(count)[:, None]
        inwards = np.minimum(excess, 0.5 * (high + below)) - caution.margin
        return Box.each_between(f"{SENSED}/", "obstacle", inwards - below, high - inwards, number)

    def _merged(self, chosen: BoolArray, there: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the cubes in boxes of chosen cubes, and where those of each box begin."""
        cells = self._cubes["cell"]
        corner, end = cells[chosen].min(axis=0), cells[chosen].max(axis=0) + 1
        inside = np.flatnonzero(there & ((cells >= corner) & (cells < end)).all(axis=1))
        row = np.full(end - corner, -1)
        row[tuple((cells[inside] - corner).T)] = inside
        is_chosen = np.zeros(row.shape, dtype=np.bool_)
        is_chosen[tuple((cells[chosen] - corner).T)] = True
        parts = []
        for first, last in merged_cells(is_chosen, row >= 0):
            where = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
            parts.append(row[where].ravel())
        return np.concatenate(parts), np.cumsum([0, *map(len, parts[:-1])])


def _outermost(count: IntArray) -> Array:
    """Return the means of the largest of some standard normal numbers (Blom 1958)."""
    return np.asarray(ndtri((count - 0.375) / (count + 0.25)))
