"""Run the notebooks of `examples/` and store their outputs in them.

    python experiments/notebooks.py

Metadata that differ from run to run, such as execution times, are removed.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from reports import ROOT

from mlivr_gym.files import write_whole

EXAMPLES = ROOT / "examples"

LONGEST_CELL = 300
"""Time limit of a cell [s]."""


def executed(path: Path) -> Any:
    """Return a notebook with the outputs of a run in an empty folder; cells must not fail."""
    notebook = nbformat.read(path, as_version=4)
    # The kernel imports from this environment, whichever kernels the machine has registered.
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            notebook, timeout=LONGEST_CELL, resources={"metadata": {"path": folder}}
        )
        client.execute()
    for cell in notebook.cells:
        cell.metadata.clear()
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    return notebook


def main() -> None:
    """Run all notebooks; each file is written only if all its cells succeed."""
    for path in sorted(EXAMPLES.glob("*.ipynb")):
        write_whole(path, nbformat.writes(executed(path)) + "\n")
        print(path.name)


if __name__ == "__main__":
    main()
