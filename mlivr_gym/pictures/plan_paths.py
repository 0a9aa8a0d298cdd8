"""Where the base goes between the stances of a plan."""

from __future__ import annotations

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.base_path import PATH_KINDS, STRAIGHT, base_path, base_poses
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.motion.plan import Plan

SAMPLES = 13
"""Places on the base path of a step: enough for an arc to look round."""


def base_paths(plan: Plan, samples: int = SAMPLES) -> list[Array]:
    """Base positions along the base path of each step, shapes (samples, 3) [m]."""
    motion, share = plan.motion, np.linspace(0.0, 1.0, samples)
    turns = scipy.spatial.transform.Rotation.from_quat(
        motion.base_quaternions, scalar_first=True
    ).as_matrix()
    poses = [pose(*at) for at in zip(motion.base_positions, turns, strict=True)]
    found = []
    for k, step in enumerate(plan.steps):
        kind = PATH_KINDS.index(step.path) if step.path in PATH_KINDS else STRAIGHT
        path = base_path(poses[k], poses[k + 1], kind, np.array(step.pivot))
        found.append(base_poses(path, share)[0])
    return found


def base_line(plan: Plan) -> Array:
    """Base positions along a whole plan, shape (k, 3) [m]; one of a plan without a step."""
    return np.concatenate([plan.motion.base_positions[:1], *base_paths(plan)])
