"""What an arm can do, each operation behind one name; every other module asks here.

The operations say which branches reach a flange pose and how far they are from singular, which
joint angles they have, where their joints are and where the links are. There is one closed form,
that of the UR arms. Arms of seven joints whose first is locked, as those of space stations, are of
that form with other lengths; `tests/kinematics/test_families.py` shows it.

A second closed form is a module with these functions beside `ur`, a field of `Arm` that names the
form, and here, in place of each import, a kernel that calls one or the other by that field.
"""

from mlivr_gym.kinematics.ur import SINGULAR as SINGULAR
from mlivr_gym.kinematics.ur import SINGULAR_TOO as SINGULAR_TOO
from mlivr_gym.kinematics.ur import branch_angles as branch_angles
from mlivr_gym.kinematics.ur import branch_frames as branch_frames
from mlivr_gym.kinematics.ur import branch_terms as branch_terms
from mlivr_gym.kinematics.ur import forward_kinematics as forward_kinematics
from mlivr_gym.kinematics.ur import joint_axes as joint_axes
from mlivr_gym.kinematics.ur import link_frames as link_frames
