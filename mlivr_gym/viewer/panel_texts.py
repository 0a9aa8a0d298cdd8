"""Texts of the panel, in Markdown."""

from __future__ import annotations

from mlivr_gym.viewer.live_plan import LivePlan
from mlivr_gym.viewer.marks import Marks


def summary(live: LivePlan, cause: str | None = None) -> str:
    """Summarise a plan, or say why none exists; the cause is None while it is searched for."""
    x, y, z = live.query.goal
    query = f"{' '.join(live.query.start)} → ({x:.2f}, {y:.2f}, {z:.2f}), {live.query.cost} cost"
    seconds = live.seconds
    time = f"{1e3 * seconds:.0f} ms" if seconds < 1.0 else f"{seconds:.1f} s"
    spent = f"{live.expanded} states expanded, {time}"
    if live.plan is None:
        explanation = "*searching for the cause ...*" if cause is None else cause
        return f"**No plan:** {live.message}.\n\n{explanation}\n\n{query}  \n{spent}"
    plan = live.plan
    lines = [
        f"**{len(plan.steps)} steps, {plan.base_translation:.3f} m**",
        f"minimum manipulability {plan.w_m_min:.3f} (limbs), {plan.w_b_min:.5f} (base)",
        spent,
        query,
    ]
    if live.previous is not None:
        steps, length = len(live.previous.steps), live.previous.base_translation
        lines.append(f"previous plan: {steps} steps, {length:.3f} m (pale)")
    return "  \n".join(lines)


def legend_text(marks: Marks) -> str:
    """Return the legend of the colours of points."""
    return "  \n".join(
        f'<span style="color:{colour}">⬤</span> {text}' for colour, text in marks.legend
    )
