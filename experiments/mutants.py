"""Mutation testing: plant 150 small faults, one at a time, and check whether a test fails.

    python experiments/mutants.py [--minutes 60] [--strata agents simulation] [--again]

The faults are drawn by a seed, the same number from each stratum of the sources and evenly over the
kinds of faults. Each runs in a copy of the repository with the tests of its module, those named
after it first, until one fails. Results are stored in `results/mutants.json`: an interrupted run
can be resumed, and a fault runs again once its function has changed. Writes the report
`results/mutants.md`.
"""

from __future__ import annotations

import ast
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from mutation import Mutant, mutants_of, planted
from reports import ROOT, command_line, keep, read, table

from mlivr_gym.files import write_whole

SEED, COUNT = 14, 150
LIMIT = 600.0
"""Time limit for the tests of a fault [s], after which it stays undecided.

Each test has its own, shorter limit, so that a fault that hangs makes a test fail long before."""


PLAIN = ("kinematics/test_base_path.py", "kinematics/test_certificate.py",
         "kinematics/test_manipulability.py", "kinematics/test_poses.py",
         "kinematics/test_families.py", "transitions/test_rule.py",
         "compiled/test_records.py", "kinematics/test_holding.py",
         "planners/test_bucket_queue.py", "collisions/test_distances.py",
         "collisions/test_box_grid.py", "collisions/test_placing.py",
         "collisions/test_against_boxes.py", "robot/test_limb.py")  # fmt: skip
"""Tests that are quick without compilation; faults in kernels of their folders meet them first."""

STRATA = {
    "kinematics": ("mlivr_gym/kinematics", "mlivr_gym/postures", "mlivr_gym/robot"),
    "collisions": ("mlivr_gym/collisions",),
    "stances and search": ("mlivr_gym/stances", "mlivr_gym/transitions", "planners"),
    "environment": ("mlivr_gym/envs",),
    "simulation": ("mlivr_gym/simulation", "mlivr_gym/motion"),
    "agents": ("agents",),
    "command line and files": (
        "mlivr_gym/cli", "mlivr_gym/world", "mlivr_gym/files.py", "mlivr_gym/values.py",
        "mlivr_gym/settings.py",
    ),
}  # fmt: skip
"""Folders and files of each stratum."""

LONG = ("envs/test_env.py", "planners/test_algorithm1.py", "envs/test_against_model.py",
        "planners/test_planner.py", "envs/test_actions.py",
        "motion/test_commitment.py", "postures/test_given_pose.py",
        "collisions/test_sweep.py")  # fmt: skip
"""Test files that take longest and run last."""


def drawn(stratum: str, count: int, seed: int) -> list[Mutant]:
    """Return random faults of a stratum, evenly over their kinds as long as enough exist."""
    kinds: dict[str, list[Mutant]] = defaultdict(list)
    for place in STRATA[stratum]:
        base = ROOT / place
        for path in [base] if base.is_file() else sorted(base.rglob("*.py")):
            for mutant in mutants_of(ROOT, path.relative_to(ROOT).as_posix()):
                kinds[mutant.operator].append(mutant)
    for kind in kinds.values():
        kind.sort(key=lambda mutant: mutant.rank(seed), reverse=True)
    found: list[Mutant] = []
    while len(found) < count:
        for name in sorted(kinds):
            if kinds[name] and len(found) < count:
                found.append(kinds[name].pop())
    return found


