"""Kinematics of the robot at one configuration: computed once per tick, then handed on as a token."""

from __future__ import annotations

from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.robot.model import RobotModel


@kernel
def _frame_jacobians(
    joint_jacobian: Array, support: Array, position: Array, linear: Array, angular: Array
) -> None:
    """Jacobians of all tracked frames from the joints' spatial axes in the world (25).

    A joint's column holds the velocity of the world's origin and the angular velocity; a frame at p
    moves with v + ω × p if the joint carries it.
    """
    for f in range(position.shape[0]):
        x, y, z = position[f, 0], position[f, 1], position[f, 2]
        s = support[f]
        angular[f] = joint_jacobian[3:] * s
        linear[f, 0] = (joint_jacobian[0] + joint_jacobian[4] * z - joint_jacobian[5] * y) * s
        linear[f, 1] = (joint_jacobian[1] + joint_jacobian[5] * x - joint_jacobian[3] * z) * s
        linear[f, 2] = (joint_jacobian[2] + joint_jacobian[3] * y - joint_jacobian[4] * x) * s


@final
class Kinematics:
    """Frames, Jacobians and (where asked for) the centre of mass at one q.

    The arrays are this object's workspace: `update` overwrites them and returns the object, and what
    is read until the next `update` belongs to that q. Frames are tracked by their place in `frames`.

    Attributes:
        model: the robot.
        frames: names of the tracked frames, F of them.
        q: (nv,) the configuration, [rad] or [m].
        position: (F, 3) origins in the world, [m].
        rotation: (F, 3, 3) orientations in the world.
        linear, angular: (F, 3, nv) Jacobians of the origins' velocity and of the angular velocity,
            in the world's axes (25).
        com, com_jacobian: (3,) [m] and (3, nv), fresh only if `track_com`.
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
        # Views into Pinocchio's data follow it: taking them anew costs more than the kinematics.
        self._copies = [
            (self.position[k], self.data.oMf[i].translation) for k, i in enumerate(ids)
        ] + [(self.rotation[k], self.data.oMf[i].rotation) for k, i in enumerate(ids)]
        self._joint_jacobian: Array = self.data.J

    def update(self, q: Array) -> Kinematics:
        """Bring everything to q, shape (nv,), finite."""
        self.q[:] = q
        pin.computeJointJacobians(self.model.pin_model, self.data, q)
        pin.updateFramePlacements(self.model.pin_model, self.data)
        for target, source in self._copies:
            target[...] = source
        _frame_jacobians(
            self._joint_jacobian, self._support, self.position, self.linear, self.angular
        )
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
