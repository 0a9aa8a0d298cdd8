"""Hyperparameters of the training methods, checked before anything is trained.

`ImitationHyperparameters` has the default values of imitation; `envs_assets/training.json`, which
ships with the package, has those of PPO and of the networks, and what distinguishes the methods.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from mlivr_gym.arguments import checked
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError, choice
from mlivr_gym.files import load
from mlivr_gym.schema import (
    Choice,
    FieldPath,
    Fields,
    Flag,
    Integer,
    ListOf,
    OrNone,
    Struct,
    Tuples,
    Validator,
)

METHODS = ("bc", "dagger", "ppo", "finetune")
"""Names of the training methods.

`"bc"` is behaviour cloning in rounds: the expert acts in all rollouts, with a share of random
actions (Laskey et al., 2017), and samples of all rounds are kept. `"dagger"` differs in that the
actor-critic acts after the first round (Ross et al., 2011). `"ppo"` is PPO with action masks
(Huang and Ontañón, 2022), `"finetune"` the same with small steps from a checkpoint.
"""


@dataclass(frozen=True)
class ImitationHyperparameters:
    """Hyperparameters of imitation learning."""

    rounds: Annotated[int, COUNT] = 6
    """Number of rounds; in each one data are gathered and then learned from."""
    dagger: Annotated[bool, Flag()] = True
    """Whether the actor-critic acts in the rollouts after the first round (DAgger); otherwise the
    expert acts in all rounds (behaviour cloning). The samples of all rounds are kept in both."""
    layouts: Annotated[int, COUNT] = 9
    """Number of layouts in a round; a layout is a subset of the points of the map."""
    goals: Annotated[int, COUNT] = 12
    """Number of goals that are drawn on each layout; held-out ones are left out."""
    rollouts: Annotated[int, COUNT] = 40
    """Number of rollouts to each goal."""
    max_rollout_steps: Annotated[int, COUNT] = 20
    """Number of steps after which a rollout ends without having reached its goal."""
    most_removed: Annotated[float, SHARE] = 0.6
    """Maximum share of the points that a layout lacks; every third layout has all points."""
    noise: Annotated[float, SHARE] = 0.05
    """Probability of a random action in a rollout, among those after which the goal can still be
    reached."""
    updates: Annotated[int, COUNT] = 400
    """Number of gradient steps in a round."""
    batch: Annotated[int, COUNT] = 256
    """Number of states in a minibatch, of which each gradient step takes one."""
    learning_rate: Annotated[float, WEIGHT] = 2e-3
    """Initial learning rate of Adam, which a cosine lowers to a tenth."""
    averaging: Annotated[float, SHARE] = 0.997
    """Decay of the exponential moving average of the weights, which is the final policy."""
    value_weight: Annotated[float, WEIGHT] = 0.02
    """Weight of the squared error of the value in the loss."""
    discount: Annotated[float, SHARE] = 0.99
    """Discount per step of the return that the value head learns, for the reward `"steps"`; for
    `"base"` this return is undiscounted. The optimal actions do not depend on it."""

    def __post_init__(self) -> None:
        """Check all values."""
        IMITATION.check(self, FieldPath("imitation", SettingError))


COUNT = Integer(1, 1 << 40)
"""Validator of a number of steps, states or epochs."""

WIDTH = Integer(1, 1 << 14)
"""Validator of the number of units of a layer."""

SHARE = Tuples((), 0.0, 1.0)
"""Validator of a number from 0 to 1."""
WEIGHT = Tuples((), 0.0)
"""Validator of a number that is at least 0."""

IMITATION = Struct.of(ImitationHyperparameters)
"""Validator of each field of `ImitationHyperparameters`."""

SIZES = Fields(
    {},
    {
        "pointer": Fields({}, {"width": WIDTH, "summary": WIDTH}),
        "mlp": Fields({}, {"net_arch": ListOf(WIDTH, most=32)}),
    },
)
"""Validator of the sizes of each network."""

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
"""Validator of each argument of `MaskablePPO` of sb3-contrib."""

METHOD_FIELDS: dict[str, Validator[Any]] = {
    "imitation": IMITATION.fields,
    "n_envs": Integer(1, 4096),
    "timesteps": COUNT,
    "ppo": PPO,
}
"""Validators of the parts of a method: imitation, PPO in `n_envs` sub-environments for `timesteps`
environment steps in all, or both in this order."""


def check_hyperparameters(given: Any, path: str = "hyperparameters") -> dict[str, Any]:
    """Return the hyperparameters of one method and the sizes of the networks, after checking them.

    Given are `imitation`, or `n_envs`, `timesteps` and `ppo`, or all of these; and `networks`.
    Raises a `SettingError` if a field is missing, unknown or invalid; the message names it, and the
    hyperparameters by `path`.
    """
    place = FieldPath(path, SettingError)
    checked = Fields({"networks": SIZES}, METHOD_FIELDS).read(given, place)
    if not {"imitation", "ppo"} & checked.keys():
        raise place.fault("has neither imitation nor ppo, so that nothing would be learned")
    for name in ("ppo", "n_envs", "timesteps"):
        if name not in checked and {"ppo", "n_envs", "timesteps"} & checked.keys():
            raise place.field(name).fault("is missing; ppo, n_envs and timesteps go together")
    return checked


def fill_dagger(method: str, given: dict[str, Any]) -> dict[str, Any]:
    """Return hyperparameters whose flag `imitation.dagger` is the one that a method needs.

    It is True for `"dagger"` and False for `"bc"`; other methods leave it as it is. Raises a
    `SettingError` if the flag is given and contradicts the method.
    """
    if method not in ("bc", "dagger") or "imitation" not in given:
        return given
    dagger = method == "dagger"
    flag = given["imitation"].get("dagger", dagger)
    if flag != dagger:
        raise SettingError(
            f"hyperparameters.imitation.dagger is {flag}; method {method!r} needs {dagger}"
        )
    return given | {"imitation": given["imitation"] | {"dagger": dagger}}


@checked({"method": Choice(METHODS)})
def load_hyperparameters(method: str, path: str | Path | None = None) -> dict[str, Any]:
    """Return the hyperparameters of a method from a JSON file, by default from the package.

    The method is one of `METHODS`. Raises a `SettingError` if the file cannot be read, lacks the
    method, or has an invalid field.

    Examples
    --------
    >>> load_hyperparameters("ppo")["n_envs"]
    32
    """
    choice("method", method, METHODS)
    file = asset_path("training.json") if path is None else path

    def build(data: dict[str, Any]) -> dict[str, Any]:
        every: dict[str, Validator[Any]] = dict.fromkeys(METHODS, Fields({}, METHOD_FIELDS))
        found = Fields({method: every.pop(method), "networks": SIZES}, every).read(
            data, FieldPath("", SettingError)
        )
        return check_hyperparameters({**found[method], "networks": found["networks"]}, method)

    return load(file, "hyperparameters", SettingError, build)
