"""Gymnasium wrappers: smooth films, and the action mask in the observation."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mlivr_gym.arguments import FileName, Function, Reader, checked
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation
from mlivr_gym.pictures.films import RATE
from mlivr_gym.schema import NAME, FieldPath, Flag, Integer, OrNone
from mlivr_gym.sharing import Independent

MAX_ACTIONS = 1_000_000
"""Maximum number of actions in a film."""


def _read_env(value: Any, path: FieldPath) -> Any:
    """Return an environment that is a `MlivrEnv`, possibly inside wrappers."""
    if not isinstance(value, gymnasium.Env) or not isinstance(value.unwrapped, MlivrEnv):
        raise path.refused(value, "a MlivrEnv, also inside wrappers")
    return value


WRAPPED_ENV = Reader(_read_env)
"""Validator of an environment that is a `MlivrEnv`, possibly inside wrappers."""


if TYPE_CHECKING:  # Gymnasium 1.2 has another number of type parameters
    GymnasiumRecordVideo = gymnasium.wrappers.RecordVideo[Any, Any]
else:
    GymnasiumRecordVideo = gymnasium.wrappers.RecordVideo


class RecordVideo(Independent, GymnasiumRecordVideo):
    """Gymnasium's `RecordVideo` with films that show the robot moving from stance to stance.

    Gymnasium's own wrapper takes one picture for each action, which makes a slide show of this
    environment. This one takes `envs.snapshots.FRAMES_PER_ACTION` pictures, at 10 pictures per
    second. The arguments are the same; `video_length` counts actions. The film is rendered when a
    recording ends, since branches are chosen for a whole episode.

    Examples
    --------
    >>> env = gymnasium.make("MLIVR-JEM-v0", render_mode="rgb_array")
    >>> every = lambda episode: True
    >>> env = RecordVideo(env, "videos", every)  # doctest: +SKIP
    """

    # Older versions of Gymnasium read it when a wrapper is deleted, also one that was refused.
    recorded_frames: list[Any] = []  # noqa: RUF012

    @checked(
        {
            "env": WRAPPED_ENV,
            "video_folder": FileName(),
            "episode_trigger": OrNone(Function()),
            "step_trigger": OrNone(Function()),
            "video_length": Integer(0, MAX_ACTIONS),
            "name_prefix": NAME,
            "fps": OrNone(Integer(1, 1000)),
            "disable_logger": Flag(),
        }
    )
    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        video_folder: str,
        episode_trigger: Callable[[int], bool] | None = None,
        step_trigger: Callable[[int], bool] | None = None,
        video_length: int = 0,
        name_prefix: str = "rl-video",
        fps: int | None = RATE,
        disable_logger: bool = True,
        **settings: Any,
    ) -> None:
        """Wrap a `MlivrEnv`; the arguments are those of Gymnasium's wrapper.

        Raises a `SettingError` if an argument cannot be used, a `ValueError` if the environment has
        no `render_mode` that returns pictures, and a `gymnasium.error.DependencyNotInstalled`
        without MoviePy.
        """
        super().__init__(
            env, video_folder, episode_trigger, step_trigger, video_length, name_prefix, fps,
            disable_logger, **settings,
        )  # fmt: skip

    def _capture_frame(self) -> None:
        """Store a snapshot in place of a picture."""
        self.recorded_frames.append(self.get_wrapper_attr("snapshot"))

    def stop_recording(self) -> None:
        """Render the snapshots, and write the film."""
        self.recorded_frames = self.get_wrapper_attr("viewer").pictures(self.recorded_frames)
        super().stop_recording()  # type: ignore[no-untyped-call]


class ActionMaskObservation(
    Independent,
    gymnasium.ObservationWrapper[Any, Any, Any],
    gymnasium.utils.RecordConstructorArgs,
):
    """Wrapper that adds the action mask to the observation, under `"action_mask"`.

    Examples
    --------
    >>> env = ActionMaskObservation(gymnasium.make("mlivr_gym:MLIVR-JEM-v0"))
    >>> observation, info = env.reset(seed=0)
    >>> bool((observation["action_mask"] == info["action_mask"]).all())
    True
    """

    @checked({"env": WRAPPED_ENV})
    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Wrap a `MlivrEnv`; raise a `SettingError` if the environment is none."""
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner: Any = env.observation_space
        actions: Any = env.action_space
        self.observation_space = spaces.Dict(
            {**inner.spaces, "action_mask": spaces.MultiBinary(int(actions.n))}
        )

    @checked()
    def observation(self, observation: Observation) -> dict[str, Any]:
        """Return the observation with the action mask."""
        mask: BoolArray = self.get_wrapper_attr("action_masks")()
        return {**observation, "action_mask": mask.astype(np.int8)}

    def action_masks(self) -> BoolArray:
        """Return which actions are valid, shape (N m,), as `MaskablePPO` requires."""
        mask: BoolArray = self.env.get_wrapper_attr("action_masks")()
        return mask
