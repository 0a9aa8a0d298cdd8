"""Page of `dynamic_simulation.py`, its texts in the docs, and the figure of the limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from reports import counted, table

from mlivr_gym.pictures import save_figure
from mlivr_gym.simulation import Limits

CONTROLLERS = {"full": "guided", "feedforward": "feedforward", "paper": "the paper's PD"}
PACES = {"fast": "fast", "quintic": "fast, quintics", "gentle": "gentle", "paper": "50 s"}
"""Names of controllers and paces in tables."""

CLOCKS = {"fastest": "fastest", "quintic": "quintic"}
"""Time scalings that are compared."""

LIMITS = {
    "grasp_force": "grasp force [N]",
    "grasp_torque": "grasp torque [N m]",
    "torque": "share of joint torque",
    "all_limits": "share of all three",
}
"""Limits that are varied."""

WALKS = (
    "controller | pace | s a step | outcome | grasp force [N] | grasp torque [N m] | "
    "joint torque [N m] | torque RMS, peak (mean) [N m] | base error [mm] | capture [mm]"
)
"""Head of the table."""


def walk_row(row: dict[str, Any]) -> list[str]:
    """Return the table row of Case 3 with a controller at a pace."""
    failure, times = row["failure"], row["step_times_s"]
    captured = f"{row['largest_capture_distance_mm']:.2f}" if row["steps_done"] else "-"
    return [
        CONTROLLERS[row["controller"]],
        PACES[row["pace"]],
        f"{sum(times) / len(times):.1f}" if times else "-",
        "done" if row["success"] else f"{failure['kind']} in step {failure['step'] + 1}",
        f"{row['peak_grasp_force_N']:.1f}",
        f"{row['peak_grasp_torque_N_m']:.1f}",
        f"{max(row['peak_joint_torque_N_m']):.2f}",
        f"{row['peak_torque_rms_N_m']:.2f} ({row['mean_torque_rms_N_m']:.2f})",
        f"{row['largest_base_error_mm']:.2f}",
        captured,
    ]


def plan_lines(name: str, row: dict[str, Any]) -> str:
    """Return the paragraph on the random plans at a pace."""
    mean, median, most = row["seconds_a_step"]
    failures = "".join(
        f"  * plan {failure['plan']}, step {failure['step'] + 1}, {failure['phase']}: "
        f"{failure['message']}.\n"
        for failure in row["failures"]
    )
    return f"""* {PACES[name]}: {row["succeeded"]} of {row["plans"]} plans ({row["steps"]} steps) \
carried out, {mean:.1f} s a step (median {median:.1f}, longest {most:.1f}); largest base error \
{row["largest_base_error_mm"]:.1f} mm, capture distance \
{row["largest_capture_distance_mm"]:.2f} mm, grasp force {row["peak_grasp_force_N"]:.1f} N, grasp \
torque {row["peak_grasp_torque_N_m"]:.1f} N m.
{failures}"""


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    fixed, pace, speed = data["shortest_fixed"], data["pace"], data["overhead"]
    fronts = [
        [words, ", ".join(f"{value:g}: {mean:.2f}" for value, mean in pace["fronts"][name])]
        for name, words in LIMITS.items()
    ]
    scalings = [
        [title, f"{pace[name]['seconds_a_step']:.2f}",
         counted(pace[name]["deciding"]).replace("_", " ")]
        for name, title in CLOCKS.items()
    ]  # fmt: skip
    return f"""# Dynamic simulation

Made by `experiments/dynamic_simulation.py`. Case 3 of Table I with collisions checked, zero \
gravity, control at 500 Hz, rotors of
0.1 kg m^2. *Fast*: as the default limits allow (80 % of the joints' torque and speed, 60 N and \
30 N m on a grasp, 0.2 m/s near a
surface); *gentle*: 40 %, 25 N, 12 N m, 0.1 m/s; *paper*: 10, 30 and 10 s. *Guided*: the \
controller `full`. Values are peaks over
all time steps; a walk that fails is measured up to the failure.

{table(WALKS, map(walk_row, data["walks"]))}
If all steps take the same time, the slowest one needs \
{fixed["as_limits_need_s"]:.1f} s if this time is divided as its path segments require, and
{fixed["as_the_paper_s"]:.1f} s if it is divided as in the paper.

