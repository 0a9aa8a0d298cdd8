"""Carrying plans out in MuJoCo."""
