"""Colours of the limbs, in the scene and in figures."""

LIMB_COLOURS = (
    "#d62728",
    "#1f5fd0",
    "#ff9f1c",
    "#17a2a2",
    "#9467bd",
    "#8c564b",
    "#e377c2",
    "#7f7f7f",
)
"""Colour of each limb; red and blue are the paper's."""
