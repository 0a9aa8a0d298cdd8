"""Parts of plans."""

from dataclasses import fields, replace

from mlivr_gym.motion.plan_parts import Motion


def first_steps(plan, count):
    """A plan's first steps."""
    motion = {
        field.name: getattr(plan.motion, field.name)[: count + (field.name != "steps")]
        for field in fields(plan.motion)
    }
    return replace(plan, motion=Motion(**motion))
