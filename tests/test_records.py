"""Each field of each record that checks itself is checked, whichever it is."""

from dataclasses import fields, replace
from inspect import getmodule, getsource
from pathlib import Path

import numpy as np
import pytest

from mlivr_gym import Box, RobotSpec, Settings, paper, robot_spec
from mlivr_gym.agents.hyperparameters import ImitationHyperparameters
from mlivr_gym.errors import MlivrError
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.planners.query import SearchOptions
from mlivr_gym.robot.cargo import Cargo, LockedLimb
from mlivr_gym.robot.visuals import Visual
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.parameters import ControllerParameters, Limits, Physics
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.world.rails import Handrail, Segment

PACKAGE = Path(paper.__file__).parent
ROBOT = robot_spec("mlivr2")
LOW, HIGH = (0.0, 0.0, 0.0), (1.0, 0.1, 0.1)
MOUNT = ROBOT.whole_mounts[0]
RECORDS = (
    Box.between("box", "obstacle", LOW, HIGH), Handrail("H", "deck", LOW, HIGH),
    Segment("S", "deck", LOW, HIGH, (0.0, 0.0, 1.0)), RobotSpec(), ROBOT.limb,
    ROBOT.dynamics_of(0), ROBOT.mounted[0].capsules[0], Visual("upper_arm", "arm.obj"),
    MOUNT, Cargo(1.0, 0.2), LockedLimb(MOUNT, (0.0,) * 6), Settings(),
    Durations(), Setup(), Limits(), Physics(), ControllerParameters(), DisturbanceRanges(),
    SearchOptions(), ImitationHyperparameters(), DepthCamera(),
)  # fmt: skip
FIELDS = [
    pytest.param(record, field.name, id=f"{type(record).__name__}.{field.name}")
    for record in RECORDS
    for field in fields(record)
]


@pytest.mark.parametrize(("record", "name"), FIELDS)
def test_what_no_field_can_be_is_refused_by_its_name(record, name):
    for wrong in (object(), 1j, {"no": object()}, np.full((2, 2, 2), np.nan)):
        with pytest.raises(MlivrError, match=rf"\b{name}\b"):
            replace(record, **{name: wrong})


def test_no_record_that_checks_itself_is_left_out():
    folders = (PACKAGE, PACKAGE / "planners", PACKAGE / "agents")  # the last two may be links
    files = {path.resolve() for folder in folders for path in folder.rglob("*.py")}
    calls = sum(path.read_text(encoding="utf-8").count(".check(self,") for path in files)
    modules = {getmodule(kind) for record in RECORDS for kind in type(record).__mro__[:-1]}
    listed = sum(getsource(one).count(".check(self,") for one in modules if one is not None)
    assert listed == calls
