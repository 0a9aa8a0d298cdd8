"""The environment whose fixed tasks lie in worlds that no other episode has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mlivr_gym import GraspMap, RobotSpec, State, robot_spec
from mlivr_gym.arguments import SEED, Reader, checked
from mlivr_gym.arrays import Array
from mlivr_gym.envs import TASKS, LayoutTasks, MlivrEnv, Observation, TaskGenerator
from mlivr_gym.errors import SettingError
from mlivr_gym.schema import Anything, FieldPath, ListOf, OrNone
from mlivr_gym.world import as_map

World = tuple[Any, Any]
"""A robot and a place, each as `MlivrEnv` takes it."""

TRAINING: tuple[World, ...] = (
    ("mlivr2", "jem"),
    ("mlivr2-ur3e", "jem"),
    ("mlivr2-ur3e", "columbus"),
)
"""Worlds of the episodes with seeds."""

HELD_OUT: tuple[World, ...] = (
    ("mlivr2-iiwa", "jem"),
    ("mlivr2-ur3e", "uslab"),
    ("mlivr2-ur3e", "hatch"),
    ("mlivr2-iiwa", "uslab"),
)
"""Worlds of the fixed tasks, in turn: the robot is unseen, the place, the place, and both."""


def _read_world(given: Any, place: FieldPath) -> tuple[RobotSpec, GraspMap]:
    """Return robot and map of a world; refuse one that is no pair, or has other than two limbs."""
    pair: Any = ListOf(Anything(), 2, 2).read(given, place)
    robot, where = pair
    spec = robot_spec(robot)
    if spec.limbs != 2:
        raise place.fault(f"has robot {spec.name!r} with {spec.limbs} limbs; it must have two")
    return spec, as_map(where)


WORLDS = ListOf(Reader(_read_world), 1, 64)
"""Validator of worlds."""

CHOSEN = ("robot", "map", "dynamics", "grasp_failure", "info_regret")
"""Arguments of `MlivrEnv` that this environment does not take."""


class UnseenEnv(MlivrEnv):
    """Climbing with robots and in places that are not seen in training.

    A *world* is a robot of two limbs and a place. Each reset draws one of the worlds for training;
    the fixed task k lies in the held-out world of number k modulo their number. Where start or goal
    is given, the world stays.

    Spaces are those of the place with the most points, M. With m points in the present place action
    `limb * m + point` moves `limb` to `point`, as in `MlivrEnv`, and actions from 2 m on are
    invalid. The observation has `points`, the positions x, y, z of the points [m], shape (3 M,),
    of which the first m exist, `exists`, whether each does, shape (M,), and `span`, how far apart
    limbs may hold points at most [m], shape (1,).

    `graph` is that of the present world, so what uses the environment works as in `MlivrEnv`.
    """

    @checked({"training": WORLDS, "held_out": WORLDS, "tasks": TASKS})
    def __init__(
        self,
        training: Sequence[World] = TRAINING,
        held_out: Sequence[World] = HELD_OUT,
        tasks: str | TaskGenerator | dict[str, Any] = "anywhere",
        **options: Any,
    ) -> None:
        """Build the environment; `tasks` and `options` are arguments of `MlivrEnv`.

        Raises a `MlivrError` if an argument cannot be used: robot and map are those of the worlds,
        dynamics are kinematic, no grasp fails, tasks have no layouts, and `info` has no regret.
        """
        drawn = TASKS.read(tasks, FieldPath("tasks", SettingError))
        if isinstance(drawn, LayoutTasks):
            raise SettingError(f"tasks is {tasks!r}; this environment has no layouts")
        for name in CHOSEN:
            if name in options:
                raise SettingError(f"{name} is given; this environment chooses it")
        seen, unseen = (
            WORLDS.read(worlds, FieldPath(name, SettingError))
            for name, worlds in (("training", training), ("held_out", held_out))
        )
        self._worlds, self._seen = (*seen, *unseen), len(seen)
        self._options = {"tasks": drawn, **options}
        super().__init__(*self._worlds[0], **self._options)
        self._made: dict[int, MlivrEnv] = {}
        span = max(robot.span for robot, _ in self._worlds)
        maps = [place for _, place in self._worlds]
        ends = np.concatenate([np.concatenate([one.positions, one.cabin]) for one in maps])
        bounds = ends.min(axis=0) - span, ends.max(axis=0) + span
        self._most = most = max(map(len, maps))
        self.action_space = spaces.Discrete(2 * most)
        usual: Any = self.observation_space
        self.observation_space = spaces.Dict({
            **usual.spaces,
            "stance": spaces.MultiDiscrete([most] * 2),
            "grasps": _box(bounds, (6,)),
            "base_position": _box(bounds, (3,)),
            "goal": _box(bounds, (3,)),
            "points": _box(bounds, (3 * most,)),
            "exists": spaces.MultiBinary(most),
            "span": spaces.Box(0.0, span, (1,), np.float32),
        })  # fmt: skip

    @checked({"seed": OrNone(SEED), "options": Anything()})
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode in a world that is drawn, or that of a fixed task; see `MlivrEnv.reset`.

        Raises a `MlivrError` as there.
        """
        gymnasium.Env.reset(self, seed=seed)
        task = options.get("task") if isinstance(options, Mapping) else None
        if not isinstance(options, Mapping) or not options:
            self._enter(int(self.np_random.integers(self._seen)))
        elif isinstance(task, int | np.integer):
            self._enter(self._seen + int(task) % (len(self._worlds) - self._seen))
        return super().reset(seed=seed, options=options)

    def _enter(self, world: int) -> None:
        """Continue in the world of a number, with what was computed for it before."""
        if world not in self._made:
            self._made[world] = MlivrEnv(*self._worlds[world], **self._options)
        made = self._made[world]
        if self.graph is not made.graph:
            self.close()
            self.graph, self.viewer, self._moves = made.graph, made.viewer, made.moves
            self.failure_probability = made.failure_probability
            self._moves_version, self._graph_version = made.graph.version, made.graph.version
            self._state = None

    def _enter_state(self, state: State) -> None:
        """Set the present state, see `MlivrEnv`; the mask goes on with actions that are invalid."""
        super()._enter_state(state)
        self._mask = np.concatenate([self._mask, np.zeros(2 * self._most - len(self._mask), bool)])

    def _observation(self) -> Observation:
        """Return the observation of the present state, with the points of the place."""
        seen: Any = super()._observation()
        positions, span = self.graph.grasp_map.positions, self.graph.robot.span
        seen["points"] = np.zeros(3 * self._most, dtype=np.float32)
        seen["points"][: positions.size] = positions.ravel()
        seen["exists"] = (np.arange(self._most) < len(positions)).astype(np.int8)
        seen["span"] = np.array([span], dtype=np.float32)
        made: Observation = seen
        return made


def _box(bounds: tuple[Array, Array], shape: tuple[int, ...]) -> spaces.Box:
    """Return the space of positions between bounds, each of shape (3,)."""
    low, high = (np.resize(bound, shape).astype(np.float32) for bound in bounds)
    return spaces.Box(low, high, shape, np.float32)
