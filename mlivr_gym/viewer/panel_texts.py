"""What the panel says, in Markdown."""

from __future__ import annotations

from mlivr_gym.motion.plan import Plan
from mlivr_gym.viewer.live_plan import LivePlan
from mlivr_gym.viewer.marks import Marks


def summary(live: LivePlan, cause: str | None = None) -> str:
    """Steps, translation, explored stances and time of a plan, or why there is none.

    The cause is None while it is being looked for.
    """
    x, y, z = live.query.goal
    query = f"{' '.join(live.query.start)} → ({x:.2f}, {y:.2f}, {z:.2f}), {live.query.cost} cost"
    spent = f"{live.expanded} states explored, {_time(live.seconds)}"
    if live.plan is None:
        looked = "*looking for the cause ...*" if cause is None else cause
        return f"**No plan:** {live.message}.\n\n{looked}\n\n{query}  \n{spent}"
    plan = live.plan
    lines = [
        f"**{len(plan.steps)} steps, {plan.base_translation:.3f} m**",
        f"least manipulability {plan.w_m_min:.3f} (limbs), {plan.w_b_min:.5f} (base)",
        spent,
        query,
    ]
    if live.previous is not None:
        before = live.previous
        lines.append(f"before: {len(before.steps)} steps, {before.base_translation:.3f} m (pale)")
    return "  \n".join(lines)


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if seconds < 1.0 else f"{seconds:.1f} s"


def comparison_table(first: Plan | None, second: Plan) -> str:
    """Two plans in a table."""
    names = ("steps", "translation [m]", "least w_m", "least w_b")
    columns = [_figures(plan) if plan else ("none",) * len(names) for plan in (first, second)]
    rows = [f"| {' | '.join(row)} |" for row in zip(names, *columns, strict=True)]
    return "\n".join(["", "", "| | first | second |", "|---|---|---|", *rows])


def _figures(plan: Plan) -> tuple[str, ...]:
    return (
        str(len(plan.steps)),
        f"{plan.base_translation:.3f}",
        f"{plan.w_m_min:.3f}",
        f"{plan.w_b_min:.5f}",
    )


def legend_text(found: Marks) -> str:
    """What the colours of points mean."""
    return "  \n".join(
        f'<span style="color:{colour}">⬤</span> {words}' for colour, words in found.legend
    )
