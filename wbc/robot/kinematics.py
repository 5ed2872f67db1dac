"""Kinematics of the robot at one configuration: computed once, then handed on as a token."""

from __future__ import annotations

from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.errors import WbcError
from wbc.robot.model import RobotModel


def placements(poses: Any, *, writeable: bool = False) -> Array:
    """All placements of a Pinocchio vector of SE3 as one array that follows it, shape (n, 12).

    Columns: the rotation column by column, then the translation. Pinocchio keeps them in one block;
    a view of it spares two calls per placement and tick. The layout is verified here, address by
    address, so that a Pinocchio which changes it is refused at load rather than misread.

    Raises:
        WbcError: another layout than the one known.
    """
    first = poses[0].rotation
    base = first.__array_interface__["data"][0]
    for k in range(len(poses)):
        r, t = poses[k].rotation, poses[k].translation
        addresses = [x.__array_interface__["data"][0] for x in (r, t)]
        if addresses != [base + 96 * k, base + 96 * k + 72] or r.strides != (8, 24):
            raise WbcError("this version of pinocchio lays out its placements in an unknown way")
    return np.lib.stride_tricks.as_strided(first, (len(poses), 12), (96, 8), writeable=writeable)


@kernel
def _frames(
    poses: Array, ids: IntArray, joint_jacobian: Array, support: Array,
    position: Array, rotation: Array, linear: Array, angular: Array,
) -> None:  # fmt: skip
    """Placements and Jacobians of all tracked frames (25).

    A joint's column holds the velocity of the world's origin and the angular velocity; a frame at p
    moves with v + ω × p if the joint carries it.
    """
    for f in range(ids.shape[0]):
        pose = poses[ids[f]]
        for c in range(3):
            rotation[f, 0, c] = pose[3 * c]
            rotation[f, 1, c] = pose[3 * c + 1]
            rotation[f, 2, c] = pose[3 * c + 2]
        x, y, z = pose[9], pose[10], pose[11]
        position[f, 0], position[f, 1], position[f, 2] = x, y, z
        s = support[f]
        angular[f] = joint_jacobian[3:] * s
        linear[f, 0] = (joint_jacobian[0] + joint_jacobian[4] * z - joint_jacobian[5] * y) * s
        linear[f, 1] = (joint_jacobian[1] + joint_jacobian[5] * x - joint_jacobian[3] * z) * s
        linear[f, 2] = (joint_jacobian[2] + joint_jacobian[3] * y - joint_jacobian[4] * x) * s


@final
class Kinematics:
    """Frames, Jacobians and (where asked for) the centre of mass at one q.

    The arrays are this object's workspace: `update` overwrites them and returns the object, and
    what is read until the next `update` belongs to that q. Frames are known by their place in
    `frames`.

    Attributes:
        model: the robot.
        frames: names of the tracked frames, F of them.
        q: (nv,) the configuration, [rad] or [m].
        position: (F, 3) origins in the world, [m].
        rotation: (F, 3, 3) orientations in the world.
        linear, angular: (F, 3, nv) Jacobians of the origins' velocity and of the angular velocity,
            in the world's axes (25).
        com, com_jacobian: (3,) [m] and (3, nv), fresh only if `track_com`.
        joint_poses: (njoints, 12) placements of all joints, as from `placements`.
    """

    def __init__(
        self, model: RobotModel, frames: tuple[str, ...], *, track_com: bool = False
    ) -> None:
        self.model = model
        self.frames = frames
        self.track_com = track_com
        self.data: Any = model.pin_model.createData()
        count, nv = len(frames), model.nv
        self.q: Array = np.zeros(nv)
        self.position: Array = np.zeros((count, 3))
        self.rotation: Array = np.zeros((count, 3, 3))
        self.linear: Array = np.zeros((count, 3, nv))
        self.angular: Array = np.zeros((count, 3, nv))
        self.com: Array = np.zeros(3)
        self.com_jacobian: Array = np.zeros((3, nv))
        ids = [model.frame(name) for name in frames]
        self._support = np.array([model.support(i) for i in ids]).reshape(count, nv)
        self._ids = np.array(ids, dtype=np.int64)
        self._frame_poses = placements(self.data.oMf)
        self.joint_poses = placements(self.data.oMi)
        self._joint_jacobian: Array = self.data.J

    def update(self, q: Array) -> Kinematics:
        """Bring everything to q, shape (nv,), finite."""
        self.q[:] = q
        pin.computeJointJacobians(self.model.pin_model, self.data, q)
        pin.updateFramePlacements(self.model.pin_model, self.data)
        _frames(
            self._frame_poses, self._ids, self._joint_jacobian, self._support,
            self.position, self.rotation, self.linear, self.angular,
        )  # fmt: skip
        if self.track_com:
            self.com_jacobian[:] = pin.jacobianCenterOfMass(self.model.pin_model, self.data, q)
            self.com[:] = self.data.com[0]
        return self

    def update_placements(self, q: Array) -> Kinematics:
        """Bring only the joint placements to q (for predicted costs); Jacobians stay behind."""
        self.q[:] = q
        pin.forwardKinematics(self.model.pin_model, self.data, q)
        return self

    def index(self, frame: str) -> int:
        """Place of a tracked frame."""
        return self.frames.index(frame)
