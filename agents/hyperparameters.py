"""Hyperparameters of the training methods, checked before anything is trained.

`ImitationSettings` has the default values of imitation; `envs_assets/training.json`, which ships
with the package, has those of PPO and of the networks, and what distinguishes the methods.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError, choice
from mlivr_gym.files import load
from mlivr_gym.schema import FieldPath, Fields, Flag, Integer, Kind, ListOf, OrNone, Struct, Tuples

METHODS = ("bc", "dagger", "ppo", "finetune")
"""Names of the training methods; `finetune` is PPO with small steps from a checkpoint."""


@dataclass(frozen=True)
class ImitationSettings:
    """Hyperparameters of imitation learning.

    Attributes
    ----------
    rounds
        Number of rounds; in each one data are gathered and then learned from.
    dagger
        Whether the policy walks after the first round (DAgger); the expert walks in the first
        round, and in all of them for behaviour cloning.
    layouts
        Number of layouts of the points in a round.
    goals
        Number of goals on each layout.
    walks
        Number of walks to each goal.
    longest
        Maximum number of steps of a walk.
    most_removed
        Maximum share of the points that a layout lacks; every third layout has all points.
    noise
        Share of random possible actions on walks.
    updates
        Number of gradient steps in a round.
    batch
        Number of states in a gradient step.
    learning_rate
        Initial learning rate of Adam, which a cosine lowers to a tenth.
    averaging
        Decay of the exponential moving average of the weights, which is the final policy.
    value_weight
        Weight of the value error in the loss.
    discount
        Discount of the value.
    """

    rounds: int = 6
    dagger: bool = True
    layouts: int = 9
    goals: int = 12
    walks: int = 40
    longest: int = 20
    most_removed: float = 0.6
    noise: float = 0.05
    updates: int = 400
    batch: int = 256
    learning_rate: float = 2e-3
    averaging: float = 0.997
    value_weight: float = 0.02
    discount: float = 0.99

    def __post_init__(self) -> None:
        """Check all values."""
        IMITATION.check(self, FieldPath("imitation", SettingError))


COUNT = Integer(1, 1 << 40)
"""Kind of a number of steps, states or epochs."""

WIDTH = Integer(1, 1 << 14)
"""Kind of the number of units of a layer."""

SHARE = Tuples((), 0.0, 1.0)
"""Kind of a number from 0 to 1."""
WEIGHT = Tuples((), 0.0)
"""Kind of a number that is at least 0."""

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
"""Kind of each field of `ImitationSettings`."""

SIZES = Fields(
    {},
    {
        "pointer": Fields({}, {"width": WIDTH, "summary": WIDTH}),
        "mlp": Fields({}, {"net_arch": ListOf(WIDTH, most=32)}),
    },
)
"""Kind of the sizes of each network."""

PPO = Fields(
    {},
    {
        "n_steps": Integer(2, 1 << 20),
        "batch_size": Integer(2, 1 << 24),
        "n_epochs": Integer(1, 1 << 20),
        "learning_rate": WEIGHT,
        "gamma": SHARE,
        "gae_lambda": SHARE,
        "ent_coef": WEIGHT,
        "vf_coef": WEIGHT,
        "clip_range": WEIGHT,
        "clip_range_vf": OrNone(WEIGHT),
        "normalize_advantage": Flag(),
        "max_grad_norm": WEIGHT,
        "target_kl": OrNone(WEIGHT),
    },
)
"""Kind of each argument of `MaskablePPO` of sb3-contrib."""

METHOD_FIELDS: dict[str, Kind[Any]] = {
    "imitation": IMITATION.fields,
    "copies": Integer(1, 4096),
    "timesteps": COUNT,
    "ppo": PPO,
}
"""Kinds of the parts of a method: imitation, PPO in copies of the environment, or both in order."""


def check_settings(settings: Any, path: str = "settings") -> dict[str, Any]:
    """Return the hyperparameters of one method and the sizes of the networks, after checking them.

    Parameters
    ----------
    settings
        `imitation`, or `copies`, `timesteps` and `ppo`, or all of these; and `networks`.
    path
        Name of the settings in messages.

    Raises
    ------
    SettingError
        If a field is missing, unknown or invalid; the message names it.
    """
    place = FieldPath(path, SettingError)
    found = Fields({"networks": SIZES}, METHOD_FIELDS).read(settings, place)
    if not {"imitation", "ppo"} & found.keys():
        raise place.fault("has neither imitation nor ppo, so that nothing would be learned")
    for name in ("ppo", "copies", "timesteps"):
        if name not in found and {"ppo", "copies", "timesteps"} & found.keys():
            raise place.field(name).fault("is missing; ppo, copies and timesteps go together")
    return found


def with_method(method: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Return settings of imitation with the walks that a method takes, and others as they are.

    Behaviour cloning walks as the expert does, DAgger as the policy from the second round on.

    Raises
    ------
    SettingError
        If the settings contradict the method.
    """
    if method not in ("bc", "dagger") or "imitation" not in settings:
        return settings
    dagger = method == "dagger"
    given = settings["imitation"].get("dagger", dagger)
    if given != dagger:
        raise SettingError(
            f"settings.imitation.dagger is {given}; method {method!r} needs {dagger}"
        )
    return settings | {"imitation": settings["imitation"] | {"dagger": dagger}}


def hyperparameters(method: str, path: str | Path | None = None) -> dict[str, Any]:
    """Return the hyperparameters of a method from a JSON file, by default from the package.

    Parameters
    ----------
    method
        One of `METHODS`.
    path
        The JSON file; by default the one that ships with the package.

    Raises
    ------
    SettingError
        If the file cannot be read, lacks the method, or has an invalid field.
    """
    choice("method", method, METHODS)
    file = asset_path("training.json") if path is None else path

    def build(data: dict[str, Any]) -> dict[str, Any]:
        every: dict[str, Kind[Any]] = dict.fromkeys(METHODS, Fields({}, METHOD_FIELDS))
        found = Fields({method: every.pop(method), "networks": SIZES}, every).read(
            data, FieldPath("", SettingError)
        )
        return check_settings({**found[method], "networks": found["networks"]}, method)

    return load(file, "hyperparameters", SettingError, build)
