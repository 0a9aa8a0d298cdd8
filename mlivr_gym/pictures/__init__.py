"""Figures, rendering and films."""
