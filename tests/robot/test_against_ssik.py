"""Arms as ssik describes them, whose solutions it finds without the closed forms, against ours."""

import pytest
from numeric_solutions import solved
from ssik_arms import compared

EXACT = ("Franka Research 3, joint 6", "KUKA LBR iiwa 7, joint 3", "KUKA KR 210", "Dobot CR5")
"""Arms that EAIK solves, too."""

BESIDE = ("Kinova Gen3, joint 1", "Kinova Gen3, joint 3", "UFactory xArm7, joint 6")
"""Arms whose axes do not quite meet, so that EAIK knows no closed form."""


@pytest.mark.parametrize("name", [*EXACT, *BESIDE])
def test_ssik_finds_the_same_solutions(name):
    """Those of the arm as it is, one beside each branch of its form."""
    row = compared(1, name, 2)
    assert row["found"] == row["ssik"] > 4
    assert row["foreign"] == row["missed"] == 0
    assert row["largest_error"] < 1e-10


@pytest.mark.parametrize("name", ["UFactory xArm 6", "Kinova Gen3 lite"])
def test_arms_without_a_closed_form_have_the_regular_solutions_of_ssik(name):
    """All but a few, which share a name with another one."""
    row = solved(1, name, 12)
    assert row["family"] == "numeric"
    assert row["regular"] > 30
    assert row["found"] >= 0.95 * row["regular"]
