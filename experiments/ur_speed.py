"""Compare the speed of two UR5e before other families of arms came, and now, in one run.

    git worktree add ../before 09d5d047
    python experiments/ur_speed.py --before ../before [--out results] [--repeats 7]

09d5d047 is the last commit with UR arms alone. `ur_speed_once.py` runs with that checkout and with
this one in turn, each time in a new process without stored graphs; machine code is compiled in a
first run of each, which does not count. Writes `ur_speed.json`, which `readme.py` shows in the
docs.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from reports import ROOT, experiment, table

KINDS = {
    "inverse_kinematics_s": ("all branches of a flange pose [us]", 1e6),
    "stance_set_s": ("stance set of the JEM, nothing stored [s]", 1.0),
    "query_s": ("plan with fewest steps to a new goal [ms]", 1e3),
}
"""Title, with its unit, and the unit's share of a second of each time."""


def once(tree: Path, cache: str) -> dict[str, Any]:
    """Return what one process measures with the package of a checkout."""
    for file in Path(cache).glob("*.npz"):
        file.unlink()
    places = {"PYTHONPATH": str(tree), "MLIVR_GYM_CACHE": cache}
    script = str(ROOT / "experiments" / "ur_speed_once.py")
    done = subprocess.run(
        [sys.executable, script], env=os.environ | places, check=True, capture_output=True
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def measured(before: str, repeats: int) -> dict[str, Any]:
    """Return the times of both checkouts in turn, and what must be equal."""
    if not before:
        raise SystemExit("--before must name a checkout of 09d5d047")
    trees, runs = {"before": Path(before), "now": ROOT}, []
    with tempfile.TemporaryDirectory() as cache:
        for _ in range(repeats + 1):
            runs.append({name: once(tree, cache) for name, tree in trees.items()})
    out: dict[str, Any] = {"repeats": repeats}
    for name in trees:
        rows = [run[name] for run in runs[1:]]
        out[name] = {kind: [row[kind] for row in rows] for kind in KINDS}
        out[name] |= {kind: rows[0][kind] for kind in ("stances", "steps")}
    return out


def markdown(data: dict[str, Any]) -> str:
    """Return the table for the page on robots."""
    rows = []
    for kind, (title, unit) in KINDS.items():
        cells = []
        for name in ("before", "now"):
            times = unit * np.array(data[name][kind])
            cells.append(f"{np.median(times):.3g} ({times.min():.3g} to {times.max():.3g})")
        rows.append((title, *cells))
    return table("two UR5e, processor time | before other families | now", rows)


if __name__ == "__main__":
    experiment("ur_speed", __doc__, measured, before="", repeats=7)
