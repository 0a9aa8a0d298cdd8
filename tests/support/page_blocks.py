"""Blocks of commands and code in pages, and how they are run."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent.parent

OTHERS = {"bibtex", "text", ""}
"""Languages of blocks that are not run; `""` ends with a directive of the site, as `{toctree}`."""

BLOCK = re.compile(
    r"(?:^<!-- (?P<said>not run|as): (?P<what>.*?) -->\n)?"
    r"^(?P<fence>`{3,})(?P<language>\S*)\n(?P<text>(?:.*\n)*?)(?P=fence)$",
    re.MULTILINE,
)


class Block(NamedTuple):
    """A block of a page."""

    page: str
    """Path of the page."""
    line: int
    """Where it begins."""
    language: str
    """`"bash"`, `"python"`, `"json"`, `"toml"`, or another that is not run."""
    text: str
    """What it holds."""
    not_run: str = ""
    """Why it is not run, in the words of the page."""
    name: str = ""
    """File that it is written to, for the blocks that follow."""


def pages():
    """Pages with blocks that are run; what scripts write, and the history, has none."""
    written = [ROOT / "docs" / name for name in ("reports", "reference", "_build")]
    found = [ROOT / "README.md", ROOT / "examples" / "README.md"]
    found += sorted((ROOT / "docs").rglob("*.md"))
    return [page for page in found if not any(page.is_relative_to(skip) for skip in written)]


def blocks(page):
    """Blocks of a page in their order."""
    text = page.read_text(encoding="utf-8")
    for match in BLOCK.finditer(text):
        said = {"not run": "not_run", "as": "name"}.get(match["said"])
        yield Block(
            page.relative_to(ROOT).as_posix(),
            text[: match.start("fence")].count("\n") + 1,
            match["language"],
            match["text"],
            **({said: match["what"]} if said else {}),
        )


def run(block, folder):
    """Run a block in a folder; returns what it printed if it failed, else nothing."""
    if block.name:
        (folder / block.name).write_text(block.text, encoding="utf-8")
        return ""
    if block.language in ("json", "toml"):
        return ""
    if block.language == "bash":
        command = ["bash", "-e", "-u", "-o", "pipefail", "-c", block.text]
    else:
        command = [sys.executable, "-c", block.text]
    return run_command(command, folder)


def run_command(command, folder):
    """Run a command in a folder; returns what it printed if it failed, else nothing."""
    here = Path(sys.executable).parent  # where this environment's `mlivr-gym` is
    environment = os.environ | {
        "PATH": f"{here}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
        "MPLBACKEND": "agg",
        "MINARI_DATASETS_PATH": str(folder / "minari"),
    }
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return f"exit code {done.returncode}\n{done.stdout}" if done.returncode else ""
