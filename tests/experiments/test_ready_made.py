"""An archive of machine code that is out of date is said to be."""

import json
import re
import zipfile
from pathlib import Path

import pytest
import ready_made

from mlivr_gym.compiled import cache

ROOT = Path(__file__).parents[2]
RULE = ROOT / "mlivr_gym" / "transitions" / "rule.py"


@pytest.fixture
def pinned():
    (version,) = re.findall(r"numba==(\S+)", (ROOT / "constraints.txt").read_text())
    return version


def archive(path, version, digests):
    with zipfile.ZipFile(path, "w") as made:
        made.comment = json.dumps({"for": {"Numba": version}}).encode()
        for digest in digests:
            made.writestr(f"{digest}/function/signature", b"")
    return path


def test_functions_of_other_sources_are_counted(pinned, tmp_path):
    here = cache.kernel_digest(RULE)
    assert ready_made.faults(archive(tmp_path / "a.zip", pinned, [here])) == []
    found = ready_made.faults(archive(tmp_path / "b.zip", pinned, [here, "0" * 16]))
    assert found == ["1 of 2 functions are of other sources"]


def test_a_numba_that_is_not_installed_with_the_package_is_told(pinned, tmp_path):
    path = archive(tmp_path / "a.zip", "0.1", [cache.kernel_digest(RULE)])
    assert ready_made.faults(path) == [f"it is for Numba 0.1, constraints.txt has {pinned}"]