## Random plans

{"".join(plan_lines(*item) for item in data["random_plans"].items())}
## Shortest steps within the limits

Computed for the {pace["steps"]} steps of the random plans. One limit binds in each path segment; \
*segments* counts them at the
default limits.

{table("time scaling | s a step | segments by binding limit", scalings)}
One limit varied, the others at their defaults (`pace.png`):

{table("limit | s a step at each value", fronts)}
## Speed

{speed["steps_a_second"]:.1f} steps per second at the default pace, on one core: \
{speed["preparation_ms"]:.0f} ms to compute time scaling and trajectory of a step,
{
        speed[
            "time_step_us"
        ]:.0f} us per time step with control and measurements, of which `mj_step` takes \
{speed["bare_step_us"]:.0f} us. {data["machine"]}.
"""


def readme_text(data: dict[str, Any]) -> str:
    """Return the paragraph of the docs on the simulation."""
    walks = {(row["controller"], row["pace"]): row for row in data["walks"]}
    fast, gentle = (data["random_plans"][name] for name in ("fast", "gentle"))
    paper, pace = walks["paper", "paper"], data["pace"]
    plain = pace["quintic"]["seconds_a_step"]
    ended = walk_row(paper)[3]
    deciding = pace["fastest"]["deciding"]
    first = max(set(deciding) - {"surface_speed"}, key=lambda name: deciding[name])
    return f"""Of {fast["plans"]} random plans ({fast["steps"]} steps) {fast["succeeded"]} are \
carried out at {fast["seconds_a_step"][0]:.1f} s a step (the paper: 50 s), with at most
{fast["peak_grasp_force_N"]:.0f} N and {fast["peak_grasp_torque_N_m"]:.0f} N m on a grasp and a \
base error of at most {fast["largest_base_error_mm"]:.0f} mm; at the gentle pace \
{gentle["succeeded"]} at {gentle["seconds_a_step"][0]:.1f} s.
The limits of {Limits().grasp_force:g} N and {Limits().grasp_torque:g} N m hold for the \
planned motion; \
tracking errors and the capture of a point add to its loads.
Quintic instead of time-optimal time scaling would take {plain:.1f} s a step. \
In swings the {first.replace("_", " ")} is most often the binding limit.
Case 3 with the paper's controller at 50 s a step \
{"is carried out" if ended == "done" else f"ends with a {ended}"}; the largest base error is \
{paper["largest_base_error_mm"]:.0f} mm. \
{data["overhead"]["steps_a_second"]:.1f} steps per second are
simulated on one core, including trajectory, control and measurements.
"""


def readme_sentence(data: dict[str, Any], disturbed: dict[str, Any]) -> str:
    """Return the sentence of the README on executed plans, without and with disturbances."""
    fast = data["random_plans"]["fast"]
    walks = disturbed["studies"]["guided, gentle: all"]
    low, high = (f"{100 * share:.0f}" for share in walks["interval"])
    return (
        f"In MuJoCo {fast['succeeded']} of {fast['plans']} random plans are carried out at "
        f"{fast['seconds_a_step'][0]:.1f} s a step (the paper: 50 s), and gently, with all "
        f"disturbances at once, {walks['carried_out']} of {walks['walks']} (95 % confidence "
        f"interval {low} to {high} %) ([simulation](docs/how-to/simulate.md)).\n"
    )


def pace_figure(data: dict[str, Any], path: Path) -> None:
    """Plot the mean duration of a step against each limit."""
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    axes = figure.subplots(1, len(LIMITS), sharey=True)
    for axis, (name, words) in zip(axes, LIMITS.items(), strict=True):
        values, means = zip(*data["pace"]["fronts"][name], strict=True)
        axis.plot(values, means, "o-", color="#1f5fd0")
        axis.set(xlabel=words, xscale="log")
        axis.set_xticks(values, [f"{value:g}" for value in values], fontsize=8)
        axis.set_xticks([], minor=True)
        axis.grid(alpha=0.3)
    axes[0].set_ylim(bottom=0.0)
    axes[0].set_ylabel("mean duration of a step [s]")
    figure.suptitle("How fast limits let a step be; the paper takes 50 s", fontsize=11)
    save_figure(figure, path)
