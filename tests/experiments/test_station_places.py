"""The files of places, modules and the station's robot are what their scripts make."""

import json

import pytest
import station_modules
import station_places

from mlivr_gym.envs_assets import asset_path

FILES = station_places.FILES | station_modules.FILES


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_ships_is_what_the_script_makes(name):
    text = asset_path(f"{name}.json").read_text(encoding="utf-8")
    assert json.loads(text) == json.loads(json.dumps(FILES[name]()))
