"""Snapshots of an environment, and the configurations that a film shows between them.

A snapshot is taken after each action. `snapshot_frames` chooses the branches of the limbs for a
whole episode and returns the configurations that `viewer` renders.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.errors import PlanError
from mlivr_gym.motion.commitment import committed_motion
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

if TYPE_CHECKING:
    from mlivr_gym.simulation.recording import Failure, Recording, SimulatedInterval

FRAMES_PER_ACTION = 10
"""Pictures of one action, which make one second of film."""

SAMPLES_PER_SEGMENT = 100
"""Configurations computed on each path segment of a step, from which those shown are chosen."""

Motion = tuple[Array, Array, Array]
"""Base positions (k, 3) [m], base quaternions (k, 4) and joint angles (k, N, 6) [rad]."""


class Snapshot(NamedTuple):
    """What a picture shows of an environment after a reset or an action."""

    state: State
    """State of the robot."""
    goal: Array
    """Goal position, shape (3,) [m]."""
    steps: int
    """Number of actions since the reset; 0 after a reset."""
    caption: str
    """Text about the last action."""
    simulated_motion: Motion | None
    """Motion of the last step in simulation; None if steps are not simulated."""

    def configuration(self, graph: StanceGraph) -> Configuration:
        """Return the configuration of the robot."""
        if self.simulated_motion is None:
            return graph.configuration(self.state)
        positions, quaternions, joints = self.simulated_motion
        return positions[-1], quaternions[-1], joints[-1]


def action_caption(graph: StanceGraph, action: tuple[int, int], valid: bool, failed: bool) -> str:
    """Return a text that says which limb moved to which point, and what came of it."""
    limb, point = action
    outcome = (", the grasp failed" if failed else "") if valid else ", an invalid action"
    return f"limb {limb} to {graph.grasp_map.ids[point]}{outcome}"


def motion_at_rest(configuration: Configuration) -> Motion:
    """Return a motion that consists of one configuration."""
    position, quaternion, joints = configuration
    return position[None], quaternion[None], joints[None]


def recorded_motion(executed: SimulatedInterval | Failure) -> Motion | None:
    """Return the motion of a simulated step, or None if it could not start."""
    recording = getattr(executed, "recording", None)
    return None if recording is None else motion_of(recording)


def motion_of(recording: Recording) -> Motion:
    """Return the motion of the robot in a recording."""
    return recording.base_positions, recording.base_quaternions, recording.joint_positions


def snapshot_frames(graph: StanceGraph, snapshots: Sequence[Snapshot]) -> list[list[Configuration]]:
    """Return the configurations that are shown for each snapshot.

    The first snapshot of an episode has one, every other snapshot `FRAMES_PER_ACTION`, spaced
    evenly along the robot's path or, in simulation, in time. Branches are chosen for all snapshots
    of an episode at once. If no step was taken, or it cannot be carried out, the robot stands
    still.
    """
    out: list[list[Configuration]] = []
    for first, last in _episode_ranges(snapshots):
        part = snapshots[first:last]
        if any(snapshot.simulated_motion is not None for snapshot in part):
            out += [_simulated_frames(graph, snapshot, k == 0) for k, snapshot in enumerate(part)]
        else:
            out += _walk_frames(graph, [snapshot.state for snapshot in part])
    return out


def _episode_ranges(snapshots: Sequence[Snapshot]) -> list[tuple[int, int]]:
    """Return the first snapshot of each episode, and the one after its last."""
    firsts = [k for k, snapshot in enumerate(snapshots) if k == 0 or snapshot.steps == 0]
    return list(zip(firsts, [*firsts[1:], len(snapshots)], strict=True))


def _simulated_frames(graph: StanceGraph, snapshot: Snapshot, first: bool) -> list[Configuration]:
    """Return the configurations shown for one snapshot of a simulated episode."""
    here = snapshot.configuration(graph)
    if first or snapshot.simulated_motion is None:
        return [here] * (1 if first else FRAMES_PER_ACTION)
    count = len(snapshot.simulated_motion[0])
    chosen = np.linspace(0, count - 1, FRAMES_PER_ACTION + 1).round().astype(int)[1:]
    return _configurations_at(snapshot.simulated_motion, chosen)


def _walk_frames(graph: StanceGraph, states: Sequence[State]) -> list[list[Configuration]]:
    """Return the configurations shown for a walk; the robot stands still where the stance stays."""
    changes = [k for k, s in enumerate(states) if k == 0 or s.stance != states[k - 1].stance]
    # Branches may be lost while the stance stays, so the last state of each stance counts.
    ends = [*(k - 1 for k in changes[1:]), len(states) - 1]
    moved = _moving_frames(graph, [states[k] for k in ends])
    out: list[list[Configuration]] = []
    for k, last, pictures in zip(changes, ends, moved, strict=True):
        out += [pictures, *[[pictures[-1]] * FRAMES_PER_ACTION] * (last - k)]
    return out


def _moving_frames(graph: StanceGraph, states: Sequence[State]) -> list[list[Configuration]]:
    """Return the configurations shown for a walk whose stance changes with every state."""
    found = committed_motion(graph, states)
    if found.motion is None:
        cut = (found.failed or 0) + 1
        before, after = _moving_frames(graph, states[:cut]), _moving_frames(graph, states[cut:])
        return [*before, after[0] * FRAMES_PER_ACTION, *after[1:]]
    motion = found.motion
    postures: Motion = motion.base_positions, motion.base_quaternions, motion.joint_positions
    out = [_configurations_at(postures, np.array([0]))]
    for k in range(len(states) - 1):
        try:
            path = motion.joint_path(graph.robot, k).samples(SAMPLES_PER_SEGMENT)
        except PlanError:
            out.append(_configurations_at(postures, np.array([k + 1])) * FRAMES_PER_ACTION)
            continue
        walked = path.base_positions, path.base_quaternions, path.joint_positions
        out.append(_configurations_at(walked, _evenly_spaced(walked)))
    return out


def _evenly_spaced(motion: Motion) -> IntArray:
    """Return samples of a motion at equal distances along it, the last one included."""
    positions, _, joints = motion
    bent = np.abs(np.diff(joints, axis=0)).sum(axis=(1, 2))
    moved = bent + np.linalg.norm(np.diff(positions, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(moved)])
    distances = np.linspace(0.0, length[-1], FRAMES_PER_ACTION + 1)[1:]
    samples: IntArray = np.searchsorted(length, distances - 1e-9).clip(0, len(length) - 1)
    samples[-1] = len(length) - 1
    return samples


def _configurations_at(motion: Motion, samples: IntArray) -> list[Configuration]:
    """Return the configurations of a motion at some samples."""
    positions, quaternions, joints = motion
    return [(positions[k], quaternions[k], joints[k]) for k in samples]
