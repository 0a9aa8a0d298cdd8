"""Planted faults that tests once passed, and others of their kinds: does a test fail today?

    python experiments/known_faults.py [id ...]

Each is planted in a copy of the sources where its place is today, and the tests named beside it
run; those in kernels run their plain definitions first. Writes `results/known_faults.md`; what has
run stays in `results/known_faults.json`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from mutants import RESULTS, ROOT, Tree
from mutation import Mutant

SWEEPS = "tests/collisions/test_sweep_holds.py"
REWARDS, FAILURES = "tests/envs/test_rewards.py", "tests/simulation/test_failures.py"
ENVS, STANCES, CLI = "mlivr_gym/envs", "mlivr_gym/stances", "mlivr_gym/cli"


class Fault(NamedTuple):
    """A fault of the table."""

    id: str
    """Its name there."""
    path: str
    """Source file today."""
    before: str
    """Text that is replaced, which occurs once."""
    after: str
    """What stands there instead."""
    test: str
    """Tests that must fail."""
    missed: bool = True
    """Whether the tests of its module passed with it when it was first planted."""


OLD = [
    Fault("K2b", "mlivr_gym/collisions/sweep.py", "    if here.limbs and motion.meeting:\n",
          "    if here.limbs and motion.meeting and motion.second.kind == SWINGS:\n"
          "        here.limbs = 0\n    elif here.limbs and motion.meeting:\n", SWEEPS),
    Fault("K2", "mlivr_gym/collisions/sweep.py",
          "against_boxes(limb, first.in_world, todo, grid, clearance, room.behind)",
          "against_boxes(limb, first.in_world, todo, grid, "
          "0.0 if motion.first.kind == HOLDS else clearance, room.behind)", SWEEPS),
    Fault("K5", "mlivr_gym/collisions/sweep.py", "    if here.limbs and motion.meeting:\n",
          "    if here.limbs and motion.meeting and motion.second.kind == HOLDS:\n"
          "        here.limbs = 0\n    elif here.limbs and motion.meeting:\n", SWEEPS),
    Fault("K12", "mlivr_gym/collisions/placing.py", "spin[row, 4] + _largest(plus[4], minus[4])",
          "spin[row, 4]", "tests/collisions/test_placing.py"),
    Fault("K1", "mlivr_gym/collisions/sweep.py",
          "against_boxes(limb, first.in_world, todo, grid, clearance, room.behind)",
          "against_boxes(limb, first.in_world, todo, grid, "
          "0.5 * clearance if motion.first.kind == SWINGS else clearance, room.behind)",
          "tests/collisions/test_sweep_swings.py"),
    Fault("P2", f"{ENVS}/env.py", "2.0 * moved", "moved", REWARDS),
    Fault("P2b", f"{ENVS}/batch.py", "2.0 * moved[k]", "moved[k]", REWARDS),
    Fault("P18", "planners/table_values.py", "(1.0 + failure) / (1.0 - failure)",
          "1.0 / (1.0 - failure)", "tests/planners/test_table_values.py"),
    Fault("P3", f"{ENVS}/env.py", "masks=(*after.masks[:limb], grasped, *after.masks[limb + 1 :])",
          "masks=(*self.state.masks[:limb], grasped, *self.state.masks[limb + 1 :])", REWARDS),
    Fault("P4", f"{ENVS}/rewards.py", "self.discount * after", "after", REWARDS),
    Fault("P5", f"{ENVS}/env.py", "self._mask[action]), self.graph.max_step",
          "self._mask[action]), 0.0", REWARDS),
    Fault("P5v", f"{ENVS}/batch.py", "moved[k], outcome[k] = max_step, 1",
          "moved[k], outcome[k] = 0.0, 1", REWARDS),
    Fault("P43", f"{ENVS}/batch.py", "if kept_on_edge(of_held, kept[e]):", "if kept[e]:",
          "tests/envs/test_tasks.py"),
    Fault("P42", f"{ENVS}/batch.py", "inside and away > tolerance * tolerance", "inside",
          "tests/envs/test_tasks.py"),
    Fault("P30", f"{STANCES}/stance_sets.py", " + graph.robot.fingerprint.encode()", "",
          "tests/stances/test_step_tables.py"),
    Fault("P31", "planners/lower_bounds.py", "kept.occupied <= occupied and kept.exact",
          "kept.exact", "tests/planners/test_lower_bounds.py"),
    Fault("P12", "agents/evaluation.py", "    return _Episode(\n        success,",
          "    return _Episode(\n        True,", "tests/agents/test_evaluation.py"),
    Fault("P13", "agents/imitation.py", "legal & (costs <= least[:, None] + 1e-6)",
          "legal & (np.arange(costs.shape[1]) == costs.argmin(axis=1)[:, None])",
          "tests/agents/test_imitation.py"),
    Fault("P13b", "agents/imitation.py", "least[:, None] + 1e-6", "least[:, None] + 1.0",
          "tests/agents/test_imitation.py"),
    Fault("P14", "agents/imitation.py", "optimal if expert else self._chosen(here)", "optimal",
          "tests/agents/test_imitation.py"),
    Fault("P15", "agents/imitation.py", "(value + cost)", "(value - cost)",
          "tests/agents/test_imitation.py"),
    Fault("P16", "agents/features.py", "looks[:, :, 6], looks[:, :, 7] = points.free, points.risk",
          "pass", "tests/agents/test_features.py"),
    Fault("P17", f"{STANCES}/moves.py", "held = 1 - steps.limb", "held = steps.limb",
          "tests/agents/test_features.py"),
    Fault("P33", "agents/sb3_env.py", "bool(truncated[k] and not terminated[k])", "False",
          "tests/agents/test_sb3_env.py"),
    Fault("P34", "agents/learned.py", "        if self.memory:", "        if False:",
          "tests/agents/test_learned.py"),
    Fault("P37", "planners/baselines.py", "                seen.add(after.stance)\n"
          "                break", "                break", "tests/planners/test_baselines.py"),
    Fault("P38", "planners/baselines.py", "c.total / c.visits + math", "-c.total / c.visits + math",
          "tests/planners/test_baselines.py"),
    Fault("P20", "mlivr_gym/simulation/feedforward.py",
          "wrench = np.linalg.pinv(stacked[:, :, :6].swapaxes(1, 2)) @ forces[:, :6, None]",
          "wrench = np.zeros((count, stacked.shape[1], 1))\n"
          "    wrench[:, :6] = np.linalg.pinv(stacked[:, :6, :6].swapaxes(1, 2)) "
          "@ forces[:, :6, None]", "tests/simulation"),
    Fault("P23", "mlivr_gym/simulation/dynamics.py", "capture_distance: float = 0.01",
          "capture_distance: float = 0.05", "tests/simulation"),
    Fault("P24", "mlivr_gym/simulation/simulator.py",
          "distance <= self.physics.capture_distance and angle <= self.physics.capture_angle",
          "distance <= self.physics.capture_distance", "tests/simulation"),
    Fault("P25", "mlivr_gym/simulation/failures.py",
          "np.maximum(\n            self.limits[:, 0] - measured.joints, "
          "measured.joints - self.limits[:, 1]\n        )",
          "measured.joints - self.limits[:, 1]", FAILURES),
    Fault("P26", "mlivr_gym/simulation/failures.py",
          '("torque", "N m", measured.grasp_torques, self.physics.hold_torque),', "", FAILURES),
    Fault("P29", "mlivr_gym/simulation/physical_walk.py",
          "np.fmax(limits[:, 0] - held, held - limits[:, 1])", "held - limits[:, 1]",
          "tests/simulation"),
    Fault("P36", "mlivr_gym/world/boxes.py", '"rotation": [list(row) for row in self.rotation]',
          '"rotation": [list(row) for row in zip(*self.rotation)]', "tests/world/test_boxes.py"),
    Fault("P8", "mlivr_gym/motion/plan_files.py", '_texts(data["occupied"], "occupied")', "()",
          "tests/motion/test_plan_files.py"),
    Fault("P9", "mlivr_gym/files.py", "        os.replace(name, target)",
          "        Path(name).unlink()\n        target.write_bytes(content.encode() "
          "if isinstance(content, str) else content)", "tests/test_files.py"),
    Fault("P11", f"{CLI}/arguments.py", "occupied = list(args.occupied)", "occupied = []",
          "tests/cli/test_plan.py"),
    Fault("P11b", f"{CLI}/arguments.py", "for k, box in enumerate(args.box)",
          "for k, box in enumerate([])", "tests/cli/test_plan.py"),
    Fault("P50", f"{CLI}/evaluate.py", "w.map()}, w.tasks)", "w.map()}, w.tasks[:1])",
          "tests/agents/test_commands.py"),
    Fault("P51", f"{CLI}/table1.py", "return FAILED if failed else SUCCESS", "return SUCCESS",
          "tests/cli/test_table1.py"),
    Fault("P28", f"{STANCES}/stance_graph.py", "distance >= robot.grasp_separation - 1e-9",
          "distance > robot.grasp_separation + 1e-9", "tests/stances/test_stance_graph.py"),
    Fault("P54", "planners/query.py", "1.0 if tables or plain else 2.0",
          "1.0 if tables or plain else 5.0", "tests/planners/test_query.py"),
]  # fmt: skip
"""Faults that passed every test of version 0.1.0."""

NEW = [
    Fault("S1", "mlivr_gym/kinematics/certificate.py",
          "abs(arm.d5) * (a + b1) / s5_min\n", "abs(arm.d5) * (a + b1)\n",
          "tests/kinematics/test_certificate.py"),
    Fault("S2", "mlivr_gym/collisions/against_boxes.py", "dot((abs(u), abs(v), abs(w)), ",
          "dot((abs(u), abs(v), w), ", "tests/collisions/test_against_boxes.py"),
    Fault("S3", "mlivr_gym/simulation/grippers.py", "ahead + reach", "ahead - reach",
          "tests/simulation/test_grippers.py"),
    Fault("S4", "agents/learned.py", "            self._visited.clear()", "            pass",
          "tests/agents/test_learned.py"),
    Fault("S5", f"{CLI}/plan.py", "plan.base_translation / before",
          "before / plan.base_translation", "tests/cli/test_plan.py"),
    Fault("S6", "mlivr_gym/robot/limb.py", "np.minimum(start + 2.0 * np.pi, high)",
          "start + 2.0 * np.pi", "tests/robot/test_limb.py"),
    Fault("T1", "mlivr_gym/kinematics/turns.py", "abs(arm.d5) * b4", "abs(arm.d5) * b1",
          "tests/kinematics/test_turns.py"),
    Fault("T2", "mlivr_gym/kinematics/base_path.py", "path.sweep * (2.0 * abs(",
          "path.sweep * (abs(", "tests/kinematics/test_base_path.py"),
    Fault("T3", "mlivr_gym/kinematics/holding.py", "max(track.farthest, abs(q - last))",
          "abs(q - last)", "tests/kinematics/test_holding.py"),
    Fault("T4", "mlivr_gym/collisions/contacts.py", " + max(0.0, clearance)\n", "\n",
          "tests/collisions/test_contacts.py", missed=False),
    Fault("T5", "mlivr_gym/collisions/contacts.py", "np.array(box.rotation).T @ normal",
          "np.array(box.rotation) @ normal", "tests/collisions/test_contacts.py"),
    Fault("T6", "mlivr_gym/collisions/distances.py", "inner + more + max(at_p, at_u)",
          "inner + more + at_u", "tests/collisions/test_distances.py"),
    Fault("T7", "mlivr_gym/postures/in_reach.py", "(d4 + d6 * c5) ** 2", "(d4 - d6 * c5) ** 2",
          "tests/postures/test_in_reach.py"),
    Fault("T8", "mlivr_gym/postures/in_reach.py", "> query.tolerance + highest:",
          "> query.tolerance:", "tests/postures/test_in_reach.py", missed=False),
    Fault("T9", "mlivr_gym/transitions/relaxed_steps.py", "new = has_branch(alone_i, b) or",
          "new = has_branch(alone_i, b) and", "tests/transitions/test_relaxed_steps.py",
          missed=False),
    Fault("T10", "mlivr_gym/motion/commitment.py", "limb].min(axis=0)", "limb].max(axis=0)",
          "tests/motion/test_commitment.py"),
    Fault("T11", "mlivr_gym/motion/trajectory.py",
          "np.unique(np.append(np.arange(0, len(self.times), stride), len(self.times) - 1))",
          "np.arange(0, len(self.times), stride)", "tests/motion/test_trajectory.py"),
    Fault("T12", "mlivr_gym/motion/runs.py", "self.corners[:, 0] / self.corners[:, 1]",
          "self.corners[:, 1] / self.corners[:, 0]", "tests/motion/test_runs.py", missed=False),
    Fault("T13", "mlivr_gym/simulation/monte_carlo.py", "z2 / (4 * count**2)", "z2 / (4 * count)",
          "tests/simulation/test_disturbances.py", missed=False),
    Fault("T14", "mlivr_gym/simulation/failures.py", "index + before, index - start",
          "index, index - start", FAILURES, missed=False),
    Fault("T15", "mlivr_gym/simulation/guidance.py", "float(np.abs(change).max())",
          "float(change.max())",
          "tests/simulation/test_disturbances.py tests/simulation/test_guidance.py"),
    Fault("T16", f"{ENVS}/vector_env.py", "np.where(invalid, 0.0, moved)", "moved",
          "tests/envs/test_vector_env.py", missed=False),
    Fault("T17", "planners/baselines.py", "np.clip(along, 0.0, length)",
          "np.clip(along, -length, length)", "tests/planners/test_baselines.py"),
    Fault("T18", "agents/evaluation.py", "first = first or now - began", "first = now - began",
          "tests/agents/test_evaluation.py"),
    Fault("T19", "agents/policies.py", " or env.steps == 0:", ":", "tests/agents/test_policies.py"),
    Fault("T20", f"{CLI}/evaluate.py", "[result.steps for result in results])[success]",
          "[result.steps for result in results])", "tests/agents/test_commands.py", missed=False),
    Fault("T21", f"{CLI}/info.py", ".sum() - 2 * len(graph))", ".sum() - len(graph))",
          "tests/cli/test_info.py"),
    Fault("T22", "mlivr_gym/pictures/walk_figure.py", "base_paths(self.plan)[self.taken :]",
          "base_paths(self.plan)[self.taken + 1 :]", "tests/pictures/test_walk_figure.py"),
    Fault("T23", "mlivr_gym/viewer/curves.py", "plan.motion.w_b[: len(first)] / w_b_min",
          "plan.motion.w_b[: len(first)] / w_m_min", "tests/viewer/test_curves.py", missed=False),
    Fault("T24", "mlivr_gym/world/map_entries.py", "np.abs(frames[:, :, 1])", "frames[:, :, 1]",
          "tests/world/test_map_entries.py", missed=False),
]  # fmt: skip
"""Faults planted since: bounds, long runs and ends of ranges, what is printed, far tests."""


def planted(fault: Fault) -> Mutant:
    """The fault as a mutant.

    Raises:
        SystemExit: If its text does not occur exactly once.
    """
    source = (ROOT / fault.path).read_text(encoding="utf-8")
    if source.count(fault.before) != 1:
        raise SystemExit(f"{fault.id}: {fault.before!r} occurs {source.count(fault.before)} times")
    start = len(source[: source.index(fault.before)].encode())
    stop = start + len(fault.before.encode())
    line = source[: source.index(fault.before)].count("\n") + 1
    before = " ".join(fault.before.split())
    return Mutant(fault.path, "", "known", line, start, stop, before, fault.after, True, 0)


def main() -> None:
    """Run the faults, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("ids", nargs="*", help="by default those that have not run as they are")
    parser.add_argument(
        "--folder", type=Path, default=Path(tempfile.gettempdir()) / "mlivr-gym-mutants"
    )
    args = parser.parse_args()
    file, tree = RESULTS / "known_faults.json", Tree(args.folder)
    results = json.loads(file.read_text()) if file.exists() else {}
    for fault in (*OLD, *NEW):
        digest, known = digest_of(fault), results.get(fault.id)
        if fault.id in args.ids or not (args.ids or (known and known["digest"] == digest)):
            known = {"digest": digest, **tree.run(planted(fault), fault.test.split())}
            results[fault.id] = known
            file.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n")
            print(fault.id, known["caught"], known["by"], known["seconds"], flush=True)
    (RESULTS / "known_faults.md").write_text(report(results))


