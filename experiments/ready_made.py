"""Compile the ready-made machine code of a wheel, for the Python, Numba and platform that run this.

    python experiments/ready_made.py            # some minutes

The archive holds what the paths of `start_up.py` compile. `make release` puts it into a wheel; in
the repository Git ignores it. The target is the oldest supported processor of a kind: `x86-64-v3`
has been built since 2013 and has the instructions that speed up our kernels. Results are equal to
the bit on all processors, since Numba neither fuses nor reorders floating-point operations by
default.
"""

from __future__ import annotations

import platform
import tempfile
import time
from pathlib import Path

from start_up import PATHS, run

from mlivr_gym.compiled.cache import kernel_digest
from mlivr_gym.compiled.ready_made import FIRST_PLAN, archive_path, pack
from mlivr_gym.files import write_whole

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


def main() -> None:
    """Build the archive."""
    began = time.perf_counter()
    content = build()
    write_whole(archive_path(), content)
    took = time.perf_counter() - began
    print(f"{archive_path()}: {len(content) / 1e6:.2f} MB in {took:.0f} s")


if __name__ == "__main__":
    main()
