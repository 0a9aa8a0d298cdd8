"""What every family of arms can do, each behind one name.

A family says which branches reach a flange pose and how far they are from singular, which joint
angles they have, where their joints are and where the links are. All other modules ask for these
functions here. There is one family, that of the UR arms; arms of seven joints whose first is
locked, as those of space stations, are of its form. A second one is a module with the same
functions, and a choice by `Arm.family` here.
"""

from mlivr_gym.kinematics.ur import SINGULAR as SINGULAR
from mlivr_gym.kinematics.ur import SINGULAR_TOO as SINGULAR_TOO
from mlivr_gym.kinematics.ur import branch_angles as branch_angles
from mlivr_gym.kinematics.ur import branch_frames as branch_frames
from mlivr_gym.kinematics.ur import branch_terms as branch_terms
from mlivr_gym.kinematics.ur import joint_axes as joint_axes
from mlivr_gym.kinematics.ur import link_frames as link_frames
