"""Instances of the public classes, how they are used, and what is then asked of them."""

import inspect
from dataclasses import fields, is_dataclass
from functools import cache
from typing import NamedTuple

import gymnasium
import numpy as np
from map_data import LADDER
from public_api import PAGES, members
from small_tables import small_map, small_table

from mlivr_gym import Box, jem_map, stance_graph
from mlivr_gym.agents import (
    ExpertPolicy,
    RandomPolicy,
    baseline_policy,
    planner_policy,
)
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.extensions.closed_loop import Belief, LookingPolicy, ReplanningPolicy
from mlivr_gym.pictures.rendering import SceneRenderer
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.lower_bounds import LowerBounds
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.planners.searches import run_search
from mlivr_gym.planners.table_search import TableSearch

START, TARGET = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)
BOX = Box.between("box", "obstacle", (3.0, -0.5, -0.2), (3.3, -0.2, 0.1))
IN_VIEW = Box.between("box", "obstacle", (1.0, -0.3, 0.2), (1.4, 0.3, 0.6))
"""In the picture of the ladder."""
LOOP, UNKNOWN = "MLIVR-JEM-ClosedLoop-v0", "MLIVR-JEM-Unknown-v0"
JEM = jem_map()
PART = JEM.subset((JEM.positions[:, 0] < 3.0) & (np.arange(len(JEM)) % 2 == 0), "part")
"""Where environments of many tasks and things are quick."""
GOAL = Goal(np.array(TARGET), 0.2, Cost.named("base"))


@cache
def public_classes():
    """The classes of the API reference, by their names."""
    return {one.__name__: one for page in PAGES for one in members(page) if inspect.isclass(one)}


def same(one, other, known=None):
    """Whether two values are equal in all that they hold, however deep."""
    known = set() if known is None else known
    if one is other or (id(one), id(other)) in known:
        return True
    known.add((id(one), id(other)))
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray) and not one.dtype.hasobject:
        alike = one.dtype == other.dtype and one.shape == other.shape
        return alike and one.tobytes() == other.tobytes()
    if isinstance(one, np.ndarray):
        one, other = one.tolist(), other.tolist()
    if isinstance(one, dict):
        alike = list(one) == list(other)
        return alike and all(same(one[name], other[name], known) for name in one)
    if isinstance(one, list | tuple):
        pairs = zip(one, other, strict=False)
        return len(one) == len(other) and all(same(*pair, known) for pair in pairs)
    if is_dataclass(one):
        names = [field.name for field in fields(one)]
        return all(same(getattr(one, name), getattr(other, name), known) for name in names)
    if type(one).__module__.startswith("mlivr_gym.") and hasattr(one, "__dict__"):
        return same(vars(one), vars(other), known)
    return bool(one == other) or (one != one and other != other)


def collect(value, found, depth=0, known=None):
    """Find one instance of each public class in what a value holds."""
    known = set() if known is None else known
    if id(value) in known or depth > 12:
        return
    known.add(id(value))
    if public_classes().get(type(value).__name__) is type(value):
        found.setdefault(type(value).__name__, value)
    inside = list(value)[:50] if isinstance(value, list | tuple | set | frozenset) else []
    inside += list(value.values())[:50] if isinstance(value, dict) else []
    if hasattr(value, "__dict__") and not isinstance(value, type):
        inside += list(vars(value).values())
    for one in inside:
        collect(one, found, depth + 1, known)


class Case(NamedTuple):
    """How an object is made and used, and a question whose answer does not depend on the use."""

    new: object
    use: object
    ask: object


def steps_and_world(graph):
    """Steps from a state among an obstacle and an occupied point, and without them."""
    out = [graph.version, graph.obstacles, graph.occupied]
    for _ in range(2):
        state = graph.state(START)
        out += [state, graph.successors(state), graph.configuration(state)]
        graph.remove_obstacles()
        graph.vacate()
    return out


def among_obstacles():
    graph = stance_graph()
    graph.successors(graph.state(START))
    graph.add_obstacles([BOX])
    graph.occupy(["D2b:6"])
    return graph


def plans(planner):
    """Lengths, costs and bounds of plans with and without a box."""
    out = []
    for boxes in ((), (BOX,)):
        planner.graph.add_obstacles(boxes)
        found = [planner.plan(START, TARGET, cost).unwrap() for cost in ("steps", "base")]
        out += [(len(one.steps), one.statistics.cost, one.statistics.bound) for one in found]
        planner.graph.remove_obstacles()
    return out


def three_limbs():
    """A graph on a few points with a table that no file has."""
    graph = stance_graph(small_map(), "mlivr3")
    graph.graph_table = small_table(3)[0].graph_table
    return graph


def some_stances(graph):
    return [tuple(row) for row in small_table(3)[1].points[::150].tolist()]


def plans_of_three_limbs(graph):
    stances = some_stances(graph)
    goal, planner = graph.posture(stances[-1]).base_position[0].tolist(), Planner(graph)
    found = [
        planner.plan(one, goal, "steps", goal_tolerance=0.05, options=SearchOptions(inflation=1.0))
        for one in stances
    ]
    costs = [one.plan and (one.plan.statistics.cost, one.plan.statistics.bound) for one in found]
    return graph.table is None, costs, [graph.successors(graph.state(one)) for one in stances]


def search():
    graph = stance_graph()
    return TableSearch(
        LowerBounds(graph), SearchQuery.from_options(graph, GOAL), graph.state(START)
    )


def found_by(given):
    found = run_search(given)
    return found.states, found.cost


def bounds(lower_bounds):
    """Lower bounds, and what a search with their scratch finds."""
    graph = lower_bounds.graph
    query = SearchQuery.from_options(graph, GOAL)
    found = run_search(TableSearch(lower_bounds, query, graph.state(START)))
    return found.states, found.cost, lower_bounds.compute(GOAL, np.arange(10)).h


