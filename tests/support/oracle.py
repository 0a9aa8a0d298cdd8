"""Independent truth: a Pinocchio model built from the manufacturer's DH table."""

import numpy as np
import pinocchio as pin

ALPHAS = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)


def lengths_of(limb):
    """Lengths of an arm of UR as its maker's DH table has them, by the places of its links."""
    (_, _, d1), _, (a2, _, _), (a3, _, d4), (_, d5, _), (_, d6, _) = limb.origins
    return d1, a2, a3, d4, -d5, d6


def pinocchio_arm(limb):
    """Model of one arm; frame "flange" is DH frame 6."""
    model = pin.Model()
    d1, a2, a3, d4, d5, d6 = lengths_of(limb)
    offsets = (d1, 0.0), (0.0, a2), (0.0, a3), (d4, 0.0), (d5, 0.0), (d6, 0.0)
    placement, parent = pin.SE3.Identity(), 0
    for k, ((d, a), alpha) in enumerate(zip(offsets, ALPHAS, strict=True)):
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint{k + 1}")
        placement = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, d]))
    model.addFrame(pin.Frame("flange", parent, placement, pin.FrameType.OP_FRAME))
    return model


def flange(model, q, name="flange"):
    """Pose of a frame and its Jacobian in base axes, linear rows first."""
    data = model.createData()
    frame = model.getFrameId(name)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    jacobian = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    return data.oMf[frame].homogeneous, jacobian


def volume(jacobian):
    """|det J|; factors below 1e-300 are zero and no matter for a warning."""
    with np.errstate(all="ignore"):
        return abs(np.nan_to_num(np.linalg.det(jacobian)))
