"""Duration and reaction of steps: the fastest of several plans, and that with the least impulse."""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.reaction.fastest import (
        Candidate,
        ranked_plans,
        step_reactions,
        with_least_reaction,
    )
    from mlivr_gym.extensions.reaction.reaction import Reaction

__all__ = ["Candidate", "Reaction", "ranked_plans", "step_reactions", "with_least_reaction"]

COMMANDS = {
    "rank": (
        "compare plans of several costs by their duration, or by their impulse on the station",
        "mlivr-gym rank --by time",
        "mlivr-gym rank --by reaction --out plan.json",
    ),
}

__getattr__, __dir__ = lazy(__name__)
