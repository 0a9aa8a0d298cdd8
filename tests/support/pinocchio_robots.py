"""The robots as Pinocchio has them."""

import numpy as np
import pinocchio as pin

from mlivr_gym.robot.limb_dynamics import arm_data


def pinocchio_robot(robot):
    """The robot from the manufacturer's joint origins and inertias, on a free flyer."""
    data, model = arm_data("ur5e"), pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    size, mass = robot.body_size, robot.body_mass
    model.appendBodyToJoint(base, pin.Inertia.FromBox(mass, size, size, size), pin.SE3.Identity())
    for i in range(robot.limbs):
        place = pin.SE3(robot.mount_rotations[i], robot.mount_positions[i])
        parent = base
        link = data["base_link"]
        cylinder = pin.Inertia.FromCylinder(link["mass"], link["radius"], link["length"])
        above = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5 * link["length"]]))
        model.appendBodyToJoint(base, cylinder, place * above)
        for k, (origin, link) in enumerate(
            zip(data["urdf_joint_origins"], data["links"], strict=True)
        ):
            here = pin.SE3(
                pin.rpy.rpyToMatrix(*map(float, origin["rpy"])),
                np.array(origin["xyz"], dtype=float),
            )
            parent = model.addJoint(
                parent,
                pin.JointModelRZ(),
                place * here if k == 0 else here,
                f"limb{i}/joint{k + 1}",
            )
            inertia = pin.Inertia(
                link["mass"],
                np.array(link["com_urdf"], dtype=float),
                np.array(link["inertia_urdf"]),
            )
            model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        radius, length = data["gripper"]["radius"], robot.tool_length
        gripper = pin.Inertia.FromCylinder(robot.gripper_mass, radius, length)
        model.appendBodyToJoint(
            parent, gripper, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5 * length]))
        )
        model.addFrame(
            pin.Frame(
                f"grasp{i}", parent, pin.SE3(np.eye(3), np.array([0.0, 0.0, length])), pin.OP_FRAME
            )
        )
    model.armature[6:] = data["rotor_inertia"]["value"]
    return model
