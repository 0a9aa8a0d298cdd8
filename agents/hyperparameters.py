"""Hyperparameters: data, checked before anything is trained.

Those that ship with the package lie in `envs_assets/training.json`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError, choice
from mlivr_gym.files import load
from mlivr_gym.schema import FieldPath, Fields, Flag, Kind, Listed, Maybe, Struct, Tuples, Whole

METHODS = ("bc", "dagger", "ppo", "finetune")
"""Names of the training methods; `finetune` is PPO in small steps from a checkpoint."""


@dataclass(frozen=True)
class ImitationSettings:
    """How a policy imitates the planner.

    Attributes
    ----------
    rounds
        Times that data are gathered and learnt from; in the first the expert walks, in the
        others the policy (behaviour cloning: the expert in all).
    dagger
        Whether the policy walks after the first round.
    layouts
        Layouts of the points in a round.
    goals
        Goals on each layout.
    walks
        Walks to each goal.
    longest
        Most steps of a walk.
    most_removed
        Largest share of the points taken out of a layout; every third layout has all
        of them.
    noise
        Share of random possible actions on walks.
    updates
        Gradient steps in a round.
    batch
        States in a gradient step.
    learning_rate
        Largest rate of Adam; it falls to a tenth by a cosine.
    averaging
        Share that the average of the weights, which is kept in the end, keeps of itself
        in a gradient step.
    value_weight
        Weight of the error of the value in the loss.
    discount
        Discount of that value.
    """

    rounds: int = 8
    dagger: bool = True
    layouts: int = 9
    goals: int = 12
    walks: int = 10
    longest: int = 14
    most_removed: float = 0.6
    noise: float = 0.05
    updates: int = 300
    batch: int = 256
    learning_rate: float = 1e-3
    averaging: float = 0.997
    value_weight: float = 0.02
    discount: float = 0.99

    def __post_init__(self) -> None:
        """Check every figure."""
        IMITATION.check(self, FieldPath("imitation", SettingError))


COUNT = Whole(1, 1 << 40)
"""Steps, states or epochs."""

WIDTH = Whole(1, 1 << 14)
"""Units of a layer."""

SHARE = Tuples((), 0.0, 1.0)
WEIGHT = Tuples((), 0.0)

IMITATION = Struct(
    ImitationSettings,
    {
        **dict.fromkeys(
            ("rounds", "layouts", "goals", "walks", "longest", "updates", "batch"), COUNT
        ),
        **dict.fromkeys(("most_removed", "noise", "averaging", "discount"), SHARE),
        **dict.fromkeys(("learning_rate", "value_weight"), Tuples((), 0.0)),
        "dagger": Flag(),
    },
)
"""Fields of `ImitationSettings`."""

SIZES = Fields(
    {},
    {
        "pointer": Fields({}, {"width": WIDTH, "summary": WIDTH}),
        "mlp": Fields({}, {"net_arch": Listed(WIDTH, most=32)}),
    },
)
"""Sizes of each network."""

PPO = Fields(
    {},
    {
        "n_steps": Whole(2, 1 << 20),
        "batch_size": Whole(2, 1 << 24),
        "n_epochs": Whole(1, 1 << 20),
        "learning_rate": WEIGHT,
        "gamma": SHARE,
        "gae_lambda": SHARE,
        "ent_coef": WEIGHT,
        "vf_coef": WEIGHT,
        "clip_range": WEIGHT,
        "clip_range_vf": Maybe(WEIGHT),
        "normalize_advantage": Flag(),
        "max_grad_norm": WEIGHT,
        "target_kl": Maybe(WEIGHT),
    },
)
"""What `MaskablePPO` of sb3-contrib takes."""

PARTS: dict[str, Kind[Any]] = {
    "imitation": IMITATION.fields,
    "copies": Whole(1, 4096),
    "timesteps": COUNT,
    "ppo": PPO,
}
"""What a method does: imitation, PPO in copies of the environment, or one after the other."""


def checked_settings(settings: Any, path: str = "settings") -> dict[str, Any]:
    """Hyperparameters of one method, with the sizes of the networks.

    Parameters
    ----------
    settings
        `imitation`, or `copies`, `timesteps` and `ppo`, or both; and `networks`.
    path
        What they are called in a message.

    Raises
    ------
    SettingError
        naming a field that is missing, unknown or faulty.
    """
    place = FieldPath(path, SettingError)
    found = Fields({"networks": SIZES}, PARTS).read(settings, place)
    if not {"imitation", "ppo"} & found.keys():
        raise place.fault("has neither imitation nor ppo, so that nothing would be learned")
    for name in ("ppo", "copies", "timesteps"):
        if name not in found and {"ppo", "copies", "timesteps"} & found.keys():
            raise place.field(name).fault("is missing; ppo, copies and timesteps go together")
    return found


def hyperparameters(method: str, path: str | Path | None = None) -> dict[str, Any]:
    """Hyperparameters of a method from a JSON file, by default the one that ships with the package.

    Raises
    ------
    SettingError
        If the file cannot be read, lacks the method, or a field is faulty.
    """
    choice("method", method, METHODS)
    file = asset_path("training.json") if path is None else path

    def build(data: dict[str, Any]) -> dict[str, Any]:
        every: dict[str, Kind[Any]] = dict.fromkeys(METHODS, Fields({}, PARTS))
        found = Fields({method: every.pop(method), "networks": SIZES}, every).read(
            data, FieldPath("", SettingError)
        )
        return checked_settings({**found[method], "networks": found["networks"]}, method)

    return load(file, "hyperparameters", SettingError, build)
