"""Wrappers of the environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.observations import Observation
from mlivr_gym.pictures.film import RATE


class RecordVideo(gymnasium.wrappers.RecordVideo[Any, Any]):
    """Gymnasium's `RecordVideo`, whose films show how the robot moves from stance to stance.

    Gymnasium's own takes one picture an action, with this environment a slide show. Arguments are
    the same. Where that takes one picture for an action, this one takes
    `envs.moments.STEP_PICTURES`, with 25 pictures a second of film; `video_length` counts actions.
    The film is rendered when a recording ends, so that branches are chosen for all of it.

    Example:
        >>> env = gymnasium.make("MLIVR-JEM-v0", render_mode="rgb_array")
        >>> env = RecordVideo(env, "videos", episode_trigger=lambda episode: True)
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], video_folder: str, *args: Any, **settings: Any
    ) -> None:
        """Wrap a `MlivrEnv`; see Gymnasium's wrapper.

        Raises:
            ValueError: If the environment has no `render_mode` that returns pictures.
            gymnasium.error.DependencyNotInstalled: If MoviePy is missing.
        """
        super().__init__(env, video_folder, *args, **{"fps": RATE} | settings)

    def _capture_frame(self) -> None:
        """Keep what a picture would show."""
        self.recorded_frames.append(self.get_wrapper_attr("moment"))

    def stop_recording(self) -> None:
        """Render what was kept, and write the film."""
        self.recorded_frames = self.get_wrapper_attr("viewer").pictures(self.recorded_frames)
        super().stop_recording()  # type: ignore[no-untyped-call]


class ActionMaskObservation(
    gymnasium.ObservationWrapper[Any, Any, Any],
    gymnasium.utils.RecordConstructorArgs,
):
    """Puts the action mask into the observation, under `"action_mask"`."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Wrap a `MlivrEnv`."""
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner = env.observation_space
        assert isinstance(inner, spaces.Dict)
        assert isinstance(env.action_space, spaces.Discrete)
        self.observation_space = spaces.Dict(
            {**inner.spaces, "action_mask": spaces.MultiBinary(int(env.action_space.n))}
        )

    def observation(self, observation: Observation) -> dict[str, Any]:
        """The observation with the mask."""
        mask: BoolArray = self.get_wrapper_attr("action_masks")()
        return {**observation, "action_mask": mask.astype(np.int8)}

    def action_masks(self) -> BoolArray:
        """Which actions are allowed, for sb3-contrib."""
        mask: BoolArray = self.env.get_wrapper_attr("action_masks")()
        return mask
