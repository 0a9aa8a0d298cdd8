"""Public objects that were used before answer as new ones: pickled, copied, in another process."""

import copy
import gc
import inspect
import pickle
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context

import gymnasium
import pytest
from public_objects import (
    CASES,
    GOAL,
    REMEMBERED,
    START,
    TARGET,
    asked,
    collect,
    public_classes,
    same,
)

from mlivr_gym.agents import evaluate
from mlivr_gym.compiled.records import Record
from mlivr_gym.errors import MlivrError, TimingError, UnknownPointError
from mlivr_gym.planners import Planner
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.planning_result import Timer
from mlivr_gym.simulation.execution import execute


def pickled(value):
    return pickle.loads(pickle.dumps(value))


WAYS = (pickled, copy.copy, copy.deepcopy)

SCREEN = {"SceneWindow"}
"""What shows something on a screen, which belongs to one process."""

ELSEWHERE = {
    "Imitation", "LearnedPolicy", "PointObservation", "TableFeatures", "TableVecEnv", "RecordVideo",
    "SensingRobot", "StanceGraphEnv",
}  # fmt: skip
"""What needs torch or a folder, is part of a `ClosedLoopEnv`, or the base of environments."""


SENT = (
    "StanceGraph", "of three limbs", "Planner", "MlivrEnv", "MlivrVectorEnv", "PlanPolicy",
    "Belief", "SceneRenderer",
)  # fmt: skip
"""Objects of each kind, for another process."""


@cache
def truth(name):
    """The answer of a new object."""
    return CASES[name].ask(CASES[name].new())


@pytest.fixture(scope="module", autouse=True)
def truth_goes_with_this_file():
    yield
    for one in (truth, *REMEMBERED):
        one.cache_clear()
    gc.collect()


def used(name):
    one = CASES[name].new()
    CASES[name].use(one)
    return one


@pytest.mark.parametrize("name", CASES)
def test_a_copy_answers_as_a_new_object(name):
    one = used(name)
    copies = [way(one) for way in WAYS]
    for way, other in zip(WAYS, copies, strict=True):
        assert same(CASES[name].ask(other), truth(name)), way
    assert same(CASES[name].ask(one), truth(name))  # whatever the copies did


def test_an_object_answers_in_a_spawned_process_as_here():
    sent = {name: used(name) for name in SENT}
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        jobs = {name: pool.submit(asked, name, one) for name, one in sent.items()}
        for name, job in jobs.items():
            assert same(job.result(), truth(name)), name


def test_records_are_copied_with_all_that_they_hold(plan, checked_graph):
    """Of every class of the reference: what holds state is asked, what is a record is compared."""
    graph, found = checked_graph, {}
    env = gymnasium.make("MLIVR-JEM-v0", dynamics="mujoco", disturbances="all").unwrapped
    env.reset(seed=3)
    evaluation = evaluate(env, CASES["RandomPolicy"].new(), episodes=1, max_steps=1)
    start = graph.state(START)
    roots = (
        plan, execute(graph, plan), env, evaluation, graph, graph.table, graph.successors(start),
        Planner(graph).plan(START, TARGET), Planner(graph).why_not(START, (8.0, 0.5, 0.5)),
        algorithm1(graph, start, GOAL, limit=5), Timer(), graph.grasp_map.boxes, env.spec,
    )  # fmt: skip
    collect(roots, found)
    for name in [*found]:
        if name in CASES or isinstance(found[name], gymnasium.Env):
            continue
        for way in WAYS:
            assert same(way(found[name]), found[name]), (name, way)
    unknown = []
    for name, one in public_classes().items():
        is_record = issubclass(one, tuple | dict | Record) or "__dataclass_params__" in vars(one)
        is_error, is_base = issubclass(one, MlivrError), inspect.isabstract(one)
        is_protocol = getattr(one, "_is_protocol", False)
        known = {*found, *CASES, *SCREEN, *ELSEWHERE}
        if not (name in known or is_record or is_error or is_base or is_protocol):
            unknown.append(name)
    assert not unknown


@pytest.mark.parametrize("way", WAYS)
def test_errors_are_copied_with_message_and_attributes(way):
    kinds = [one for one in public_classes().values() if issubclass(one, MlivrError)]
    errors = [UnknownPointError("D9z:9", ["D1a:0", "D1a:1"]), TimingError(1.0, "the speed", 2.5)]
    errors += [kind("a message") for kind in kinds if kind not in {type(one) for one in errors}]
    assert len(errors) == len(kinds) > 10
    for error in errors:
        other = way(error)
        assert (type(other), str(other), vars(other)) == (type(error), str(error), vars(error))
