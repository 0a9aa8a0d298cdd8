"""Nothing needs what POSIX systems alone have: the package runs where Python lacks it."""

import os
import re
import subprocess
import sys

LOCALE = {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}

AS_ON_WINDOWS = """
import os, signal, sys
import gymnasium, matplotlib.pyplot, mujoco, numba, platformdirs, scipy.optimize, PIL.Image
import concurrent.futures, multiprocessing.resource_tracker, subprocess, tempfile
for name in ("fcntl", "grp", "pwd", "resource", "termios"):
    sys.modules[name] = None
for name in "chown fork getuid geteuid getgid killpg nice pread sched_getaffinity sysconf".split():
    delattr(os, name)
for name in "SIGALRM SIGHUP SIGKILL alarm pthread_kill pthread_sigmask setitimer sigwait".split():
    delattr(signal, name)
"""
"""What makes a process lack what Windows lacks; other packages are imported before."""

WALK = """
from mlivr_gym.cli.main import main
file = os.fsdecode("plän.json".encode())
plan = f"plan --start D2a:4 D2b:4 --goal 6.0 0 0.42 --cost steps --out {file} --picture plan.png"
for _ in range(2):  # the files are new, then replaced
    assert main(plan.split()) == 0
assert main(f"simulate --plan {file} --no-film --out walk".split()) == 0
"""


def test_a_walk_needs_no_call_of_posix(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(AS_ON_WINDOWS + WALK, encoding="utf-8")
    command = [sys.executable, "-X", "warn_default_encoding", str(script)]
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | LOCALE, capture_output=True, check=False
    )
    told = done.stderr.decode(errors="replace")
    assert done.returncode == 0, told
    assert not re.search(r"mlivr_gym\S*: EncodingWarning", told)
    assert {"plän.json", "plan.png", "walk"} <= {path.name for path in tmp_path.iterdir()}
    assert b"\r" not in (tmp_path / "plän.json").read_bytes()
