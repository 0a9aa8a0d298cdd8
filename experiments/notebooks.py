"""Run the notebooks of `examples/` and keep their outputs.

    python experiments/notebooks.py

What differs from run to run, such as times of execution, is not kept.
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
"""How long a cell may take [s]."""


def executed(path: Path) -> Any:
    """A notebook with the outputs of a run in an empty folder, by this Python.

    Raises
    ------
    CellExecutionError
        If a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    # The kernel of this environment, whatever kernels are registered on the machine.
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
    """Run all, each written whole or not at all."""
    for path in sorted(EXAMPLES.glob("*.ipynb")):
        write_whole(path, nbformat.writes(executed(path)) + "\n")
        print(path.name)


if __name__ == "__main__":
    main()
