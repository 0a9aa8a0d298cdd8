"""Every command and code block of README, site, docstrings and examples runs: make test-docs."""

import doctest
import importlib
import importlib.util
import json
import sys
import tomllib
from pathlib import Path

import pytest
from page_blocks import OTHERS, ROOT, blocks, pages, run, run_command

RUN = ("bash", "python", "json", "toml")
PAGES = {page: list(blocks(page)) for page in pages()}
BLOCKS = [block for found in PAGES.values() for block in found if block.language in RUN]


def test_each_block_says_what_it_is():
    """A block without a language would never be run."""
    unknown = [
        (block.page, block.line, block.language)
        for found in PAGES.values()
        for block in found
        if block.language not in RUN
        and block.language not in OTHERS - {""}
        and not block.language.startswith("{")
    ]
    assert not unknown
    assert len(BLOCKS) > 20


def test_what_is_not_run_has_its_reason_above_a_block():
    """A comment that belongs to no block would skip nothing, or hide a slip."""
    for page, found in PAGES.items():
        comments = page.read_text(encoding="utf-8").count("<!-- not run:")
        assert comments == sum(bool(block.not_run) for block in found), page


PAGES_RUN = [
    pytest.param(found, id=page.relative_to(ROOT).as_posix())
    for page, found in PAGES.items()
    if any(block.language in RUN for block in found)
]
NOT_RUN = [block for block in BLOCKS if block.not_run]


@pytest.mark.docs
@pytest.mark.parametrize("found", PAGES_RUN)
def test_a_page_runs(found, tmp_path):
    """One test for a page, since its blocks need what those above them wrote."""
    for block in found:
        if block.language not in RUN or block.not_run:
            continue
        if block.language == "json":
            json.loads(block.text)
        if block.language == "toml":
            tomllib.loads(block.text)
        printed = run(block, tmp_path)
        assert not printed, f"{block.page}:{block.line}: {printed}"


@pytest.mark.docs
@pytest.mark.parametrize("block", NOT_RUN, ids=lambda block: f"{block.page}:{block.line}")
def test_a_block_is_not_run(block):
    pytest.skip(f"{block.page}:{block.line}: {block.not_run}")


FOLDERS = ("mlivr_gym", "planners", "agents")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def runs(text):
    """Whether a source has an example that is not marked to be skipped."""
    return any(">>> " in line and "+SKIP" not in line for line in text.splitlines())


def modules():
    """Names of the modules with an example that runs."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            inside = path.relative_to(ROOT).with_suffix("").parts
            linked = inside[:2] in {("mlivr_gym", name) for name in FOLDERS}
            if not linked and runs(path.read_text(encoding="utf-8")):
                package = () if folder == "mlivr_gym" else ("mlivr_gym",)
                yield ".".join((*package, *inside))


@pytest.mark.docs
@pytest.mark.parametrize("name", list(modules()))
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failed, count = doctest.testmod(importlib.import_module(name), optionflags=FLAGS)
    assert count
    assert not failed


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


def test_examples_are_all_in_their_table_and_short():
    """So that they are read; the one that has a whole algorithm in it may be longer."""
    said = (ROOT / "examples" / "README.md").read_text(encoding="utf-8")
    assert all(f"]({path.name})" in said for path in EXAMPLES + NOTEBOOKS)
    for path in EXAMPLES:
        most = 110 if "cleanrl" in path.stem else 60
        assert len(Path(path).read_text(encoding="utf-8").splitlines()) <= most
