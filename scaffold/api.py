"""The names that the scaffold needs, where they lie at present."""

from mlivr_gym import Box, Settings, jem_map, stance_graph  # noqa: F401
from mlivr_gym.envs.tasks import random_state, sample_task  # noqa: F401
from mlivr_gym.motion.plan_motion import plan_trajectory  # noqa: F401
from mlivr_gym.planners import Planner  # noqa: F401
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.pair_graph import fill_rows  # noqa: F401
from mlivr_gym.stances.step_tables import step_tables  # noqa: F401
from mlivr_gym.transitions.state import State


def step_way(graph, tables, s, s2, moving, left):
    """How the step from stance s to s2 is made, on the first branch of the limb that holds."""
    bit = left & -left
    masks = [0, 0]
    masks[1 - moving] = bit
    masks[moving] = 1
    before, after = tuple(graph.points[s].tolist()), tuple(graph.points[s2].tolist())
    both = join(graph.posture(before), graph.posture(after))
    way = graph.edge(State(before, tuple(masks)), after, both)
    return s, s2, moving, way.kind, way.fold, way.pair, way.kept.get(1 - moving, 0)
