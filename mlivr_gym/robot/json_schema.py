"""The fields of a robot file as a JSON schema, made from the validators that check them.

`python -m mlivr_gym.robot.json_schema > envs_assets/robot.schema.json` writes the file that ships.
"""

from __future__ import annotations

import json
from typing import Any

from mlivr_gym.json_schema import DRAFT, json_schema_of
from mlivr_gym.robot.limb_dynamics import ARMS, Named
from mlivr_gym.robot.specification import ROBOT
from mlivr_gym.robot.validators import OneOrList, PairOf


def robot_schema() -> dict[str, Any]:
    """Return the JSON schema of a robot file.

    It says what `RobotSpec.load` accepts, field by field; what joins several fields, such as the
    order of two limits, is checked on loading alone.
    """
    return {
        "$schema": DRAFT,
        "title": "Robot of mlivr-gym",
        "description": "Lengths in m, angles in rad, masses in kg; all fields may be left out.",
        **json_schema_of(ROBOT),
    }


@json_schema_of.register
def _of_named(kind: Named) -> dict[str, Any]:
    return {"anyOf": [json_schema_of(kind.kind), {"enum": list(ARMS)}]}


@json_schema_of.register
def _of_one_or_list(kind: OneOrList) -> dict[str, Any]:
    return {"anyOf": [json_schema_of(kind.one), json_schema_of(kind.listed)]}


@json_schema_of.register
def _of_pair(kind: PairOf) -> dict[str, Any]:
    return {"enum": [list(pair) for pair in kind.pairs]}


if __name__ == "__main__":
    print(json.dumps(robot_schema(), indent=1))
