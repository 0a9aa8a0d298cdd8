"""Every example runs, and each notebook to its end: `make test-docs`."""

import importlib.util
import sys
from pathlib import Path

import pytest
from page_blocks import ROOT, run_command

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
NEEDED = {
    "06": ("sb3_contrib",),
    "07": ("torch",),
    "08": ("torchrl",),
    "09": ("minari", "h5py"),
    "11": ("sb3_contrib",),
    "12": ("torch",),
}
"""Packages besides the core that examples need, by number."""


@pytest.mark.docs
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(path, tmp_path):
    for package in NEEDED.get(path.stem[:2], ()):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"{path.name} needs {package}")
    assert not run_command([sys.executable, str(path)], tmp_path)


RUN_NOTEBOOK = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
import notebooks
notebooks.executed(Path(sys.argv[2]))
"""


@pytest.mark.docs
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_to_its_end(path, tmp_path):
    pytest.importorskip("nbclient")
    experiments = str(ROOT / "experiments")
    command = [sys.executable, "-c", RUN_NOTEBOOK, experiments, str(path)]
    assert not run_command(command, tmp_path)


def test_notebooks_are_kept_with_their_outputs():
    nbformat = pytest.importorskip("nbformat")
    assert len(NOTEBOOKS) == 2
    for path in NOTEBOOKS:
        cells = [c for c in nbformat.read(path, 4).cells if c.cell_type == "code"]
        assert all(cell.execution_count for cell in cells)
        assert any(
            "image/png" in output.get("data", {}) for cell in cells for output in cell.outputs
        )
        assert not any(output.output_type == "error" for cell in cells for output in cell.outputs)


def test_the_table_of_examples_names_them_all():
    said = (ROOT / "examples" / "README.md").read_text(encoding="utf-8")
    for path in EXAMPLES + NOTEBOOKS:
        assert f"]({path.name})" in said


def test_examples_are_short():
    """So that they are read; the one that has a whole algorithm in it may be longer."""
    for path in EXAMPLES:
        most = 110 if "cleanrl" in path.stem else 60
        assert len(Path(path).read_text(encoding="utf-8").splitlines()) <= most
