"""What the robot believes of the world: its map, what it has seen beside it, and what refused it.

Hits are the surface points that rays of the depth cameras measured. Those that no known box
explains are counted in a grid of cubes. Cubes with enough hits are obstacles, merged into boxes,
until the cameras look through them, see `hit_cubes`. Where the robot is at present there is nothing
else, so cubes that may be nearer to it than the clearance are left out as long as it is there.

The graph and the check of a path are told only what they do not know yet: cubes that have become
obstacles, or whose hits have spread. So the graph may be told what the cameras see during a step,
and the robot plans on while it moves.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arguments import InstanceOf, Validators, checked
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.collisions import Configuration, LimbShapes, checked_configuration
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop.hit_cubes import CAUTIONS, CUBE, SENSED, Caution, HitCubes
from mlivr_gym.extensions.closed_loop.known_boxes import (
    HITS,
    NOISE,
    ROUNDING,
    KnownBoxes,
    mark_around,
)
from mlivr_gym.extensions.closed_loop.path_check import PathCheck, robot_axes, robot_radii
from mlivr_gym.motion import Trajectory
from mlivr_gym.schema import Anything, Integer, OrNone
from mlivr_gym.sharing import Independent
from mlivr_gym.stances import StanceGraph, State
from mlivr_gym.world import Box

APART = 3
"""Number of cubes by which an obstacle must be away from all others to be told as a new one."""

DOUBTFUL_LOOKS = 2
"""Number of looks through the hits of a cube after which it is doubted if no plan exists."""

GRID_BORDER = 0.5
"""Distance by which the grid extends beyond the cabin [m]."""

MAX_SAMPLE = 2**31 - 1
"""Largest number of a sample of a trajectory."""

CELL = 4
"""Edge of the cells of `Belief.occupancy`, in cubes."""

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


class Belief(Independent):
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
    freed
        How many cubes of obstacles that were seen have been looked through later.
    shapes
        Collision shapes of the robot.
    """

    @checked(GIVEN)
    def __init__(self, graph: StanceGraph, noise: float) -> None:
        """Believe in the map and the obstacles of a graph.

        `noise` is the standard deviation of a measured distance [m]. Raises a `SettingError` if it
        is no number from 0 to 0.1 m.
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
        self._is_told_of = np.zeros(shape, dtype=np.bool_)  # at most `APART` from an obstacle
        self._seen, self.freed = HitCubes(self._origin, grid[2], noise), 0
        self._is_there = self._seen.is_solid  # and not at the robot at present
        self._box_count, self._caution = 0, CAUTIONS[0]
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

        Doubted are those that the graph had and no camera has seen, and cubes through which it has
        looked `DOUBTFUL_LOOKS` times since they were hit; they may be seen later.
        """
        doubted, freed = self._known.doubt(), self._seen.free(DOUBTFUL_LOOKS)
        self.doubted += doubted
        self._find_solid(freed)
        self._is_there &= self._seen.is_solid
        return bool(doubted or freed) or self.tighten() or self.reconsider()

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

        The hits are measured positions of surfaces in the module frame [m], shape (k, 3), and
        `present` is the present configuration of the robot. With the origins of the rays [m], shape
        (k, 3), an obstacle of the graph, but not of the map, which enough rays have passed through,
        see `KnownBoxes`, is gone, and so is what was sensed, see `HitCubes`; the rays of a camera
        follow each other. By default none goes.

        Raises a `SettingError` if the hits are not all finite positions, there are not as many
        origins, or the configuration is not one of the robot. Nothing is taken in then.
        """
        present = checked_configuration(self.graph.robot, present)
        if origins is not None:
            self.gone += self._known.see_through(hits, origins)
        self._seen.count(*self._known.unexplained(hits))
        self._find_solid(0 if origins is None else self._seen.see_through(hits, origins))
        self._is_there = self._apart_from(present)
        there = self._seen.rows["cell"][self._is_there]
        new = there[~self._is_told_of[tuple(there.T)]]
        mark_around(new, APART, self._is_told_of)
        return len(new)

    def _find_solid(self, freed: int) -> None:
        """Find the cubes that are obstacles, after some were freed."""
        self.freed += freed
        self._seen.find_solid(self.caution.hits)
        if freed:  # what comes back is new
            cells = self._seen.rows["cell"][self._seen.is_solid]
            cells = cells[self._is_told_of[tuple(cells.T)]]
            self._is_told_of[:] = False
            mark_around(cells, APART, self._is_told_of)

    def _apart_from(self, configuration: Configuration) -> BoolArray:
        """Return which cubes are obstacles and not at the robot in a configuration, shape (k,)."""
        is_solid = self._seen.is_solid
        there, solid = is_solid.copy(), np.flatnonzero(is_solid)
        reach = 0.5 * np.sqrt(3.0) * CUBE + CAUTIONS[0].margin + self.graph.settings.clearance
        centres = self._seen.middles(self._seen.rows["cell"][solid])
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
        cubes, replaced = self._seen.rows, list[str]()
        if not len(cubes):
            return
        there = self._apart_from(self.graph.configuration(state))
        new = there & self._has_grown("graph_extent")
        if self._is_outdated or (cubes["is_in_graph"] & ~there).any():
            self._is_outdated = False
            before = (box.id for box in self.graph.obstacles)
            replaced, new = [name for name in before if name.startswith(f"{SENSED}/")], there
        if new.any() or replaced:
            boxes = self._seen.boxes_of(new, there, self.caution, self._box_count)
            self._box_count += len(boxes)
            self.graph.add_obstacles(boxes, replaced=replaced)
        cubes["is_in_graph"] = there
        cubes["graph_extent"][~there] = -np.inf
        cubes["graph_extent"][new] = cubes["extent"][new]

    def _has_grown(self, known: str) -> BoolArray:
        """Return which cubes have grown beyond an extent that is known, shape (k,)."""
        return self._seen.has_grown(known, self.caution.margin)

    @property
    def caution(self) -> Caution:
        """How large sensed boxes are now, and how many hits they need."""
        return self._caution

    def tighten(self) -> bool:
        """Take the next of `CAUTIONS` from now on; return whether there is one.

        There is none if nothing was sensed. `update_graph` then replaces all boxes.
        """
        if self._caution == CAUTIONS[-1] or not len(self._seen.rows):
            return False
        self._caution = CAUTIONS[CAUTIONS.index(self._caution) + 1]
        self._is_outdated = True
        self._find_solid(0)
        self._is_there &= self._seen.is_solid
        return True

    @checked(GIVEN)
    def is_blocked(self, trajectory: Trajectory, first: int) -> bool:
        """Return whether the robot comes closer than the clearance to what is new after a sample.

        New is what was sensed since the last call, or on the first one of a trajectory, what the
        graph does not have.
        """
        path, cubes = self.path(trajectory), self._seen.rows
        fresh = self._has_grown("path_extent") & self._is_there
        cubes["path_extent"][fresh] = cubes["extent"][fresh]
        return path.is_blocked(self._seen.boxes_of(fresh, fresh, self.caution), first)

    @checked(GIVEN)
    def will_touch(self, trajectory: Trajectory, sample: int, present: Configuration) -> bool:
        """Return whether the robot soon touches something if it stays as far from a trajectory.

        It should be at a sample of the trajectory, and is in its present configuration. What counts
        is the map, the obstacles that the graph had and that are not gone, and what was sensed,
        with the extent of the last of `CAUTIONS`, however close it is.

        Raises a `SettingError` if the trajectory has no such sample.
        """
        present, count = checked_configuration(self.graph.robot, present), len(trajectory.times)
        if sample >= count:
            raise SettingError(f"sample is {sample}; the trajectory has {count} samples, from 0")
        path, cells = self.path(trajectory), self._seen.rows["cell"]
        low, high = path.bounds_ahead(sample)
        corners = self._origin + CUBE * cells
        chosen = ((corners <= high) & (corners + CUBE >= low)).all(axis=1) & self._seen.is_solid
        seen = self._seen.boxes_of(chosen, chosen, CAUTIONS[-1])
        return path.will_touch((*self._known.boxes, *seen), sample, present)

    @checked(GIVEN)
    def path(self, trajectory: Trajectory) -> PathCheck:
        """Return the check of a trajectory; that of the last one is kept.

        A trajectory that is not the last one was planned among what the graph has.
        """
        if self._path is None or self._path.trajectory is not trajectory:
            self._path = PathCheck(self.graph, self.shapes, trajectory)
            self._seen.rows["path_extent"] = self._seen.rows["graph_extent"]
        return self._path

    def boxes(self) -> tuple[Box, ...]:
        """Return the boxes that were sensed."""
        return self._seen.boxes_of(self._is_there, self._is_there, self.caution)

    def occupancy(self) -> BoolArray:
        """Return in which cells of the module obstacles are believed, shape (nx, ny, nz).

        Cells have edges of `CELL` cubes; the first begins at the corner of the grid of cubes.
        """
        cells = np.zeros(-(-np.array(self._is_told_of.shape) // CELL), dtype=np.bool_)
        cells[tuple((self._seen.rows["cell"][self._is_there] // CELL).T)] = True
        return cells
