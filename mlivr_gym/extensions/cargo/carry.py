"""The command `mlivr-gym carry`: pick a bag up, carry it and stow it in MuJoCo."""

from __future__ import annotations

import argparse

from mlivr_gym import stance_graph
from mlivr_gym.cli.arguments import chosen_map, chosen_settings, option, walk_options, world_options
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.progress import Progress
from mlivr_gym.cli.robots import described_robot
from mlivr_gym.errors import SettingError
from mlivr_gym.robot import MOST_LIMBS
from mlivr_gym.schema import Integer


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    walk_options(parser)
    text = "number of the limb that carries (default: the one with the cheapest walks)"
    option(parser, "--limb LIMB", text, valid=Integer(0, MOST_LIMBS - 1))
    option(parser, "--pick POINT", "id of the point on which the bag stands")
    option(parser, "--stow POINT", "id of the point on which it shall stand")


def run(args: argparse.Namespace) -> int:
    """Walk to a bag, pick it up, carry it and stow it, in MuJoCo.

    The bag of --cargo stands on the point --pick and is stowed on the point --stow. One limb
    carries it while the others walk; without --limb it is the one with the cheapest walks.
    """
    from mlivr_gym.extensions.cargo.cargo_mission import plan_cargo_mission
    from mlivr_gym.simulation import PACES as LIMITS

    for name in ("cargo", "start", "pick", "stow"):
        if getattr(args, name) is None:
            raise SettingError(f"--{name} is missing; carry needs --cargo, --start, --pick, --stow")
    limbs = None if args.limb is None else [args.limb]
    with Progress("planning", quiet=args.quiet):
        graph = stance_graph(chosen_map(args), described_robot(args), chosen_settings(args))
        mission = plan_cargo_mission(
            graph, args.start, args.pick, args.stow, args.cargo, args.cost, limbs=limbs
        )
    with Progress("carrying", quiet=args.quiet):
        parts = mission.execute(LIMITS[args.pace])
    print(f"limb {mission.limb} carries; walks of {len(mission.plans[0].steps)} steps to the bag "
          f"and {len(mission.plans[1].steps)} with it")  # fmt: skip
    args.result |= {"limb": mission.limb, "parts": {}}
    for name, part in parts.items():
        time, force = float(part.recording.times[-1]), float(part.peaks.grasp_force.max())
        print(f"{name:8} {time:6.1f} s, at most {force:.0f} N at a grasp")
        args.result["parts"][name] = {"time": time, "peak_force": force}
    failure = parts[list(parts)[-1]].failure
    print("stowed" if failure is None else f"failed: {failure.message}")
    args.result["failure"] = None if failure is None else failure.to_dict()
    args.result["plans"] = [plan.to_dict() for plan in mission.plans]
    args.result["motions"] = [motion.path.knots.tolist() for motion in mission.motions]
    return SUCCESS if failure is None else FAILED
