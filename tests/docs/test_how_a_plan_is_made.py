"""The page that follows two queries names functions that there are, and that both queries call."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

from mlivr_gym import stance_graph
from mlivr_gym.errors import MlivrError
from mlivr_gym.planners import Planner

DOCS = Path(__file__).parent.parent.parent / "docs"
PAGE = (DOCS / "how-a-plan-is-made.md").read_text(encoding="utf-8")
NAMED = re.findall(r"^## \d+\. `([\w./]+)::([\w.]+)`$", PAGE, re.MULTILINE)


@pytest.fixture(scope="module")
def site():
    """What the site is built with."""
    spec = importlib.util.spec_from_file_location("conf", DOCS / "conf.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_it_names_at_most_seven_files_and_each_function_is_there(site):
    files = [path for path, _ in NAMED]
    assert len(NAMED) == PAGE.count("\n## ")
    assert len(set(files)) == len(files) <= 7
    shown = site.with_lines(PAGE)
    for path, name in NAMED:
        line = int(re.search(rf"`{path}::{name}` \(line (\d+)\)", shown)[1])
        source = (site.PACKAGE / path).read_text(encoding="utf-8").splitlines()
        assert re.match(rf"\s*def {name.rpartition('.')[2]}\(", source[line - 1])
    with pytest.raises(MlivrError, match=r"planner\.py has no Planner\.gone"):
        site.with_lines("## 1. `planners/planner.py::Planner.gone`")


@pytest.mark.parametrize(
    ("robot", "start", "goal"),
    [("mlivr2", ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)),
     ("mlivr4", ("A2a:4", "A1b:0", "A1b:7", "A1b:5"), (5.3022, 0.4301, -0.1228))],
)  # fmt: skip
@pytest.mark.docs
def test_both_queries_call_them_in_this_order(robot, start, goal):
    """By the names of file and function: a method may be that of a class below."""
    planner, called = Planner(stance_graph(robot=robot)), {}

    def note(frame, event, _):
        if event == "call":
            code = frame.f_code
            called.setdefault((Path(code.co_filename).name, code.co_name), len(called))

    sys.setprofile(note)
    try:
        plan = planner.plan(start, goal, "steps").unwrap()
    finally:
        sys.setprofile(None)
    assert len(plan.steps)
    places = [called[Path(path).name, name.rpartition(".")[2]] for path, name in NAMED]
    assert places == sorted(places)