def shares(count: int, seed: int) -> dict[str, list[Mutant]]:
    """Return the faults of all strata."""
    sizes = [count // len(STRATA) + (k < count % len(STRATA)) for k in range(len(STRATA))]
    return {name: drawn(name, size, seed) for name, size in zip(STRATA, sizes, strict=True)}


def tests_of(path: str) -> list[str]:
    """Return the tests of a module: named after it, importing it, of its folder; long ones last."""
    module = path.removeprefix("mlivr_gym/").removesuffix(".py").replace("/", ".")
    imported = re.compile(rf"mlivr_gym\.{re.escape(module)}\b")
    found = []
    for file in (ROOT / "tests").rglob("test_*.py"):
        name = file.relative_to(ROOT / "tests").as_posix()
        named = file.stem == f"test_{Path(path).stem}"
        imports = bool(imported.search(file.read_text(encoding="utf-8")))
        if named or imports or file.parent.name == Path(path).parent.name:
            found.append((name in LONG, not named, not imports, f"tests/{name}"))
    return [test for *_, test in sorted(found)]


class Tree:
    """A copy of the repository in which faults are planted."""

    def __init__(self, folder: Path) -> None:
        """Update the copy; equal files remain, with their compiled code."""
        self.folder, self.cache = folder / "tree", folder / "cache"
        self.sound: set[str] = set()
        """Tests that failed with a fault and were seen to pass without."""
        listed = subprocess.run(
            ["git", "ls-files", "-co", "--exclude-standard"],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout.splitlines()  # fmt: skip
        for name in listed:
            source, target = ROOT / name, self.folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_symlink():
                target.unlink(missing_ok=True)
                target.symlink_to(os.readlink(source))
            elif not target.is_file() or source.read_bytes() != target.read_bytes():
                shutil.copy2(source, target)

    def pytest(self, tests: list[str], limit: float, **given: str) -> tuple[int | None, str]:
        """Run tests; return the exit status, None at the time limit, and the test that failed."""
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider",
                   "--tb=no", "--no-header", "-rfE", *tests]  # fmt: skip
        environment = {
            **os.environ,
            "PYTHONPATH": str(self.folder),
            "MLIVR_GYM_CACHE": str(self.cache),
            "PYTHONDONTWRITEBYTECODE": "1",
            **given,
        }
        process = subprocess.Popen(
            command, cwd=self.folder, env=environment, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            output = process.communicate(timeout=limit)[0]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            process.communicate()
            return None, "takes too long"
        if "file or directory not found" in output:
            raise SystemExit(f"{output.strip()[-200:]}: the tests have changed during the run")
        failed = re.search(r"^(?:FAILED|ERROR) (tests/.*?)(?: - .*)?$", output, re.MULTILINE)
        last = output[-200:].strip() if process.returncode else ""
        return process.returncode, failed[1] if failed else last

    def run(self, mutant: Mutant, tests: list[str]) -> dict[str, Any]:
        """Plant a fault, run the tests and restore the source."""
        path, began = self.folder / mutant.path, time.perf_counter()
        source = path.read_bytes()
        times = path.stat().st_atime_ns, path.stat().st_mtime_ns
        plain = [test for test in tests if test.removeprefix("tests/") in PLAIN]
        try:
            path.write_bytes(planted(source, mutant))
            status, test = 0, ""
            if mutant.compiled and plain:
                status, test = self.pytest(plain, LIMIT, NUMBA_DISABLE_JIT="1")
            if status == 0:
                status, test = self.pytest(tests, LIMIT)
        finally:
            path.write_bytes(source)
            os.utime(path, ns=times)
        if status and test.startswith("tests/") and test not in self.sound:
            if self.pytest([test], LIMIT)[0] != 0:
                status, test = 0, f"{test} fails without a fault too"
            else:
                self.sound.add(test)
        seconds = round(time.perf_counter() - began, 1)
        return {"caught": None if status is None else status != 0, "by": test or None,
                "seconds": seconds}  # fmt: skip


def digest(mutant: Mutant) -> str:
    """Return the digest of the function around a fault, until whose change its result is valid."""
    source = (ROOT / mutant.path).read_text(encoding="utf-8")
    text = source
    for node in ast.walk(ast.parse(source)):
        inside = isinstance(node, ast.FunctionDef) and node.name == mutant.function.split(".")[-1]
        if inside and node.lineno <= mutant.line <= (node.end_lineno or 0):
            text = ast.get_source_segment(source, node) or source
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def report(draw: dict[str, list[Mutant]], results: dict[str, Any], equal: dict[str, str]) -> str:
    """Return the page."""
    rows: list[list[Any]] = []
    survivors: list[Mutant] = []
    for name, mutants in draw.items():
        ran = [m for m in mutants if results.get(m.key, {}).get("digest") == digest(m)]
        uncaught = [m for m in ran if not results[m.key]["caught"]]
        survivors += uncaught
        same = sum(m.key in equal for m in uncaught)
        rows.append([name, len(mutants), len(ran), same, len(ran) - len(uncaught)])
    rows.append(["**all**", *(sum(row[k] for row in rows) for k in range(1, 5))])
    for row in rows:
        count = row[2] - row[3]
        row.append(f"{100.0 * row[4] / count:.0f} %" if count else "-")
    items = []
    for mutant in survivors:
        why = equal.get(mutant.key)
        items.append(f"""* `{mutant.path}:{mutant.line}` ({mutant.operator}), \
{f"equivalent: {why}" if why else "not caught"}

  ```diff
  - {mutant.before}
  + {" ".join(mutant.after.split())}
  ```
""")
    return f"""# Faults that the tests notice

{rows[-1][1]} faults drawn with seed {SEED} by `experiments/mutants.py` (`make mutants`), the same \
number from each stratum. Equivalent faults, which change no observable behaviour, are justified \
below and do not count.

{table("stratum | drawn | run | equivalent | caught | share", rows)}
## Survivors

{"".join(items)}"""


def main() -> None:
    """Run the faults without a valid result until the time is over."""
    parser = command_line(__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--strata", nargs="*", default=list(STRATA), choices=list(STRATA))
    parser.add_argument("--again", action="store_true", help="run survivors again")
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument(
        "--folder", type=Path, default=Path(tempfile.gettempdir()) / "mlivr-gym-mutants"
    )
    args = parser.parse_args()
    results, equal = (read(args.out, name) for name in ("mutants", "mutants_equivalent"))
    draw, tree, ends = shares(args.count, SEED), Tree(args.folder), time.time() + 60 * args.minutes
    todo = [(name, mutant) for name in args.strata for mutant in draw[name]]
    for k, (name, mutant) in enumerate(todo):
        known = results.get(mutant.key)
        again = known and args.again and not known["caught"] and mutant.key not in equal
        if (known and known["digest"] == digest(mutant) and not again) or time.time() > ends:
            continue
        done = tree.run(mutant, tests_of(mutant.path))
        word = {True: "caught", False: "SURVIVED", None: "undecided"}[done["caught"]]
        if done["caught"] is not None:
            results[mutant.key] = {"stratum": name, "digest": digest(mutant), **done}
        print(f"{k + 1}/{len(todo)} {word} {done['seconds']} s {mutant.line} {mutant.key}")
        print(f"    {done['by']}", flush=True)
        keep(args.out, "mutants", dict(sorted(results.items())))
    write_whole(args.out / "mutants.md", report(draw, results, equal))


if __name__ == "__main__":
    main()
