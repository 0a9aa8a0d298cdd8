"""Studies: many runs over robots, maps, settings and tasks, on one machine or on a cluster."""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.studies.design import RunBlock, StudyDesign
    from mlivr_gym.extensions.studies.rows import Row
    from mlivr_gym.extensions.studies.run import read_study, run_study

__all__ = ["Row", "RunBlock", "StudyDesign", "read_study", "run_study"]

COMMANDS = {
    "study": (
        "run a study over robots, maps, settings and tasks",
        "mlivr-gym study thresholds.toml",
        "mlivr-gym study thresholds.toml --engine dask --scheduler tcp://10.0.0.1:8786",
    ),
}

__getattr__, __dir__ = lazy(__name__)
