"""Minimum-jerk references of object, pads and free tips, from where they are to a phase's goals."""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias, final

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.grasp import ObjectReference
from wbc.rotations import exp_so3

_ROUNDING: Final = 1e-9  # share of a motion by which the tick at its end may fall short of it


class Aim(NamedTuple):
    """How a task's target is led to a goal in a phase; the goal itself is in the state's targets.

    Attributes:
        task: index.
        way: (k,) from where its reference was to the goal, in the task's units.
        linear: at constant speed, as the published reach to grasp; else minimum-jerk.
    """

    task: int
    way: Array
    linear: bool


class Motion(NamedTuple):
    """One phase's motions: all last `duration`, and but for linear aims start and end at rest.

    While `pace` is not 1 the motion's own time goes on from `now` at that pace, and `start` has
    been put off by what was lost before (`wbc.control.pace`).

    Attributes:
        start: time at which they start, [s].
        duration: [s], positive.
        position: (2, 3) object position from, to, [m].
        rotation: (3, 3) object rotation at the start.
        turn: (3,) rotation vector from there to the end, world axes, [rad].
        reach: (2, N) l − Δl of the pads from, to, [m].
        tips: (2, N, 3) points for the free tips from, to, in the object frame, [m].
        aims: of the tasks that the phase leads.
        pace: share of its own speed with which all moves, in [0, 1].
        now: time at which this pace began, [s]; not used while it is 1.
        quickening: rate of the pace, [1/s].
    """

    start: float
    duration: float
    position: Array
    rotation: Array
    turn: Array
    reach: Array
    tips: Array
    aims: tuple[Aim, ...] = ()
    pace: float = 1.0
    now: float = 0.0
    quickening: float = 0.0

    def clock(self, t: float) -> float:
        """The motion's own time at time t [s]."""
        return t if self.pace == 1.0 else self.now + self.pace * (t - self.now)


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


Targets: TypeAlias = tuple[Array | None, ...]


def led(t: float, motion: Motion, targets: Targets) -> Targets:
    """The targets at time t: those that the motion leads on their way with their rates (2k,).

    Args:
        targets: of the state; of a task that is led, its goal, (k,), or (2k,) with a rate.
    """
    t = motion.clock(t)
    if not motion.aims or _ended(t, motion):
        return targets
    out = list(targets)
    tau = max((t - motion.start) / motion.duration, 0.0)
    for task, way, linear in motion.aims:
        s, ds = (tau, 1.0) if linear else minimum_jerk(tau)
        there = _behind(targets, task, (s - 1.0) * way, 2 * len(way))
        there[len(way) :] += (motion.pace * ds / motion.duration) * way
        out[task] = there
    return tuple(out)


def standing(t: float, motion: Motion, targets: Targets) -> Targets:
    """The targets where `led` has brought them to at time t, in the size they have, at rest."""
    t = motion.clock(t)
    if not motion.aims or _ended(t, motion):
        return targets
    out = list(targets)
    tau = max((t - motion.start) / motion.duration, 0.0)
    for task, way, linear in motion.aims:
        s = tau if linear else minimum_jerk(tau)[0]
        out[task] = _behind(targets, task, (s - 1.0) * way)
    return tuple(out)


def _ended(t: float, motion: Motion) -> bool:
    return t >= motion.start + (1.0 - _ROUNDING) * motion.duration


def _behind(targets: Targets, task: int, offset: Array, size: int = 0) -> Array:
    """A task's goal moved by an offset (k,), filled up with zeros to `size`."""
    goal = targets[task]
    assert goal is not None  # who made the aim saw to it
    out: Array = np.zeros(max(size, len(goal)))
    out[: len(goal)] = goal
    out[: len(offset)] += offset
    return out


def object_acceleration(t: float, motion: Motion) -> Array:
    """(6,) rate of the object's reference twist at time t, world axes [m/s², rad/s²].

    The object turns about one axis fixed in the world, so the turning rate has no other part. At a
    pace p it is p² a + ṗ v, with v and a of the motion at its own speed.
    """
    t, way = motion.clock(t), motion.position[1] - motion.position[0]
    acceleration: Array = _acceleration(t, motion.start, motion.duration, way, motion.turn)
    if motion.pace != 1.0 or motion.quickening != 0.0:
        acceleration *= motion.pace * motion.pace
        speed = minimum_jerk((t - motion.start) / motion.duration)[1] / motion.duration
        acceleration[:3] += motion.quickening * speed * way
        acceleration[3:] += motion.quickening * speed * motion.turn
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
        t = motion.clock(t)
        over = t >= motion.start + motion.duration
        if not (over and motion is self._at_rest):
            _evaluate(t, *motion[:7], *self.object, self.tips)
            if motion.pace != 1.0:
                for rate in (self.object.twist, self.object.reach_rate, self.tips[:, 3:]):
                    rate *= motion.pace
            self._at_rest = motion if over else None
        return self.object
