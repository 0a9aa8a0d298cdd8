"""Print the oldest versions that `pyproject.toml` allows, as constraints for pip.

    python .ci/oldest.py > oldest.txt

They are those of what users install: the required packages and the extras but `dev` and `docs`.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

BOUND = re.compile(r"([\w.-]+)(?:\[[^]]*\])?>=([\d.]+)")
"""A requirement: the package, perhaps with extras of its own, and its oldest version."""


def oldest(project: dict) -> list[str]:
    """Return a line for each package of the table `project`, such as `numpy==2.0`."""
    extras = project["optional-dependencies"]
    listed = [line for name in extras if name not in ("dev", "docs") for line in extras[name]]
    found = map(BOUND.match, [*project["dependencies"], *listed])
    return sorted({f"{match[1]}=={match[2]}" for match in found if match})


if __name__ == "__main__":
    pyproject = Path(__file__).parent.parent / "pyproject.toml"
    print("\n".join(oldest(tomllib.loads(pyproject.read_text("utf-8"))["project"])))
