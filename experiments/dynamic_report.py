"""Tells what `dynamic_simulation.py` measured: page, text of the README, picture of the fronts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from mlivr_gym.pictures.figures import save_figure

CONTROLLERS = {"full": "guided", "feedforward": "feedforward", "paper": "the paper's PD"}
PACES = {"fast": "fast", "quintic": "fast, quintics", "gentle": "gentle", "paper": "50 s"}
"""Names in tables."""

LIMITS = {
    "grasp_force": ("grasp force", "N"),
    "grasp_torque": ("grasp torque", "N m"),
    "torque": ("share of joint torque", ""),
    "all_limits": ("share of all three", ""),
}
"""What is varied, with its unit."""


def markdown(data: dict[str, Any]) -> str:
    """The results as a page."""
    return "\n".join(
        [
            *walk_lines(data),
            *plan_lines(data["random_plans"]),
            *pace_lines(data["pace"]),
            *time_step_lines(data["time_steps"]),
            *speed_lines(data),
        ]
    )


def seconds(row: dict[str, Any]) -> str:
    """The mean duration of the steps that were carried out."""
    times = row["step_times_s"]
    return f"{sum(times) / len(times):.1f}" if times else "-"


def walk_lines(data: dict[str, Any]) -> list[str]:
    """The walk of Case 3 with each controller at each pace."""
    lines = [
        "# Dynamic simulation",
        "",
        "Made by `experiments/dynamic_simulation.py`. Case 3 of Table I with collisions checked, "
        "zero gravity, control at 500 Hz, rotors of",
        "0.1 kg m^2. *Fast*: as the default limits allow (80 % of the joints' torque and speed, "
        "60 N and 30 N m on a grasp, 0.2 m/s near a",
        "surface); *gentle*: 40 %, 25 N, 12 N m, 0.1 m/s; *paper*: 10, 30 and 10 s. *Guided*: the "
        "full controller. Figures are peaks over",
        "every time step; a walk that failed is measured up to the failure.",
        "",
        "| controller | pace | s a step | outcome | grasp force [N] | grasp torque [N m] "
        "| joint torque [N m] | torque RMS, peak (mean) [N m] | base error [mm] | capture [mm] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in data["walks"]:
        failure = row["failure"]
        outcome = "done" if row["success"] else f"{failure['kind']} in step {failure['step'] + 1}"
        captured = "-" if not row["steps_done"] else f"{row['largest_capture_distance_mm']:.2f}"
        at = PACES[row["pace"]]
        lines.append(
            f"| {CONTROLLERS[row['controller']]} | {at} "
            f"| {seconds(row)} | {outcome} | {row['peak_grasp_force_N']:.1f} "
            f"| {row['peak_grasp_torque_N_m']:.1f} | {max(row['peak_joint_torque_N_m']):.2f} "
            f"| {row['peak_torque_rms_N_m']:.2f} ({row['mean_torque_rms_N_m']:.2f}) "
            f"| {row['largest_base_error_mm']:.2f} | {captured} |"
        )
    fixed = data["shortest_fixed"]
    return [
        *lines,
        "",
        "If all steps are to take the same time, the slowest of them needs "
        f"{fixed['as_limits_need_s']:.1f} s where the time is split as its pieces need it, and",
        f"{fixed['as_the_paper_s']:.1f} s where it is split as in the paper.",
    ]


def plan_lines(plans: dict[str, Any]) -> list[str]:
    """The random plans at each pace."""
    lines = ["", "## Random plans", ""]
    for name, row in plans.items():
        mean, median, most = row["seconds_a_step"]
        lines.append(
            f"* {PACES[name]}: {row['succeeded']} of "
            f"{row['plans']} plans ({row['steps']} steps) carried out, {mean:.1f} s a step "
            f"(median {median:.1f}, longest {most:.1f}); largest base error "
            f"{row['largest_base_error_mm']:.1f} mm, capture distance "
            f"{row['largest_capture_distance_mm']:.2f} mm, grasp force "
            f"{row['peak_grasp_force_N']:.1f} N, grasp torque {row['peak_grasp_torque_N_m']:.1f} "
            "N m."
        )
        for failure in row["failures"]:
            lines.append(
                f"  * plan {failure['plan']}, step {failure['step'] + 1}, {failure['phase']}: "
                f"{failure['message']}."
            )
    return lines


def pace_lines(pace: dict[str, Any]) -> list[str]:
    """What limits allow, and which decide."""
    lines = [
        "",
        "## Seconds a step that limits allow",
        "",
        f"Worked out for the {pace['steps']} steps of the random plans. In each piece of a step "
        "one limit decides; *pieces* counts them at the",
        f"default limits. Of the {pace['corners']} corners of their swings {pace['rounded']} are "
        "rounded with the clearance kept; *stopping at corners* is how long the same",
        "steps take with none.",
        "",
        "| clock | s a step | pieces that a limit decides |",
        "|---|---|---|",
    ]
    names = {"fastest": "fastest", "sharp": "fastest, stopping at corners", "quintic": "quintic"}
    for profile, name in names.items():
        row = pace[profile]
        told = ", ".join(
            f"{limit.replace('_', ' ')} {count}" for limit, count in sorted(row["deciding"].items())
        )
        lines.append(f"| {name} | {row['seconds_a_step']:.2f} | {told} |")
    lines += ["", "One limit varied, the others at their defaults (`pace.png`):", ""]
    lines += ["| limit | s a step at each value |", "|---|---|"]
    for name, (told, unit) in LIMITS.items():
        row = ", ".join(f"{value:g}: {mean:.2f}" for value, mean in pace["fronts"][name])
        lines.append(f"| {told}{f' [{unit}]' if unit else ''} | {row} |")
    return lines


def time_step_lines(rows: dict[str, Any]) -> list[str]:
    """The walk with several time steps."""
    lines = [
        "",
        "## Time step",
        "",
        "The walk at the default limits with feedforward, the controller asked at each time step. "
        "*Impulse*: largest difference of the",
        "grasp's impulse and the robot's momentum in the first step, as a share of the largest "
        "momentum; Newton's law wants 0, and the",
        "error of the first-order integrator goes with the time step.",
        "",
        "| time step | torque RMS, peak [N m] | grasp force [N] | base error [mm] | capture [mm] "
        "| impulse [%] |",
        "|---|---|---|---|---|---|",
    ]
    for step, row in rows.items():
        captured = row["largest_capture_distance_mm"]
        lines.append(
            f"| {step} | {row['peak_torque_rms_N_m']:.4f} | {row['peak_grasp_force_N']:.3f} "
            f"| {row['largest_base_error_mm']:.4f} "
            f"| {'-' if captured is None else f'{captured:.4f}'} "
            f"| {100 * row['impulse_error']:.1f} |"
        )
    return lines


def speed_lines(data: dict[str, Any]) -> list[str]:
    """How fast the simulation is."""
    speed = data["overhead"]
    return [
        "",
        "## Speed",
        "",
        f"{speed['steps_a_second']:.1f} steps a second at the default pace, on one core: "
        f"{speed['preparation_ms']:.0f} ms to find the clocks and the trajectory of a step,",
        f"{speed['time_step_us']:.0f} us a time step with control and measurements, of which "
        f"`mj_step` takes {speed['bare_step_us']:.0f} us. {data['machine']}.",
        "",
    ]


def readme_text(data: dict[str, Any]) -> str:
    """What README says of the simulation."""
    walks = {(row["controller"], row["pace"]): row for row in data["walks"]}
    fast, gentle = (data["random_plans"][name] for name in ("fast", "gentle"))
    paper, pace = walks["paper", "paper"], data["pace"]
    plain, sharp = (pace[name]["seconds_a_step"] for name in ("quintic", "sharp"))
    outcome = (
        "is carried out"
        if paper["success"]
        else f"ends in step {paper['failure']['step'] + 1} with a {paper['failure']['kind']}"
    )
    deciding = pace["fastest"]["deciding"]
    swing = {name: count for name, count in deciding.items() if name != "surface_speed"}
    first = max(swing, key=lambda name: swing[name]).replace("_", " ")
    return (
        f"Of {fast['plans']} random plans ({fast['steps']} steps) {fast['succeeded']} are carried "
        f"out at {fast['seconds_a_step'][0]:.1f} s a step (the paper: 50 s), with at most\n"
        f"{fast['peak_grasp_force_N']:.0f} N and {fast['peak_grasp_torque_N_m']:.0f} N m on a "
        f"grasp, the base at most {fast['largest_base_error_mm']:.0f} mm off; at the gentle pace "
        f"{gentle['succeeded']} at {gentle['seconds_a_step'][0]:.1f} s.\n"
        f"Quintics in place of the fastest clocks would take {plain:.1f} s a step; a stop at "
        f"every corner {sharp:.1f} s. In the swing the {first} decides most often.\n"
        "Case 3 with the paper's "
        f"controller at 50 s a step {outcome}; at its worst the base is "
        f"{paper['largest_base_error_mm']:.0f} mm off. "
        f"{data['overhead']['steps_a_second']:.1f} steps a second are\n"
        "simulated on one core, trajectory, control and measurements included.\n"
    )


def in_one_line(data: dict[str, Any], disturbed: dict[str, Any]) -> str:
    """What README says of it, with what disturbances do."""
    fast = data["random_plans"]["fast"]
    walks = disturbed["studies"]["guided, gentle: all"]
    low, high = (f"{100 * share:.0f}" for share in walks["interval"])
    return (
        f"In MuJoCo {fast['succeeded']} of {fast['plans']} random plans are carried out at "
        f"{fast['seconds_a_step'][0]:.1f} s a step (the paper: 50 s), and gently, with all "
        f"disturbances at once, {walks['carried_out']} of {walks['walks']} ({low} to {high} %) "
        "([simulation](docs/how-to/simulate.md)).\n"
    )


def pace_figure(data: dict[str, Any], path: Path) -> None:
    """Seconds a step over each limit."""
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    axes = figure.subplots(1, len(LIMITS), sharey=True)
    for axis, (name, (told, unit)) in zip(axes, LIMITS.items(), strict=True):
        values, means = zip(*data["pace"]["fronts"][name], strict=True)
        axis.plot(values, means, "o-", color="#1f5fd0")
        axis.set_xlabel(f"{told} [{unit}]" if unit else told)
        axis.set_xscale("log")
        axis.set_xticks(values, [f"{value:g}" for value in values], fontsize=8)
        axis.set_xticks([], minor=True)
        axis.grid(alpha=0.3)
    longest = max(mean for name in LIMITS for _, mean in data["pace"]["fronts"][name])
    axes[0].set_ylim(0.0, 1.05 * longest)
    axes[0].set_ylabel("mean duration of a step [s]")
    figure.suptitle("How fast limits let a step be; the paper takes 50 s", fontsize=11)
    save_figure(figure, path)
