"""Parts of plans, and plans as plain data that are altered."""

import copy
from dataclasses import fields, replace

from mlivr_gym.motion.plan_parts import Motion


def first_steps(plan, count):
    """A plan's first steps."""
    motion = {
        field.name: getattr(plan.motion, field.name)[: count + (field.name != "steps")]
        for field in fields(plan.motion)
    }
    return replace(plan, motion=Motion(**motion))


def altered(data, path, value):
    """The data with another value at a path of keys and indices."""
    out = copy.deepcopy(data)
    inner = out
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return out
