"""Python programs in processes of their own."""

import os
import subprocess
import sys


def printed(*arguments, cwd=None, given=None, **variables):
    """The lines that Python prints when it is run with arguments, and has to end without an error.

    It gets some environment variables besides those of this process, and a text to read.
    """
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        env=os.environ | {name: str(value) for name, value in variables.items()},
        cwd=cwd, input=given, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout.splitlines()
