"""The robots as Pinocchio has them."""

import numpy as np
import pinocchio as pin

from mlivr_gym.robot.limb_dynamics import arm_data


def along_z(length):
    """A frame that lies farther along the z axis."""
    return pin.SE3(np.eye(3), np.array([0.0, 0.0, length]))


def pinocchio_robot(robot):
    """The robot from the manufacturer's joint origins and inertias, on a free flyer."""
    data, model = arm_data("ur5e"), pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.addJointFrame(base)
    cube = pin.Inertia.FromBox(robot.body_mass, *[robot.body_size] * 3)
    model.appendBodyToJoint(base, cube, pin.SE3.Identity())
    for i in range(robot.limbs):
        here = pin.SE3(robot.mount_rotations[i], robot.mount_positions[i])
        link = data["base_link"]
        cylinder = pin.Inertia.FromCylinder(link["mass"], link["radius"], link["length"])
        model.appendBodyToJoint(base, cylinder, here * along_z(0.5 * link["length"]))
        parent, each = base, zip(data["urdf_joint_origins"], data["links"], strict=True)
        for k, (origin, link) in enumerate(each):
            turn = pin.rpy.rpyToMatrix(*map(float, origin["rpy"]))
            here = here * pin.SE3(turn, np.array(origin["xyz"], dtype=float))
            parent = model.addJoint(parent, pin.JointModelRZ(), here, f"limb{i}/joint{k + 1}")
            model.addJointFrame(parent)
            here = pin.SE3.Identity()
            centre, moments = (np.array(link[f"{name}_urdf"], float) for name in ("com", "inertia"))
            model.appendBodyToJoint(parent, pin.Inertia(link["mass"], centre, moments), here)
        radius, length = data["gripper"]["radius"], robot.tool_length
        gripper = pin.Inertia.FromCylinder(robot.gripper_mass, radius, length)
        model.appendBodyToJoint(parent, gripper, along_z(0.5 * length))
        model.addFrame(pin.Frame(f"grasp{i}", parent, along_z(length), pin.OP_FRAME))
    model.armature[6:] = data["rotor_inertia"]["value"]
    return model
