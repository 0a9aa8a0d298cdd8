"""A small package with kernels that call each other across files, compiled and cached as ours."""

import shutil
from pathlib import Path

from processes import printed

from mlivr_gym.compiled import cache

SOURCES = {
    "caller.py": """
from mlivr_gym.callee import middle
from mlivr_gym.compiled.kernels import entry


@entry
def outer(x):
    return middle(x) + 1
""",
    "callee.py": """
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.part import (
    inner,
)


@kernel
def middle(x):
    return 10 * inner(x)
""",
    "part/__init__.py": "from mlivr_gym.part.innermost import inner",
    "part/innermost.py": """
from mlivr_gym.compiled.kernels import kernel


@kernel
def inner(x):
    return 2 * x
""",
    "bystander.py": "from mlivr_gym.caller import outer",
}


def package_in(folder):
    """The package, in a folder."""
    package = folder / "mlivr_gym"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    compiled = Path(cache.__file__).parent
    shutil.copytree(compiled, package / "compiled", ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in SOURCES.items():
        (package / name).parent.mkdir(exist_ok=True)
        (package / name).write_text(text)
    return package


def run_with(package, kept, code, **variables):
    """What a process prints that has the package, and keeps machine code in a folder."""
    variables |= {"PYTHONPATH": package.parent, cache.CACHE_VARIABLE: kept, "NUMBA_CACHE_DIR": ""}
    return printed("-c", code, cwd=package.parent, **variables)
