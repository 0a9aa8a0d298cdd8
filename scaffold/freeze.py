"""Freeze what the program does, and compare: scaffolding for moving code, not a test.

    python scaffold/freeze.py scaffold/frozen.npz            write the answers of this tree
    python scaffold/freeze.py scaffold/frozen.npz --compare  compare this tree with them
    ... --parts plans,steps                                  only some of the parts

The frozen file is not kept: it is made anew from the commit that brought this script, before
anything moved. Discrete answers must be equal, numbers equal within 1e-9. Long discrete arrays are
kept as hashes.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import time
from pathlib import Path

import gymnasium
import numpy as np

os.environ.setdefault("MLIVR_GYM_CACHE", "")

from api import (
    Box,
    Planner,
    Settings,
    fill_rows,
    plan_trajectory,
    random_state,
    sample_task,
    stance_graph,
    step_tables,
    step_way,
)  # fmt: skip

HASHED = 20_000
BOX = Box("crate", "obstacle", (4.6, -0.55, 0.1), (0.15, 0.2, 0.3))


def edges():
    """All edge entries of the JEM, with and without collisions, with a box, points occupied."""
    for name, collisions in (("plain", False), ("checked", True)):
        graph = stance_graph(settings=Settings(collisions=collisions))
        fill_rows(graph)
        yield from tables(f"{name}", graph)
        if not collisions:
            continue
        rng = np.random.default_rng(5)
        t = step_tables(graph)
        ways = []
        for s in rng.integers(len(graph), size=400):
            for moving in range(2):
                begin, end = t.start[2 * s + moving], t.start[2 * s + moving + 1]
                for e in range(begin, end, 7):
                    ways.append(
                        step_way(
                            graph,
                            t,
                            int(s),
                            int(t.after[e]),
                            moving,
                            int((t.kept if hasattr(t, "kept") else t.left)[e]),
                        )
                    )
        yield "checked/ways", np.array(ways, dtype=np.int64)
        graph.occupy(range(100, 130))
        yield from tables("occupied", graph)
        graph.vacate()
        graph.add_obstacles([BOX])
        yield from tables("box", graph)


def tables(name, graph):
    t = step_tables(graph)
    names = {"land": "releasable", "left": "kept"}
    for field in ("points", "masks", "land", "start", "after", "left"):
        now = field if hasattr(t, field) else names[field]
        yield f"{name}/{field}", np.asarray(getattr(t, now), dtype=np.int64)
    base = t.base_in_world if hasattr(t, "base_in_world") else t.position
    yield f"{name}/position", base[::50]
    yield f"{name}/w_b", graph.w_b[::50]
    yield f"{name}/w_m", graph.w_m[::50]
    yield f"{name}/branch", np.asarray(graph.branch, dtype=np.int64)
    yield f"{name}/max_step", np.array([graph.max_step])


def many_limbs():
    """Sampled steps of three and four limbs, without and with collisions, and plans of theirs."""
    for robot in ("mlivr3", "mlivr4"):
        for collisions in (False, True):
            graph, rng = (
                stance_graph(robot=robot, settings=Settings(collisions=collisions)),
                np.random.default_rng(7),
            )
            rows, numbers = [], []
            for _ in range(3 if collisions else 8):
                state = random_state(graph, rng)
                for _ in range(3):
                    steps = graph.successors(state)
                    rows.append(np.array([*state.stance, *state.masks, len(steps.limb)]))
                    rows.append(np.column_stack([steps.limb, steps.point, steps.masks]).ravel())
                    base = (
                        steps.base_in_world if hasattr(steps, "base_in_world") else steps.position
                    )
                    numbers.append(base.ravel())
                    if not len(steps.limb):
                        break
                    k = int(rng.integers(len(steps.limb)))
                    stance = list(state.stance)
                    stance[steps.limb[k]] = int(steps.point[k])
                    state = state._replace(
                        stance=tuple(stance), masks=tuple(steps.masks[k].tolist()), pose=None
                    )
            yield f"{robot}/{collisions}/steps", np.concatenate(rows).astype(np.int64)
            yield f"{robot}/{collisions}/position", np.concatenate(numbers)
        graph, rng = (
            stance_graph(robot=robot, settings=Settings(collisions=False)),
            np.random.default_rng(8),
        )
        planner = Planner(graph)
        for k in range(3):
            start, goal = sample_task(graph, rng, 0.2)
            yield from plan_of(
                f"{robot}/plan{k}",
                planner.plan(start.stance, goal, ("base", "steps")[k % 2], limit=150),
            )


def plan_of(name, result):
    """What a plan says, but for times."""
    yield (
        f"{name}/reason",
        np.array([hash_of(result.reason.encode()), result.expanded, result.generated]),
    )
    if result.plan is None:
        return
    data = result.plan.to_dict()
    _, world, motion, statistics = (
        data.get(g, data) for g in ("query", "world", "motion", "statistics")
    )
    ids = repr((motion["stances"], [s["limb"] for s in motion["steps"]]))
    kinds = repr(
        [
            (s["path"], s["swing"], s["swing"] == "sampled" or len(s["knots"]))
            for s in motion["steps"]
        ]
    )
    world = repr((world["map_fingerprint"], sorted(world["settings"].items())))
    yield f"{name}/discrete", np.array([hash_of(text.encode()) for text in (ids, kinds, world)])
    yield f"{name}/branches", np.array(motion["branches"], dtype=np.int64)
    for field in ("base_positions", "base_quaternions", "joint_positions", "w_m", "w_b"):
        yield f"{name}/{field}", np.array(motion[field], dtype=np.float64)
    knots = [np.ravel(_knots(s)) for s in motion["steps"]] + [
        np.ravel(s["pivot"]) for s in motion["steps"]
    ]
    yield (
        f"{name}/knots",
        np.concatenate([*knots, [data.get("cost", statistics.get("cost"))]]).astype(np.float64),
    )


def _knots(step):
    """Knots of a swing; of a sampled one, which amplifies the last digit, its ends alone."""
    return step["knots"] if step["swing"] != "sampled" else [step["knots"][0], step["knots"][-1]]


def plans():
    """300 plans: a hundred pairs, three costs; and ten trajectories."""
    graph, rng = stance_graph(), np.random.default_rng(11)
    planner, walks = Planner(graph), []
    for k in range(100):
        start, goal = sample_task(graph, rng, 0.2)
        if k % 2:
            places = getattr(graph, "base_in_world", None)
            places = graph.position if places is None else places
            goal = places[int(rng.integers(len(graph)))]
        for cost, price in (("base", None), ("steps", None), ("weighted", 0.1)):
            result = planner.plan(start.stance, goal, cost, regrasp_price=price)
            yield from plan_of(f"plans/{k}/{cost}", result)
            if (
                result.plan is not None
                and cost == "steps"
                and 1 <= len(result.plan.stances) - 1 <= 6
                and len(walks) < 10
            ):
                walks.append((k, result.plan))
    for method, heuristic in (
        ("dijkstra", None),
        ("greedy", None),
        ("astar", "paper"),
        ("algorithm1", None),
    ):
        result = planner.plan(
            ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps", method=method, heuristic=heuristic
        )
        yield from plan_of(f"methods/{method}", result)
    for k, plan in walks:
        moved = plan_trajectory(graph, plan, period=0.25)
        for field in (
            "times",
            "base_positions",
            "base_quaternions",
            "joint_positions",
            "joint_velocities",
        ):
            yield f"trajectories/{k}/{field}", getattr(moved, field)


def environments():
    """10,000 seeded steps: single, shaped, unreliable, three limbs, in MuJoCo, as a vector."""
    kinds = {
        "plain": (3000, {}),
        "shaped": (
            1500,
            {"reward": "base", "shaping": True, "success_bonus": 2.0, "collisions": False},
        ),
        "unreliable": (1000, {"grasp_failure": 0.2, "collisions": False}),
        "three": (40, {"robot": "mlivr3", "collisions": False}),
        "mujoco": (6, {"dynamics": "mujoco", "collisions": False, "step_duration": 20.0}),
    }
    for name, (count, options) in kinds.items():
        env = gymnasium.make("MLIVR-JEM-v0", **options).unwrapped
        yield from walk(f"env/{name}", env, count)
        env.close()
    vector = gymnasium.make_vec(
        "MLIVR-JEM-v0",
        num_envs=64,
        collisions=False,
        grasp_failure=0.1,
        reward="base",
        shaping=True,
    )
    rng, rows, numbers = np.random.default_rng(3), [], []
    observation, info = vector.reset(seed=9)
    for _ in range(70):
        actions = np.array([rng.choice(np.flatnonzero(mask)) for mask in info["action_mask"]])
        observation, reward, terminated, truncated, info = vector.step(actions)
        rows += [
            info["action_mask"].ravel(),
            terminated,
            truncated,
            info["grasp_failed"],
            info["steps"],
        ]
        rows += [observation["stance"].ravel(), observation["branches"].ravel()]
        numbers += [
            reward,
            info["base_translation"],
            observation["goal"].ravel(),
            info["limb_manipulability"].ravel(),
        ]
    yield "vector/discrete", np.concatenate([np.ravel(row).astype(np.int64) for row in rows])
    yield "vector/numbers", np.concatenate(numbers).astype(np.float64)


def walk(name, env, count):
    rng, rows, numbers, fresh = np.random.default_rng(4), [], [], True
    for k in range(count):
        if fresh:
            observation, info = env.reset(seed=k)
            steps, mask = 0, info["action_mask"]
        action = (
            int(rng.choice(np.flatnonzero(mask)))
            if rng.random() < 0.9
            else int(rng.integers(len(mask)))
        )
        observation, reward, terminated, truncated, info = env.step(action)
        mask, steps = info["action_mask"], steps + 1
        rows += [
            [
                action,
                terminated,
                truncated,
                info["is_success"],
                info["invalid_action"],
                info["grasp_failed"],
            ]
        ]
        rows += [np.flatnonzero(mask), observation["stance"], observation["branches"]]
        numbers += [
            [
                reward,
                info["base_translation"],
                info["base_manipulability"],
                info.get("base_error", 0.0),
            ]
        ]
        numbers += [
            observation[key] for key in ("grasps", "base_position", "base_quaternion", "goal")
        ]
        fresh = terminated or truncated or steps >= 20 or not mask.any()
    yield f"{name}/discrete", np.concatenate([np.ravel(row).astype(np.int64) for row in rows])
    yield f"{name}/numbers", np.concatenate([np.ravel(row).astype(np.float64) for row in numbers])


def hash_of(data):
    return int.from_bytes(hashlib.sha256(data).digest()[:7], "big")


PARTS = {"plans": plans, "environments": environments, "many_limbs": many_limbs, "edges": edges}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--parts", default=",".join(PARTS))
    args = parser.parse_args()
    found = {}
    for part in args.parts.split(","):
        began = time.perf_counter()
        for name, array in PARTS[part]():
            array = np.asarray(array)
            if array.dtype.kind in "iub" and array.size > HASHED // 20:
                array = np.array([array.size, hash_of(array.astype("<i8").tobytes())])
            found[f"{part}:{name}"] = array
        print(f"{part}: {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
    if not args.compare:
        np.savez_compressed(args.file, **found)
        return 0
    wrong, largest = 0, 0.0
    with np.load(args.file) as frozen:
        kept = {
            name: frozen[name]
            for name in frozen.files
            if name.split(":")[0] in args.parts.split(",")
        }
    for name in sorted(set(kept) | set(found)):
        a, b = kept.get(name), found.get(name)
        if a is None or b is None or a.shape != b.shape:
            print(
                f"{name}: {None if a is None else a.shape} before, "
                f"{None if b is None else b.shape} now"
            )
            wrong += 1
        elif a.dtype.kind in "iub":
            if not np.array_equal(a, b):
                print(f"{name}: {a.tolist()[:8]} before, {b.tolist()[:8]} now")
                wrong += 1
        elif a.size:
            off = float(np.nanmax(np.abs(a - b), initial=0.0))
            largest = max(largest, off)
            if off > 1e-9 or not np.array_equal(np.isnan(a), np.isnan(b)):
                print(f"{name}: numbers differ by {off:.3g}")
                wrong += 1
    print(f"{len(kept)} entries, {wrong} differ; numbers differ by at most {largest:.2g}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
