"""From planned contact forces to the arrows of a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.robot.model import RobotModel
from wbc.view.scene import ForceArrows

_WEIGHT = 0.10  # length of the arrow of the first weight shown, [m]
_LEVER = 0.05  # a moment is as long as the force that has it at this distance, [m]
_ACTIVE = 0.05  # part of a joint's torque range, from a limit on, in which it counts as active


@final
class ArrowMaker:
    """Makes arrows of one scale, chosen by the first weight that it sees."""

    def __init__(
        self,
        model: RobotModel,
        tips: Sequence[str],
        tau_min: Sequence[float],
        tau_max: Sequence[float],
    ) -> None:
        """
        Args:
            tips: the frame of each contact's fingertip, (N,).
            tau_min, tau_max: (nv,) torque limits of the joints, [Nm].

        Raises:
            UnknownNameError: no such frame.
        """
        self._joints = own_joints(model, tips)
        self._near = _ACTIVE * (np.asarray(tau_max) - np.asarray(tau_min))
        self._gravity = np.array(model.pin_model.gravity.linear)
        self._scale = 0.0

    def of(
        self, force: Array, torque_margin: Array, mass: float, com: Array, wrench: Array, at: Array
    ) -> ForceArrows:
        """The arrows of an instant.

        Args:
            force: (N, 3) of each contact on the object, [N]; 0 where free.
            torque_margin: (nv,) distance of each torque to its nearer limit, [Nm].
            mass: of the object, [kg].
            com: (3,) its centre of mass, [m].
            wrench: (6,) that the contacts supply about the object's origin, [N], [Nm].
            at: (3,) the object's origin, [m].
        """
        weight = mass * self._gravity
        if self._scale == 0.0 and (size := float(np.linalg.norm(weight))) > 0.0:
            self._scale = _WEIGHT / size
        scale = self._scale * np.repeat([1.0, 1.0 / _LEVER], 3)
        pressing = np.linalg.norm(force, axis=1, keepdims=True) > 0.0
        tight = torque_margin < self._near
        return ForceArrows(
            contact=np.where(pressing, self._scale * force, np.nan),
            limited=(self._joints & tight).any(axis=1),
            com=com,
            weight=scale * np.concatenate((weight, np.cross(com - at, weight))),
            resultant=scale * wrench,
            origin=at,
        )


def own_joints(model: RobotModel, tips: Sequence[str]) -> BoolArray:
    """(N, nv) the joints that move the tip of a contact and no tip of another frame."""
    moved = {tip: model.support(model.frame(tip)) > 0.0 for tip in tips}
    alone = np.sum(list(moved.values()), axis=0) == 1
    return np.array([moved[tip] & alone for tip in tips], dtype=np.bool_).reshape(-1, model.nv)
