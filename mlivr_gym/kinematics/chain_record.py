"""How the record of a chain is filled: with its closed form, or the postures to begin from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import BRANCHES
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE, SEEDS, TURN, Chain, Form
from mlivr_gym.kinematics.forms import EXACT, NUMERIC, closed_form, foot, frames_at

TRIED = 16384
"""Number of postures among which seeds are chosen."""

USEFUL = 0.02
"""Least `|det J|` of a seed as a share of the largest one."""


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


def set_wrist(form: Form, steps: Array) -> None:
    """Fill in where the wrist is, by the steps of a chain, shape (6, 4, 4)."""
    frames = _frames(steps, np.zeros((1, 5)))[0]
    wrist = foot(frames[:, :3, 2], frames[:, :3, 3], 5, 4)
    out = frames[4, :3, :3].T @ (wrist - frames[4, :3, 3])
    form["wrist"][:] = out
    form["past_wrist"] = float((frames[5, :3, 3] - wrist) @ frames[5, :3, 2])
    off_axis_1 = float(np.hypot(*steps[1, :2, 3]))
    between = off_axis_1 + np.linalg.norm(steps[2:5, :3, 3], axis=1).sum() + np.linalg.norm(out)
    form["unit"] = max(float(between) / 3.0, 1e-3)


def _frames(steps: Array, turns: Array) -> Array:
    """Return frames of the links 1 to 6 at turns of joints 1 to 5, (k, 5) -> (k, 6, 4, 4)."""
    angles = np.concatenate([turns, np.zeros((len(turns), 1))], axis=1)
    return frames_at(steps, np.ones(6), angles)[:, 1:]


def _squared_arm(frames: Array) -> Array:
    """Return squared distances of link 2 from axis 4, where that is nearest to axis 5, (k,)."""
    ends = np.array([foot(one[:, :3, 2], one[:, :3, 3], 3, 4) for one in frames])
    away = frames[:, 1, :3, 3] - ends
    return np.asarray((away * away).sum(axis=1))


def _along_axis_4(frames: Array) -> Array:
    """Return cosines of the angle between axes 4 and 6, shape (k,)."""
    return np.asarray((frames[:, 3, :3, 2] * frames[:, 5, :3, 2]).sum(axis=1))


def _largest(steps: Array, joint: int, value: Callable[[Array], Array]) -> float:
    """Return the angle of a joint at which a value is largest, which is a cosine of it [rad]."""
    angles = np.zeros((3, 5))
    angles[:, joint] = turns = 2.0 * np.pi * np.arange(3) / 3.0
    return float(np.angle((value(_frames(steps, angles)) * np.exp(1j * turns)).sum()))


def set_seeds(form: Form, steps: Array, windows: Array) -> None:
    """Choose postures of every branch that lie far apart from each other.

    Steps have shape (6, 4, 4), windows of how far joints are turned (6, 2) [rad].
    """
    unit = float(form["unit"])
    form["elbow"] = _largest(steps, 2, _squared_arm)
    form["bend"] = _largest(steps, 4, _along_axis_4)
    angles = np.zeros((TRIED, 5))
    low, high = windows.T
    angles[:, 1:] = low[1:5] + (high - low)[1:5] * _spread(TRIED, 4)
    frames = _frames(steps, angles)
    tips, axes = frames[:, 5, :3, 3], frames[:, 5, :3, 2]
    wrists = tips - form["past_wrist"] * axes
    ahead = np.cross(frames[:, 0, :3, 2], frames[:, 1, :3, 2])
    ahead = (ahead * (wrists - frames[:, 0, :3, 3])).sum(axis=1)
    branch = 4 * (ahead < 0.0) + 2 * (np.sin(angles[:, 2] - form["elbow"]) < 0.0)
    branch = branch + (np.sin(angles[:, 4] - form["bend"]) < 0.0)
    joints = frames[:, :, :3, 2].transpose(0, 2, 1)
    arms = (wrists[:, None] - frames[:, :, :3, 3]).transpose(0, 2, 1)
    jacobians = np.concatenate([np.cross(joints, arms, axis=1), joints], axis=1)
    sizes = np.abs(np.linalg.det(jacobians))
    useful = sizes >= USEFUL * sizes.max()
    azimuth = np.arctan2(wrists[:, 1], wrists[:, 0])
    c, s = np.cos(azimuth), np.sin(azimuth)
    x, y = c * axes[:, 0] + s * axes[:, 1], c * axes[:, 1] - s * axes[:, 0]
    radius = np.hypot(wrists[:, 0], wrists[:, 1])
    places = np.stack([radius / unit, wrists[:, 2] / unit, x, y, axes[:, 2]], axis=1)
    for b in range(BRANCHES):
        rows = np.flatnonzero(useful & (branch == b))
        rows = rows[_far_apart(places[rows], SEEDS)]
        seeds = form["seeds"][b]
        form["seed_counts"][b] = len(rows)
        for k, row in enumerate(rows):
            seeds[k]["radius"], seeds[k]["height"] = radius[row], wrists[row, 2]
            seeds[k]["axis"][:] = x[row], y[row], axes[row, 2]
            seeds[k]["q"][:] = (-azimuth[row], *angles[row, 1:], 0.0)


def _spread(count: int, dimensions: int) -> Array:
    """Return points that fill the unit cube evenly, shape (count, dimensions) (Roberts 2018)."""
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    shares = root ** -np.arange(1.0, dimensions + 1.0)
    points: Array = np.mod(0.5 + np.arange(1, count + 1)[:, None] * shares, 1.0)
    return points


def _far_apart(places: Array, most: int) -> IntArray:
    """Return rows of which each is the farthest one from all before, `most` of them."""
    if not len(places):
        return np.zeros(0, dtype=np.int64)
    chosen, away = [0], np.linalg.norm(places - places[0], axis=1)
    while len(chosen) < min(most, len(places)):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return np.array(chosen, dtype=np.int64)
