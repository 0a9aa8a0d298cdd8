import subprocess
import sys
import time

import numpy as np
import pytest

from mlivr_gym import MlivrError
from mlivr_gym.collisions.swept_hold import hold_free
from mlivr_gym.collisions.swept_swing import swing_free
from mlivr_gym.compiled import kernels as compiled
from mlivr_gym.planners import Planner, searches, warmup
from mlivr_gym.planners.cost_to_go import backward
from mlivr_gym.planners.pair_search import distance_to_goal, search, steps_to_goal

KERNELS = (search, backward, distance_to_goal, steps_to_goal, swing_free, hold_free)


def test_the_second_process_compiles_what_a_plan_calls(checked_graph, monkeypatch):
    """A plan after it needs no further version of the search kernels: the types are the same."""
    warmup.main()
    before = [len(k.signatures) for k in KERNELS]
    monkeypatch.setattr(searches, "PATIENCE", 1)
    for cost in ("base", "steps"):
        Planner(checked_graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), cost).unwrap()
    assert [len(k.signatures) for k in KERNELS] == before


def test_second_process_is_waited_for_and_may_fail(monkeypatch):
    with compiled.second_process("mlivr_gym.no_such_module", True):
        pass
    monkeypatch.setattr(compiled.sys, "executable", "/no/such/python")
    with compiled.second_process("mlivr_gym.planners.warmup", True):
        pass


def test_an_interruption_does_not_wait_for_the_second_process(monkeypatch, tmp_path):
    (tmp_path / "sleeper.py").write_text("import time\ntime.sleep(60)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    began = time.perf_counter()
    for error in (KeyboardInterrupt, MlivrError):
        with pytest.raises(error), compiled.second_process("sleeper", True):
            raise error
    assert time.perf_counter() - began < 10.0


@pytest.mark.parametrize("count", [0, 1, 7, 5000])
def test_in_parallel_covers_every_item_once(count):
    seen = np.zeros(count + 3, dtype=int)

    def visit(start, stop, target):
        target[start:stop] += 1

    compiled.in_parallel(count, visit, seen, first=3, least=2)
    assert (seen[3:] == 1).all()
    assert (seen[:3] == 0).all()


def test_kernel_cache_is_told_apart(tmp_path):
    code = (
        "import sys; sys.path.insert(0, '.')\n"
        "from mlivr_gym.compiled.kernels import is_cached\n"
        "from mlivr_gym.kinematics.ur import branch_terms\n"
        "import numpy as np\n"
        "assert not is_cached(branch_terms)\n"
        "branch_terms(np.ones(3), np.ones(3), np.ones(6), np.empty((4, 4)))\n"
        "assert is_cached(branch_terms)\n"
    )
    import os

    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
