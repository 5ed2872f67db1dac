"""A robot: names, index maps and limits around a Pinocchio model, fixed once loaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, read_only
from wbc.errors import UnknownNameError, UrdfError
from wbc.robot.urdf import load_urdf_text


def frame_id(model: Any, name: str) -> int:
    """Index of the frame `name`: the one place that asks Pinocchio for a frame.

    Pinocchio answers an unknown name with an index out of range, and later crashes the process.

    Raises:
        UnknownNameError: with the nearest valid name.
    """
    if not model.existFrame(name):
        raise UnknownNameError("frame", name, (f.name for f in model.frames))
    return int(model.getFrameId(name))


@dataclass(frozen=True)
class RobotModel:
    """A fixed-base robot of revolute and prismatic joints.

    Attributes:
        path: the URDF.
        pin_model: the Pinocchio model; never changed after loading.
        geometry: collision shapes (pin.GeometryModel).
        joint_names: in the order of q and v.
        lower, upper: position limits, shape (nv,), [rad] or [m].
        velocity: velocity limits, shape (nv,), [rad/s] or [m/s].
        effort: torque limits, shape (nv,), [Nm] or [N].
        planar: every joint keeps the robot in its xy-plane.
    """

    path: Path
    pin_model: Any
    geometry: Any
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    effort: Array
    planar: bool

    @property
    def nv(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all frames of the URDF (links and joints)."""
        return tuple(f.name for f in self.pin_model.frames)

    def frame(self, name: str) -> int:
        """Index of a frame. Raises UnknownNameError."""
        return frame_id(self.pin_model, name)

    def joint(self, name: str) -> int:
        """Position of a joint in q and v. Raises UnknownNameError."""
        if name not in self.joint_names:
            raise UnknownNameError("joint", name, self.joint_names)
        return self.joint_names.index(name)

    def support(self, frame: int) -> Array:
        """1 for the joints that move `frame`, 0 for the others, shape (nv,)."""
        mask = np.zeros(self.nv)
        joint = self.pin_model.frames[frame].parentJoint
        while joint > 0:
            mask[self.pin_model.joints[joint].idx_v] = 1.0
            joint = self.pin_model.parents[joint]
        return mask


def load_robot(path: Path) -> RobotModel:
    """Load a URDF that passes the strict check.

    Raises:
        UrdfError: every fault of the file, one line each; or a joint this stack does not drive.
    """
    text = load_urdf_text(path)
    model = pin.buildModelFromXML(text)
    for j in range(1, model.njoints):
        if model.joints[j].nq != 1:
            raise UrdfError(
                f"{path}: joint '{model.names[j]}' is continuous; "
                "give it limits and make it revolute"
            )
    # from the checked text, not the file: what was checked is what is loaded
    geometry = pin.buildGeomFromUrdfString(
        model, text, pin.GeometryType.COLLISION, package_dirs=[str(path.parent)]
    )
    return RobotModel(
        path=path,
        pin_model=model,
        geometry=geometry,
        joint_names=tuple(model.names)[1:],
        lower=read_only(model.lowerPositionLimit),
        upper=read_only(model.upperPositionLimit),
        velocity=read_only(model.velocityLimit),
        effort=read_only(model.effortLimit),
        planar=_is_planar(model),
    )


def _is_planar(model: Any) -> bool:
    """Whether no joint moves anything out of the world's xy-plane."""
    data = model.createData()
    jacobian = pin.computeJointJacobians(model, data, pin.neutral(model))
    out_of_plane = jacobian[[2, 3, 4], :]
    return model.nv > 0 and bool(np.all(np.abs(out_of_plane) < 1e-12))
