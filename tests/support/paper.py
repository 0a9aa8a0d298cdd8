"""The planning world as the paper has it."""

from mlivr_gym import Settings

NO_COLLISIONS = Settings(collisions=False)
