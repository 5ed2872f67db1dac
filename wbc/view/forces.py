"""From contact forces to the arrows of a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.robot.model import RobotModel
from wbc.view.scene import ForceArrows, pose_matrices

LENGTH = 0.10
"""Of the arrow of the first weight shown, [m]; where nothing weighs, of the first largest force."""
_LEVER = 0.05  # a moment is as long as the force that has it at this distance, [m]
_ACTIVE = 0.05  # part of a joint's torque range, from a limit on, in which it counts as active


class Load(NamedTuple):
    """What the contacts bear.

    Attributes:
        mass: of the object, [kg].
        com: (3,) its centre of mass, [m].
        wrench: (6,) that the contacts supply about the object's origin, [N], [Nm].
    """

    mass: float
    com: Array
    wrench: Array


@final
class ArrowMaker:
    """Makes arrows of one scale, chosen by the first weight that it sees."""

    def __init__(
        self,
        model: RobotModel,
        tips: Sequence[str],
        tau_min: Sequence[float],
        tau_max: Sequence[float],
        *,
        body: tuple[float, Array] = (0.0, np.zeros(3)),
        length: float = LENGTH,
    ) -> None:
        """
        Args:
            tips: the frame of each contact's fingertip, (N,).
            tau_min, tau_max: (nv,) torque limits of the joints, [Nm].
            body: mass [kg] and centre of mass (3,) [m] in its axes of an object whose load no
                optimizer tells.

        Raises:
            UnknownNameError: no such frame.
        """
        self._joints = own_joints(model, tips)
        self._limits = np.array((tau_min, tau_max), dtype=np.float64).reshape(2, -1)
        width = self._limits[1] - self._limits[0]
        self._near = np.where(np.isfinite(width), _ACTIVE * width, 0.0)
        gravity = np.array(model.pin_model.gravity.linear)
        self._gravity = np.zeros(3) if model.planar else gravity  # there nothing weighs
        self._body, self._length = body, length
        self._scale = 0.0

    def planned(self, force: Array, torque_margin: Array, load: Load, at: Array) -> ForceArrows:
        """The arrows of an instant of the ideal robot.

        Args:
            force: (N, 3) planned of each contact on the object, [N]; 0 where free.
            torque_margin: (nv,) distance of each torque to its nearer limit, [Nm].
            at: (3,) the object's origin, [m].
        """
        return self._arrows(force, np.full_like(force, np.nan), torque_margin, load, at)

    def driven(
        self, force: Array, measured: Array, tau: Array, points: Array, pose: Array,
        load: Load | None = None,
    ) -> ForceArrows:  # fmt: skip
        """The arrows of an instant of a robot that torques move.

        Args:
            force, measured: (N, 3) planned and measured of each contact on the object, [N].
            tau: (nv,) torques, [Nm].
            points: (N, 3) contact points, [m].
            pose: (7,) of the object.
            load: as an optimizer has it; None: weight of the body, resultant of the planned forces.
        """
        at, margin = pose[:3], np.minimum(self._limits[1] - tau, tau - self._limits[0])
        if load is None:
            mass, inside = self._body
            moment = np.where(force != 0.0, np.cross(points - at, force), 0.0).sum(axis=0)
            com = at + pose_matrices(pose)[0, :3, :3] @ inside
            load = Load(mass, com, np.concatenate((force.sum(axis=0), moment)))
        return self._arrows(force, measured, margin, load, at)

    def _arrows(
        self, force: Array, measured: Array, margin: Array, load: Load, at: Array
    ) -> ForceArrows:
        weight = load.mass * self._gravity
        size = float(np.linalg.norm(weight)) or float(np.linalg.norm(force, axis=1).max(initial=0))
        if self._scale == 0.0 and size > 0.0:
            self._scale = self._length / size
        scale = self._scale * np.repeat([1.0, 1.0 / _LEVER], 3)
        return ForceArrows(
            contact=self._scaled(force),
            measured=self._scaled(measured),
            limited=np.any(self._joints & (margin < self._near), axis=1),
            com=load.com,
            weight=scale * np.concatenate((weight, np.cross(load.com - at, weight))),
            resultant=scale * load.wrench,
            origin=at,
        )

    def _scaled(self, force: Array) -> Array:
        pressing = np.linalg.norm(force, axis=1, keepdims=True) > 0.0
        return np.where(pressing, self._scale * force, np.nan)


def own_joints(model: RobotModel, tips: Sequence[str]) -> BoolArray:
    """(N, nv) the joints that move the tip of a contact and no tip of another frame."""
    moved = {tip: model.support(model.frame(tip)) > 0.0 for tip in tips}
    alone = np.sum(list(moved.values()), axis=0) == 1
    return np.array([moved[tip] & alone for tip in tips], dtype=np.bool_).reshape(-1, model.nv)
