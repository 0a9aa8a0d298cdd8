"""Stance graphs and the steps that leave a state."""
