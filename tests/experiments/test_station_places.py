"""The files of the places and of the station's robot are what their script makes."""

import json

import pytest
from station_places import FILES

from mlivr_gym.envs_assets import asset_path


@pytest.mark.parametrize("name", ["truss", "uslab", "ssrms2"])
def test_a_file_that_ships_is_what_the_script_makes(name):
    text = asset_path(f"{name}.json").read_text(encoding="utf-8")
    assert json.loads(text) == json.loads(json.dumps(FILES[name]()))
