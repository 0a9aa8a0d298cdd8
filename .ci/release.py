"""Build the wheel and the source distribution of a release.

    make release REPOSITORY=https://github.com/OWNER/mlivr-gym

Links and pictures of the README are relative, so that they work on every branch and in every fork.
On a package index they would lead nowhere. The build therefore copies the tracked files, makes the
README's links absolute at the tag of the version, and adds `[project.urls]` to the copy of
`pyproject.toml`. The address of the repository is an argument and is stored nowhere.
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
    """Build wheel and source distribution from a copy of the tracked files with absolute links."""
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
        command = [sys.executable, "-m", "build", "--outdir", str(out.resolve())]
        subprocess.run([*command, str(copy)], check=True)


def main() -> int:
    """Build the release, or print what must be done before; return the exit code."""
    parser = argparse.ArgumentParser(description="Build wheel and sdist of a release.")
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
    print(f"{args.out} holds wheel and sdist of {number}; tag the commit v{number}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
