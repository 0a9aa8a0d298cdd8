"""Masses of the parts of a limb that are no links of its joints: its base and its gripper."""

from __future__ import annotations

from mlivr_gym.robot.limb_dynamics import LimbDynamics, arm_data
from mlivr_gym.robot.rigid import RigidBody, cylinder


def base_link(dynamics: LimbDynamics) -> RigidBody:
    """Return the link by which a limb is fixed to the body."""
    mass, (radius, length) = dynamics.base_mass, dynamics.base_size
    link = cylinder(mass, radius, length, 0.5 * length)
    if dynamics.base_centre is not None:
        link = link._replace(centre=dynamics.base_centre)
    if dynamics.base_inertia is not None:
        link = link._replace(inertia=dynamics.base_inertia)
    return link


def gripper_link(mass: float, tool_length: float) -> RigidBody:
    """Return a gripper, a cylinder from the flange to the grasp [kg, m]."""
    radius = arm_data("ur5e")["gripper"]["radius"]
    return cylinder(mass, radius, max(tool_length, 0.01), 0.5 * tool_length)
