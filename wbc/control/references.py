"""Minimum-jerk references of object, pads and free tips, from where they are to a phase's goals."""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.grasp import ObjectReference
from wbc.rotations import exp_so3


class Motion(NamedTuple):
    """One phase's motions: all start and end at rest and last `duration`.

    Attributes:
        start: time at which they start, [s].
        duration: [s], positive.
        position: (2, 3) object position from, to, [m].
        rotation: (3, 3) object rotation at the start.
        turn: (3,) rotation vector from there to the end, world axes, [rad].
        reach: (2, N) l − Δl of the pads from, to, [m].
        tips: (2, N, 3) points for the free tips from, to, in the object frame, [m].
    """

    start: float
    duration: float
    position: Array
    rotation: Array
    turn: Array
    reach: Array
    tips: Array


@kernel
def minimum_jerk(tau: float) -> tuple[float, float]:
    """Share of the way at share tau of the time, and its slope; 0 and 1 outside [0, 1]."""
    if tau <= 0.0:
        return 0.0, 0.0
    if tau >= 1.0:
        return 1.0, 0.0
    s = tau * tau * tau * (10.0 + tau * (-15.0 + 6.0 * tau))
    ds = 30.0 * tau * tau * (1.0 - tau) * (1.0 - tau)
    return s, ds


@kernel
def _evaluate(
    t: float, start: float, duration: float, position: Array, rotation: Array, turn: Array,
    reach: Array, tips: Array, out_position: Array, out_rotation: Array, out_twist: Array,
    out_reach: Array, out_reach_rate: Array, out_tips: Array,
) -> None:  # fmt: skip
    s, ds = minimum_jerk((t - start) / duration)
    ds /= duration
    way = position[1] - position[0]
    out_position[:] = position[0] + s * way
    out_twist[:3] = ds * way
    out_twist[3:] = ds * turn
    out_rotation[:] = exp_so3(s * turn) @ rotation
    pads = reach[1] - reach[0]
    out_reach[:] = reach[0] + s * pads
    out_reach_rate[:] = ds * pads
    for i in range(tips.shape[1]):
        way = tips[1, i] - tips[0, i]
        out_tips[i, :3] = tips[0, i] + s * way
        out_tips[i, 3:] = ds * way


@kernel
def _acceleration(t: float, start: float, duration: float, way: Array, turn: Array) -> Array:
    """Second derivative of the minimum-jerk way and turn; 0 outside the motion."""
    out = np.zeros(6)
    tau = (t - start) / duration
    if 0.0 < tau < 1.0:
        dds = 60.0 * tau * (1.0 - tau) * (1.0 - 2.0 * tau) / (duration * duration)
        out[:3] = dds * way
        out[3:] = dds * turn
    return out


def object_acceleration(t: float, motion: Motion) -> Array:
    """(6,) rate of the object's reference twist at time t, world axes [m/s², rad/s²].

    The object turns about one axis fixed in the world, so the turning rate has no other part.
    """
    way = motion.position[1] - motion.position[0]
    acceleration: Array = _acceleration(t, motion.start, motion.duration, way, motion.turn)
    return acceleration


@final
class References:
    """Workspace in which a `Motion` is evaluated; the next call overwrites what one returns."""

    def __init__(self, fingers: int) -> None:
        self.object = ObjectReference(
            np.zeros(3), np.eye(3), np.zeros(6), np.zeros(fingers), np.zeros(fingers)
        )
        self.tips: Array = np.zeros((fingers, 6))
        self._at_rest: Motion | None = None  # the motion that has ended in these values

    def at(self, t: float, motion: Motion) -> ObjectReference:
        """The object's reference at time t; the tips' targets (N, 6) are in `tips`."""
        over = t >= motion.start + motion.duration
        if not (over and motion is self._at_rest):
            _evaluate(t, *motion, *self.object, self.tips)
            self._at_rest = motion if over else None
        return self.object
