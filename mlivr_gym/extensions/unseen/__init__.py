"""Robots and places that are not seen in training: one environment for several worlds."""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.unseen.env import HELD_OUT, TRAINING, UnseenEnv

__all__ = ["HELD_OUT", "TRAINING", "UnseenEnv"]

ENVIRONMENTS = {
    "MLIVR-Unseen-v0": {
        "entry_point": "mlivr_gym.extensions.unseen.env:UnseenEnv",
        "max_episode_steps": 100,
    },
}

__getattr__, __dir__ = lazy(__name__)
