"""Compile the ready-made machine code that ships with the package, for the running Python version.

    python experiments/ready_made.py            # a few minutes
    python experiments/ready_made.py --check    # list the archives that are out of date

The archive holds what the paths of `start_up.py` compile. The target is the oldest supported
processor of a kind: `x86-64-v3` has been built since 2013 and has the instructions that speed up
our kernels. Results are equal to the bit on all processors, since Numba neither fuses nor reorders
floating-point operations by default.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import sys
import tempfile
import time
import zipfile
from pathlib import Path

from start_up import PATHS, ROOT, run

import mlivr_gym.envs_assets
from mlivr_gym.compiled.cache import PACKAGE, kernel_digest
from mlivr_gym.compiled.ready_made import FIRST_PLAN, archive_path, pack
from mlivr_gym.files import write_whole

ASSETS = Path(mlivr_gym.envs_assets.__file__).parent

LEAST = {
    "x86_64": (
        "x86-64-v3",
        "avx avx2 bmi bmi2 cmov crc32 cx16 cx8 f16c fma fxsr lzcnt mmx movbe popcnt sahf sse sse2 "
        "sse3 sse4.1 sse4.2 ssse3 xsave",
    ),
}
"""Target processor and its features as LLVM names them, by kind of machine."""


def build() -> bytes:
    """Return the archive for this Python version and this kind of machine."""
    name, has = LEAST[platform.machine()]
    target = {
        "NUMBA_CPU_NAME": name,
        "NUMBA_CPU_FEATURES": ",".join(f"+{feature}" for feature in has.split()),
    }
    with tempfile.TemporaryDirectory() as cache:
        for path in PATHS:
            found = run(path, Path(cache), **target)
            print(f"{path}: {found['functions']} functions, {found['wall']:.0f} s", flush=True)
        return pack(Path(cache, "kernels"), has.split(), kernel_digest(FIRST_PLAN))


def current() -> dict[str, Path]:
    """Return the source files that contain entries, by digest."""
    sources = [path for path in PACKAGE.glob("*/*.py") if "\n@entry\n" in path.read_text("utf-8")]
    return {kernel_digest(path): path for path in sources}


def faults(path: Path) -> list[str]:
    """Return why an archive cannot be used completely with the present sources and versions."""
    known = current()
    with zipfile.ZipFile(path) as made:
        made_for = json.loads(made.comment)
        old = sum(name.split("/")[0] not in known for name in made.namelist())
        found = [f"{old} of {len(made.namelist())} functions are of other sources"] if old else []
    (pinned,) = re.findall(r"^numba==(.+)$", (ROOT / "constraints.txt").read_text("utf-8"), re.M)
    if made_for["for"]["Numba"] != pinned:
        found.append(f"it is for Numba {made_for['for']['Numba']}, constraints.txt has {pinned}")
    return found


def main() -> int:
    """Build the archive or check all archives; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="list archives that are out of date")
    if parser.parse_args().check:
        found = {path.name: faults(path) for path in sorted(ASSETS.glob("kernels-*.zip"))}
        for name, reasons in found.items():
            for fault in reasons:
                print(f"{name}: {fault}; `python experiments/ready_made.py` builds it again")
        return 1 if any(found.values()) else 0
    began = time.perf_counter()
    content = build()
    write_whole(archive_path(), content)
    took = time.perf_counter() - began
    print(f"{archive_path()}: {len(content) / 1e6:.2f} MB in {took:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