def checked_nodes(table):
    table.check_nodes(np.arange(200))
    return table.table.branch_sets[:200], table.table.releasable[:200]


def present_table():
    graph = stance_graph()
    graph.add_obstacles([BOX])
    return graph.present


def costs_to_go(costs):
    state = costs.graph.state(START)
    return costs.values, costs.action_values(state, costs.graph.successors(state))


def environment(id, **given):
    def new():
        env = gymnasium.make(id, **given).unwrapped
        env.reset(seed=3)
        play(env)
        return env

    return Case(new, lambda env: env.action_masks(), lambda env: (play(env), env.reset()))


def play(env, count=2):
    """What comes of valid actions, which are drawn from the same numbers."""
    out, rng = [], np.random.default_rng(1)
    for _ in range(count):
        out.append(env.step(int(rng.choice(np.flatnonzero(env.action_masks())))))
    return out


def vector():
    env = gymnasium.make_vec("MLIVR-JEM-v0", num_envs=3, grasp_failure=0.3)
    env.reset(seed=3)
    play_batch(env)
    return env


def play_batch(env):
    out, rng = [], np.random.default_rng(1)
    for _ in range(3):
        drawn = [rng.choice(np.flatnonzero(mask)) for mask in env.action_masks()]
        out.append(env.step(np.array(drawn)))
    return out


def masked():
    env = ActionMaskObservation(gymnasium.make("MLIVR-JEM-v0"))
    env.reset(seed=3)
    return env


REMEMBERED = []
"""Environments of policies and what they did in them, to be cleared when nobody asks any more."""


def policy(new, id="MLIVR-JEM-v0", then=3, **given):
    """A policy in the middle of an episode, which goes on."""

    @cache
    def env():
        return gymnasium.make(id, **given).unwrapped

    def act(one, count, before=()):
        observation, _ = env().reset(seed=5)
        for action in before:
            observation, *_ = env().step(action)
        out = []
        for _ in range(count):
            out.append(one.act(env(), observation, env().action_masks()))
            observation, *_ = env().step(out[-1])
        return out

    def begun():
        one = new()
        act(one, 1)
        return one

    @cache
    def before():
        return act(new(), 1)

    REMEMBERED.extend((env, before))
    return Case(begun, lambda _: None, lambda one: act(one, then, before()))


def refused(belief):
    """What a belief holds against points before another one is refused."""
    before = sorted(belief.refused), sorted(belief.graph.occupied)
    belief.refuse(len(before[0]))
    return before


def picture(renderer):
    graph = stance_graph(LADDER)
    state = graph.state(tuple(graph.points[0].tolist()))
    return renderer.render(*graph.configuration(state))


def last_picture(renderer):
    """A context of GL takes much memory, and whoever opened it has to close it."""
    found = picture(renderer)
    renderer.close()
    return found


CASES = {
    "StanceGraph": Case(among_obstacles, lambda g: g.successors(g.state(START)), steps_and_world),
    "its own map": Case(
        lambda: stance_graph(LADDER), lambda g: g.neighbouring_nodes(tuple(g.points[0].tolist())),
        lambda g: (len(g), [g.successors(g.state(tuple(p))) for p in g.points[:3].tolist()]),
    ),
    "of three limbs": Case(three_limbs, plans_of_three_limbs, plans_of_three_limbs),
    "without a table": Case(
        lambda: stance_graph(small_map(), "mlivr3"), plans_of_three_limbs, plans_of_three_limbs
    ),
    "Planner": Case(lambda: Planner(stance_graph()), plans, plans),
    "LowerBounds": Case(lambda: LowerBounds(stance_graph()), bounds, bounds),
    "PresentTable": Case(present_table, checked_nodes, checked_nodes),
    "TableSearch": Case(search, lambda _: None, found_by),
    "CostToGo": Case(
        lambda: Planner(stance_graph()).cost_to_go(TARGET), costs_to_go, costs_to_go
    ),
    "MlivrEnv": environment("MLIVR-JEM-v0", grasp_failure=0.3, tasks="far"),
    "with layouts": environment("MLIVR-Random-v0", map=PART),
    "with dynamics": environment("MLIVR-JEM-v0", dynamics="mujoco"),
    "UnknownMapEnv": environment(UNKNOWN, map=PART),
    "UnseenEnv": environment("MLIVR-Unseen-v0"),
    "ClosedLoopEnv": environment(LOOP, map=PART, boxes=0, plates=0, camera=None),
    "MlivrVectorEnv": Case(vector, lambda env: env.action_masks(), play_batch),
    "ActionMaskObservation": Case(masked, lambda env: env.action_masks(), play),
    "RandomPolicy": policy(RandomPolicy),
    "ExpertPolicy": policy(ExpertPolicy),
    "LookingPolicy": policy(lambda: LookingPolicy(RandomPolicy()), UNKNOWN, map=PART),
    "ReplanningPolicy": policy(ReplanningPolicy, LOOP, 1, map=PART, boxes=0, plates=0, camera=None),
    "PlanPolicy": policy(planner_policy),
    "with a baseline": policy(lambda: baseline_policy("local")),
    "Belief": Case(lambda: Belief(stance_graph(LADDER), 0.003), lambda b: b.boxes(), refused),
    "SceneRenderer": Case(
        lambda: SceneRenderer(
            stance_graph(LADDER).grasp_map, stance_graph(LADDER).robot, 64, 48, [IN_VIEW], True
        ),
        picture, last_picture,
    ),
}  # fmt: skip
"""Public objects that change in use, by the names of their classes or by what is special."""


def asked(name, one):
    """The answer of an object in this process, which may be a new one that imports this module."""
    return CASES[name].ask(one)