def digest_of(fault: Fault) -> str:
    """Digest of what is planted where, and of the tests."""
    return hashlib.sha256("\n".join(fault[:5]).encode()).hexdigest()[:12]


def report(results: dict[str, Any]) -> str:
    """The report, in Markdown."""
    passed = sum(fault.missed for fault in NEW)
    lines = [
        "# Planted faults", "",
        "Each is planted where its place is today by `experiments/known_faults.py`.", "",
        "## Faults that passed every test of version 0.1.0", "",
        "| id | place | test | fails with the fault |", "|---|---|---|---|",
        *(f"| {fault.id} | `{fault.path}` | {outcome(fault, results)} |" for fault in OLD), "",
        "## Faults planted since 0.1.0", "",
        "Bounds that are too loose or too tight, rules that matter in a long run or at the end of "
        "a range, figures that are printed or drawn, and what far tests alone noticed. At first: "
        "with the tests of the module as they were when the fault was planted for the first time; "
        f"{passed} of {len(NEW)} passed.", "",
        "| id | fault | place | at first | test today | fails with the fault |",
        "|---|---|---|---|---|---|",
    ]  # fmt: skip
    for fault in NEW:
        before, after = (" ".join(text.split()) for text in (fault.before, fault.after))
        change = f"`{before}` => {f'`{after}`' if after else 'nothing'}".replace("|", "\\|")
        first = "passed" if fault.missed else "failed"
        told = outcome(fault, results)
        lines.append(f"| {fault.id} | {change} | `{fault.path}` | {first} | {told} |")
    return "\n".join(lines) + "\n"


def outcome(fault: Fault, results: dict[str, Any]) -> str:
    """Two cells: the test that failed, and whether one did."""
    known = results.get(fault.id)
    if not known:
        return f"`{fault.test}` | not run"
    return f"`{known['by'] or fault.test}` | {'yes' if known['caught'] else 'NO'}"


if __name__ == "__main__":
    main()
