"""Freeze the best plans known of the benchmark's tasks whose optima are not known.

It takes some minutes, and is run when the graph rules change; entries made before are then refused.
"""

import argparse
import json

import gymnasium

from mlivr_gym.planners import Planner, SearchOptions

ENVIRONMENTS, TASKS = ("MLIVR4-JEM-Anywhere-v0",), 200

EFFORT = 300_000
"""Effort of the search for each plan, the same on every machine; doubled until there is one."""


def best_plan(env):
    """Cost of the best plan found, and the factor of the minimum within which it is proved."""
    effort, found = EFFORT, None
    while not found:
        options = SearchOptions(effort=effort)
        found = Planner(env.graph).plan(
            env.state, env.goal, env.reward.cost, goal_tolerance=env.goal_tolerance, options=options
        )
        effort *= 2
    statistics = found.unwrap().statistics
    return statistics.cost, statistics.bound


def main():
    """Plan all tasks, and write what is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", default="mlivr_gym/extensions/benchmark/references.json")
    args, known = parser.parse_args(), {}
    for name in ENVIRONMENTS:
        env, known[name] = gymnasium.make(f"mlivr_gym:{name}").unwrapped, []
        for task in range(TASKS):
            env.reset(options={"task": task})
            known[name].append(best_plan(env))
            print(f"{name}: {task + 1} of {TASKS}", end="\r", flush=True)
    with open(args.out, "w", encoding="utf-8") as file:
        json.dump(known, file)


if __name__ == "__main__":
    main()
