"""A slow model of the environment, written from its docstring and from nothing else of it.

It asks the stance graph for states and their successors and does not look into a state but for its
stance. Everything else is plain Python: random numbers, tasks, rewards, ends, counts.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

WORD = 2**64
MOST_STEPS = 12


class SplitMix:
    """splitmix64 (Steele, Lea and Flood, 2014) in integers of Python."""

    def __init__(self, seed):
        self.state = int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])

    def bits(self):
        """The upper 53 bits of the next word."""
        self.state = (self.state + 0x9E3779B97F4A7C15) % WORD
        z = self.state
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 % WORD
        z = (z ^ z >> 27) * 0x94D049BB133111EB % WORD
        return (z ^ z >> 31) >> 11

    def below(self, bound):
        return self.bits() * bound // 2**53

    def happens(self, probability):
        return self.bits() < probability * 2**53


class Done(NamedTuple):
    """What a step returns besides observation and information."""

    reward: float
    terminated: bool
    truncated: bool


class Outcome(NamedTuple):
    """What a reward of a user may look at."""

    displacement: float
    distance_before: float
    distance_after: float
    success: bool
    valid: bool


class Toll:
    """A user's reward of all figures of the outcome, with weights that tell them apart."""

    def __call__(self, outcome):
        progress = outcome.distance_before - outcome.distance_after
        toll = np.where(outcome.valid, 0.25, 4.0)
        return 3.0 * progress - outcome.displacement - toll + 7.0 * outcome.success


class Rules(NamedTuple):
    """What the environments are made with."""

    reward: object = "steps"
    success_bonus: float = 0.0
    shaping: bool = False
    discount: float = 0.99
    goal_tolerance: float = 0.2
    limit: int = 100


class EnvModel:
    """One robot, one episode after another."""

    def __init__(self, graph, rules, risk):
        self.graph, self.rules, self.risk = graph, rules, risk
        self.points, self.stream, self.over = len(graph.grasp_map), None, True
        self.invalid = self.failed = False

    def reset(self, seed=None, start=None, goal=None):
        if seed is not None:
            self.stream = SplitMix(seed)
        state = None if start is None else self.graph.state(start)
        if state is None or goal is None:
            drawn, drawn_goal = self._draw(state)
            state = drawn if state is None else state
            goal = drawn_goal if goal is None else np.array(goal, dtype=float)
        self.state, self.goal = state, goal
        self.steps, self.translation, self.over = 0, 0.0, False
        self.invalid = self.failed = False

    def step(self, action):
        rules, limb, point = self.rules, *divmod(action, self.points)
        steps = self.graph.successors(self.state)
        before, k = self._away(), steps.find(limb, point)
        self.invalid, self.failed = k < 0, False
        moved = self.graph.max_displacement
        if k >= 0:
            after = steps.after(self.state, k)
            moved = math.dist(self._base(after), self._base(self.state))
            risk = float(self.risk[point])
            if risk > 0.0 and self.stream.happens(risk):
                self.failed, moved, after = True, 2.0 * moved, self._went_back(after, limb)
            self.state = after
            self.translation += moved
        self.steps += 1
        success = self._away() <= rules.goal_tolerance
        reward = -1.0 if rules.reward == "steps" else -moved
        if callable(rules.reward):
            there = moved if k >= 0 else 0.0
            reward = rules.reward(Outcome(there, before, self._away(), success, k >= 0))
        reward += rules.success_bonus if success else 0.0
        if rules.shaping:
            reward += rules.discount * self._phi(self._away()) - self._phi(before)
        truncated = self.steps >= rules.limit
        self.over = success or truncated
        return Done(reward, success, truncated)

    def mask(self):
        steps = self.graph.successors(self.state)
        out = np.zeros(self.graph.limbs * self.points, dtype=bool)
        for limb, point in zip(steps.limb, steps.point, strict=True):
            out[limb * self.points + point] = True
        return out

    def observation(self):
        """All but `branches`, which would need a look into the state."""
        posture = self.graph.posture(self.state.stance)
        turn = Rotation.from_matrix(posture.base_rotation[0]).as_quat(scalar_first=True)
        grasps = [self.graph.grasp_map.positions[point] for point in self.state.stance]
        return {
            "stance": np.array(self.state.stance),
            "grasps": np.concatenate(grasps),
            "base_position": posture.base_position[0],
            "base_quaternion": turn if turn[0] >= 0.0 else -turn,
            "goal": self.goal,
        }

    def info(self):
        posture = self.graph.posture(self.state.stance)
        return {
            "stance": tuple(self.graph.grasp_map.ids[point] for point in self.state.stance),
            "base_position": posture.base_position[0],
            "base_translation": self.translation,
            "steps": self.steps,
            "limb_manipulability": posture.w_m[0],
            "base_manipulability": posture.w_b[0],
            "action_mask": self.mask(),
            "is_success": self._away() <= self.rules.goal_tolerance,
            "invalid_action": self.invalid,
            "grasp_failed": self.failed,
        }

    def _went_back(self, after, limb):
        """The limb that moved is where it was, the others are as after the step."""
        grasped = self.graph.branch_set_after_grasp(self.state, limb)
        each = [grasped if i == limb else mask for i, mask in enumerate(after.branch_sets)]
        return self.state._replace(branch_sets=tuple(each))

    def _base(self, state):
        return self.graph.posture(state.stance).base_position[0]

    def _away(self):
        return math.dist(self._base(self.state), self.goal)

    def _phi(self, away):
        return 0.0 if away <= self.rules.goal_tolerance else -away

    def _draw(self, given):
        graph = self.graph
        low, high = graph.grasp_map.cabin
        while True:
            start = given
            while start is None:
                stance = graph.points[self.stream.below(len(graph.points))].tolist()
                if not graph.occupied.intersection(stance) and self._leaves(stance):
                    start = graph.state(stance)
            target = graph.grasp_map.positions[self.stream.below(self.points)]
            goal = self._walk(start, target)
            far = math.dist(goal, self._base(start)) > self.rules.goal_tolerance
            if far and (goal >= low).all() and (goal <= high).all():
                return start, goal

    def _leaves(self, stance):
        node = self.graph.is_node(self.graph.posture(stance))[0]
        return node and len(self.graph.successors(self.graph.state(stance)).limb) > 0

    def _walk(self, state, target):
        for _ in range(MOST_STEPS):
            steps = self.graph.successors(state)
            away = [math.dist(base, target) for base in steps.base_position]
            if not away or min(away) >= math.dist(self._base(state), target):
                break
            state = steps.after(state, away.index(min(away)))
        return self._base(state)
