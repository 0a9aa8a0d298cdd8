"""Data files with their sources: module and robot figures, maps."""

from __future__ import annotations

from pathlib import Path

if __name__ == "envs_assets":
    raise ImportError("import mlivr_gym.envs_assets: the bare folder is not a package of its own")


def asset_path(name: str) -> Path:
    """Path of a data file that ships with the package."""
    return Path(__file__).parent / name
