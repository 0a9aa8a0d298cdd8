"""Planner, graph, environments and tables that threads share answer as in one thread."""

import os
import pickle
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np
import pytest
from public_objects import same

from mlivr_gym import Box, sharing, stance_graph
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.planners import Planner
from mlivr_gym.stances.table_build import find_table

THREADS = 8
BOX = Box.between("box", "obstacle", (3.6, -0.6, -1.0), (4.0, 0.4, -0.2))


def drawn(graph, count):
    """Tasks between stances drawn from all."""
    rng = np.random.default_rng(5)
    pairs = rng.integers(len(graph), size=(count, 2))
    return [(graph.ids(graph.points[a]), graph.base_position[b].tolist()) for a, b in pairs]


def answer(planner, task, cost):
    """What a plan costs, or why there is none."""
    found = planner.plan(*task, cost)
    return found.reason or (len(found.plan.steps), round(found.plan.statistics.cost, 9))


def in_threads(jobs):
    """The results of functions that as many threads as possible call at the same time."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # threads take turns as often as they can
    try:
        with ThreadPoolExecutor(THREADS) as pool:
            return list(pool.map(lambda job: job(), jobs))
    finally:
        sys.setswitchinterval(before)


@pytest.fixture(scope="module")
def truth():
    """The answers of new planners in one thread, without a box and with it."""
    graph = stance_graph()
    tasks, costs = drawn(graph, 30), ("steps", "base")
    out = {}
    for boxes in ((), (BOX,)):
        graph.add_obstacles(boxes)
        planner = Planner(graph)
        for k, task in enumerate(tasks):
            out.setdefault((k, costs[k % 2]), []).append(answer(planner, task, costs[k % 2]))
    assert sum(one != other for one, other in out.values()) > 5  # the box matters
    return tasks, out


def test_eight_threads_plan_while_another_adds_and_removes_a_box(truth):
    """Each plan is made in one world: without the box, or with it."""
    tasks, known = truth
    graph = stance_graph()
    planners, done = [Planner(graph), Planner(graph)], threading.Event()
    changes = []

    def change():
        while not done.wait(0.001):
            graph.add_obstacles([BOX])
            graph.remove_obstacles([BOX.id])
            changes.append(1)

    changer = threading.Thread(target=change)
    changer.start()
    try:
        questions = [*known] * 3
        found = in_threads(
            [lambda q=q, k=k: answer(planners[k % 2], tasks[q[0]], q[1])
             for k, q in enumerate(questions)]
        )  # fmt: skip
    finally:
        done.set()
        changer.join()
    wrong = [(q, one) for q, one in zip(questions, found, strict=True) if one not in known[q]]
    assert not wrong
    assert changes


def test_threads_share_a_graph_and_an_implicit_graph():
    """All that a graph stores on demand is computed once for all."""
    from small_tables import small_map

    for new in (stance_graph, lambda: stance_graph(small_map(), "mlivr3")):
        alone, together = new(), new()
        if alone.lists_all:
            stances = [tuple(p) for p in alone.points[:: len(alone) // 40].tolist()]
            world = Box.between("b", "obstacle", (2.0, -0.6, -1.0), (2.6, 0.4, -0.4))
            for graph in (alone, together):
                graph.add_obstacles([world])
        else:
            every = np.random.default_rng(3).permuted(np.tile(np.arange(13), (300, 1)), axis=1)
            every = every[:, :3]
            stances = [tuple(p) for p in every[alone.is_node(alone.nodes(every))].tolist()][:24]
        assert len(stances) > 5

        def asked(graph, stance):
            posture = graph.posture(stance)
            if not graph.is_node(posture)[0]:
                return posture.branch_sets
            return graph.successors(graph.state(stance)), posture.branch_sets

        truth = [asked(alone, stance) for stance in stances]
        found = in_threads([lambda s=s, g=together: asked(g, s) for s in stances * 4])
        assert all(same(one, truth[k % len(stances)]) for k, one in enumerate(found))


def among_obstacles():
    env = MlivrEnv()
    env.graph.add_obstacles([BOX])
    return env


@pytest.mark.parametrize(
    ("new", "ask"),
    [
        (stance_graph, lambda one: one.present), (among_obstacles, lambda one: one.moves),
        (stance_graph, find_table), (stance_graph, pickle.dumps),
    ],
)  # fmt: skip
def test_what_is_read_without_a_call_waits_for_the_thread_that_changes_it(new, ask):
    """These compute what they tell, among the obstacles that another thread may be adding."""
    one, told = new(), threading.Event()
    reader = threading.Thread(target=lambda: (ask(one), told.set()))
    with one.lock:
        reader.start()
        assert not told.wait(0.5)
    reader.join()
    assert told.is_set()


def test_threads_step_environments_on_one_graph_each_with_its_episode():
    def new(graph=None):
        env = gymnasium.make("MLIVR-JEM-v0", grasp_failure=0.2).unwrapped
        env.graph = graph or env.graph
        return env

    def episode(env, seed):
        out, rng = [env.reset(seed=seed)], np.random.default_rng(seed)
        for _ in range(25):
            out.append(env.step(int(rng.choice(np.flatnonzero(env.action_masks())))))
            if out[-1][2]:
                break
        return out

    truth = [episode(new(), seed) for seed in range(4)]
    graph = stance_graph()
    envs = [new(graph) for _ in truth]
    found = in_threads([lambda k=k: episode(envs[k], k) for k in range(4)])
    assert same(found, truth)


@pytest.mark.parametrize("new", [MlivrEnv, lambda: MlivrVectorEnv(2, max_episode_steps=None)])
def test_an_environment_that_threads_step_takes_one_step_after_another(new):
    """Each answer is that of one step: no number of steps is told twice, and none is left out."""
    env = new()
    env.reset(seed=1)
    invalid = np.argmin(np.atleast_2d(env.action_masks()), axis=1)
    action = int(invalid[0]) if isinstance(env, MlivrEnv) else invalid
    found = in_threads([lambda: env.step(action)[4]["steps"] for _ in range(1000)])
    assert sorted(np.ravel(found).tolist()) == sorted([*range(1, 1001)] * len(invalid))


@pytest.mark.filterwarnings("ignore:.*fork")
def test_a_forked_process_waits_for_no_thread_of_its_parent():
    """The fork waits until the other thread has left the graph, and the child may use it."""
    graph = stance_graph()
    planner, inside, leave = Planner(graph), threading.Event(), threading.Event()

    def hold():
        with graph.lock:
            inside.set()
            leave.wait(0.5)

    holder = threading.Thread(target=hold)
    holder.start()
    inside.wait()
    child = os.fork()
    if child == 0:
        free = []  # for every thread of the child, not only for the one that forked
        other = threading.Thread(target=lambda: free.append(graph.lock.acquire(timeout=5.0)))
        other.start()
        other.join()
        os._exit(0 if free == [True] else 1)
    leave.set()
    holder.join()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert not sharing._held
    assert planner.plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps")
