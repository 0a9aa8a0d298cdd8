"""How the record of a chain is filled."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE, TURN, Chain, Form
from mlivr_gym.kinematics.forms import EXACT, NUMERIC, closed_form
from mlivr_gym.kinematics.numeric_seeds import set_seeds, set_wrist


def set_chain(arm: Chain, steps: Array, sense: Array, windows: Array) -> None:
    """Fill in a chain.

    Steps are the frames of the links, each in that of the link before, at zero angles, shape (6, 4,
    4). Joints count about their z axes or against them, 1 or -1, shape (6,). Windows are the least
    and largest angle of each joint [rad], at most a turn apart, shape (6, 2).
    """
    arm["steps"][:, 0], arm["steps"][:, 1:] = steps[:, :3, 3], steps[:, :3, :3].transpose(0, 2, 1)
    arm["sense"][:] = sense
    low, high = windows.T
    arm["window"][:, 0] = low
    arm["window"][:, 1] = np.minimum(high, low + TURN - 2.0 * LIMIT_TOLERANCE)
    form: Form = arm["form"]
    set_wrist(form, steps)
    found = closed_form(steps)
    if found is None:
        form["kind"] = NUMERIC
        set_seeds(form, steps, np.sort(sense[:, None] * windows, axis=1))
        return
    solution, form["from_flange"] = found
    form["kind"], form["deviates"] = solution.kind, solution.off > EXACT
    form["sign"][:], form["c_zero"][:] = solution.sign[:5], np.cos(solution.zero[:5])
    form["s_zero"][:] = np.sin(solution.zero[:5])
    for name, figure in solution.figures.items():
        form[name] = figure
