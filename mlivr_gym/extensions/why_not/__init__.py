"""What would help where there is no plan: the fewest obstacles less, or a lower threshold of w_m.

Which rule cuts a goal off is said by `Planner.why_not`.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.why_not.smallest_change import Change, smallest_changes

__all__ = ["Change", "smallest_changes"]

COMMANDS = {
    "suggest": (
        "say the smallest changes with which a plan exists",
        "mlivr-gym suggest --box 3.2 -1.0 -1.0 3.5 1.0 1.0",
    ),
}

__getattr__, __dir__ = lazy(__name__)
