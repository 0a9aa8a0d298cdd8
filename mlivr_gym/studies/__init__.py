"""Studies: many runs over robots, maps, settings and tasks, on one machine or on a cluster.

See `docs/how-to/studies.md`.
"""

from mlivr_gym.engines import ENGINES
from mlivr_gym.studies.design import RunBlock, StudyDesign
from mlivr_gym.studies.run import read_study, run_study

__all__ = ["ENGINES", "RunBlock", "StudyDesign", "read_study", "run_study"]
