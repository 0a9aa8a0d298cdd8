"""Build the wheels and the source distributions of a release.

    make release REPOSITORY=https://github.com/OWNER/mlivr-gym

Links and pictures of the README are relative, so that they work on every branch and in every fork.
On a package index they would lead nowhere. The build therefore copies the tracked files, makes the
README's links absolute at the tag of the version, and adds `[project.urls]` to the copy of
`pyproject.toml`. The address of the repository is an argument and is stored nowhere.

The tables of three and four limbs are two thirds of all data and of use to few, so a distribution
of their own, `mlivr-gym-tables`, puts them into the folder in which the package looks for data.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent

LINK = re.compile(r"(!?)\[([^]]*)\]\((?!https?://|#)([^)\s]+)\)")
"""A relative link or picture of a Markdown page."""


LARGE = 2_000_000
"""Size above which the second distribution holds a table [bytes]: those of three and four limbs."""

OF_TABLES = """\
[build-system]
requires = ["setuptools>=80"]
build-backend = "setuptools.build_meta"

[project]
name = "mlivr-gym-tables"
version = "{number}"
description = "Tables of all nodes of three and four limbs, for mlivr-gym"
license = "Apache-2.0"
dependencies = ["mlivr-gym=={number}"]

[tool.setuptools]
packages = ["mlivr_gym.envs_assets"]
package-data = {{ "*" = ["*.npz"] }}
"""
"""The `pyproject.toml` of the second distribution."""


def version() -> str:
    """Return the version of the package, which only `mlivr_gym/_version.py` states."""
    text = (ROOT / "mlivr_gym" / "_version.py").read_text(encoding="utf-8")
    return re.findall(r'^__version__ = "(.+)"$', text, re.MULTILINE)[0]


def absolute(text: str, repository: str, tag: str) -> str:
    """Return a page whose relative links point into a repository at a tag."""

    def link(match: re.Match[str]) -> str:
        picture, name, path = match.groups()
        kind = "raw" if picture else "blob"
        return f"{picture}[{name}]({repository}/{kind}/{tag}/{path})"

    return LINK.sub(link, text)


def urls(repository: str, tag: str) -> str:
    """Return the table `[project.urls]` of a release."""
    pages = {
        "Repository": repository,
        "Documentation": f"{repository}/blob/{tag}/docs/index.md",
        "Changelog": f"{repository}/blob/{tag}/CHANGELOG.md",
        "Issues": f"{repository}/issues",
    }
    return "\n[project.urls]\n" + "".join(f'{name} = "{url}"\n' for name, url in pages.items())


def problems(number: str) -> list[str]:
    """Return what must be done before this version can be released, one sentence each."""
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    status = subprocess.run(
        ["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    found = {
        f"CHANGELOG.md has no entry '## {number}'": f"\n## {number}" not in changelog,
        "CHANGELOG.md has an entry '## Unreleased'": "\n## Unreleased" in changelog,
        f"CITATION.cff is not of version {number}": f"\nversion: {number}\n" not in citation,
        "there are changes that are not committed": bool(status.stdout.strip()),
    }
    return [problem for problem, there in found.items() if there]


def build(repository: str, number: str, out: Path) -> None:
    """Build all from a copy of the tracked files with absolute links."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"mlivr-gym-{number}"
        for name in filter(None, listed.stdout.split("\0")):
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name, follow_symlinks=False)
        readme, project, tag = copy / "README.md", copy / "pyproject.toml", f"v{number}"
        text = absolute(readme.read_text(encoding="utf-8"), repository, tag)
        readme.write_text(text, encoding="utf-8")
        with project.open("a", encoding="utf-8") as stream:
            stream.write(urls(repository, tag))
        tables = separate_tables(copy, number, urls(repository, tag))
        for place in (copy, tables):
            command = [sys.executable, "-m", "build", "--outdir", str(out.resolve()), str(place)]
            subprocess.run(command, check=True)


def separate_tables(copy: Path, number: str, links: str) -> Path:
    """Move tables out of a copy of the repository; return the folder of their distribution."""
    place = copy.with_name(f"mlivr-gym-tables-{number}")
    data = place / "mlivr_gym" / "envs_assets"
    data.mkdir(parents=True)
    for path in (copy / "envs_assets").glob("table-*.npz"):
        if path.stat().st_size > LARGE:
            path.rename(data / path.name)
    (place / "pyproject.toml").write_text(OF_TABLES.format(number=number) + links, "utf-8")
    shutil.copy2(copy / "LICENSE", place)
    return place


def main() -> int:
    """Build the release, or print what must be done before; return the exit code."""
    parser = argparse.ArgumentParser(description="Build the files of a release.")
    parser.add_argument("--repository", required=True, help="address of the public repository")
    parser.add_argument("--out", default="dist", type=Path, help="folder (default: %(default)s)")
    parser.add_argument("--trial", action="store_true", help="build though it is no release yet")
    args = parser.parse_args()
    if not re.fullmatch(r"https://[^\s/]+/\S+[^\s/]", args.repository):
        print(f"{args.repository!r} is no address such as https://host/owner/name", file=sys.stderr)
        return 2
    number = version()
    found = [] if args.trial else problems(number)
    for problem in found:
        print(f"not ready for release {number}: {problem}", file=sys.stderr)
    if found:
        return 1
    build(args.repository, number, args.out)
    print(f"{args.out} holds wheels and sdists of {number}; tag the commit v{number}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
