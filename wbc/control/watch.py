"""Watchdogs of a robot driven by torques: what is measured is judged, and the motion slowed for it.

Values in, values out: no clock, no exception. Each fault has a bit of `TorqueStatus` and lowers the
pace (`wbc.control.pace`), down to a stand; when it is gone the motion goes on where it stood.

A reading that cannot be used is replaced by the joint's reference and what the joint was last off
it, of a fingertip by its last force: a gap of some ticks costs nothing. After that the sensor is
blind. The motion stops, and what was off fades: a joint then gets the torque of its reference at
rest, its weight and its part of the planned forces, a finger goes on pressing as planned.
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import Any, NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.grasp import ContactMode
from wbc.control.force_control import Goal, TorqueStatus
from wbc.control.numbers import given
from wbc.control.pace import pace_of, stride
from wbc.control.readings import Readings, ReadingState
from wbc.control.state import PRESSING, Measurement

_FELT = 0.05  # measured normal force from which on a finger touches [N]: above a sensor's noise
_LATE = 1.5  # ticks between two stamps from which on a tick is late
_TAKEN, _GIVEN = 0.05, 0.2  # [s] in which others take a lost finger's part, and give it back
_PATIENCE = 0.07  # [s] from the loss of a contact until its finger goes to look for it
_OVERLOADED = 0.3  # share of the way to full speed while joints stay at their torque limits


@dataclass(frozen=True)
class WatchSettings:
    """Thresholds.

    Attributes:
        arm_error, finger_error: distance of a joint from its reference at which all stands still,
            [rad] or [m]; from half of it on all goes slower.
        bridged: ticks without a usable reading after which a sensor is blind.
        frozen: ticks with the very same reading, while something moves, after which it is frozen.
        lost: time without a measured force after which a finger that is to press has lost its
            contact [s].
        late: ticks in a row that come too late or not in order, after which all stands still.
        overload: time at a torque limit after which all goes slower [s].
        ramp: time from full speed to a stand [s].
    """

    arm_error: float = 0.1
    finger_error: float = 0.6
    bridged: int = 10
    frozen: int = 25
    lost: float = 0.03
    late: int = 5
    overload: float = 0.1
    ramp: float = 0.2


class WatchState(NamedTuple):
    """What the watchdogs carry from tick to tick.

    Attributes:
        share: of the way from a stand to full speed.
        readings: of the sensors.
        off: (N,) ticks in a row in which a finger that is to press was not felt.
        sensed: (N,) fingers of which a force has ever been measured.
        spare: (N,) how much of a finger's part in the planned forces others have, in [0, 1].
        over: ticks in a row with a joint at its limit.
        stamp: of the last measurement [s]; NaN where there was none.
        late: ticks in a row that were late or out of order.
        mode, plan, normals: (N,), (N, 3), (N, 3): of the last goal.
    """

    share: float
    readings: ReadingState
    off: IntArray
    sensed: BoolArray
    spare: Array
    over: int
    stamp: float
    late: int
    mode: IntArray
    plan: Array
    normals: Array


class View(NamedTuple):
    """A tick's measurement, judged.

    Attributes:
        measured: complete and finite; what was given, where all of it was good.
        pace: of this tick's references.
        bears: (N,) fingers that are felt to touch, and those that never had a sensor; None where
            no forces were ever measured.
        asked: (N,) fingers that are to press.
        seeks: (N,) fingers that have been off for so long that they are to look for the object.
        spare: (N,) how far the forces have passed to those with which the others balance the
            object without a finger.
        status: what was found.
    """

    measured: Measurement
    pace: float
    bears: BoolArray | None
    asked: BoolArray
    seeks: BoolArray
    spare: Array
    status: TorqueStatus


@final
class Watch:
    """The watchdogs of one robot; holds no state between ticks.

    Attributes:
        error_at_stand: (nv,) distances from the reference at which all stands still, [rad] or [m].
    """

    def __init__(
        self, settings: WatchSettings, readings: Readings, fingers: BoolArray, count: int
    ) -> None:
        """
        Args:
            fingers: (nv,) joints that are a finger's.
            count: N.
        """
        self.settings = settings
        self._readings = readings
        self.error_at_stand = np.where(fingers, settings.finger_error, settings.arm_error)
        self._count = count

    def init(self) -> WatchState:
        """Before the first tick."""
        n = self._count
        none, forces = np.zeros(n, dtype=np.int64), np.zeros((n, 3))
        first = self._readings.init()
        return WatchState(
            1.0, first, none, none > 0, np.zeros(n), 0, np.nan, 0, none, forces, forces
        )

    def look(
        self, state: WatchState, measured: Measurement, q: Array, v: Array, dt: float
    ) -> tuple[View, WatchState]:
        """Judge what is measured at the start of a tick. Never raises on what it is given.

        Args:
            q, v: (nv,) reference at the start of the tick and the velocity commanded up to it.
            dt: the tick [s].
        """
        state, status = self._timed(state, measured, dt)
        stale = bool(status & TorqueStatus.STALE)
        usable, blind, readings = self._readings.read(
            state.readings, None if stale else measured, q, v, state.plan, dt
        )
        state = state._replace(readings=readings)
        status |= blind
        wanted = 1.0
        if status & (TorqueStatus.BLIND | TorqueStatus.FROZEN) or state.late >= self.settings.late:
            wanted = 0.0
        error = np.max(np.abs(usable.q - q) / self.error_at_stand)
        if error > 0.5:
            status |= TorqueStatus.TRACKING
            wanted = min(wanted, max(0.0, 2.0 - 2.0 * float(error)))
        bears, asked, state = self._felt(state, usable)
        lost = state.off * dt >= self.settings.lost
        state = state._replace(spare=_passed_on(state.spare, lost, dt))
        if lost.any():
            status |= TorqueStatus.CONTACT_LOST
            wanted = 0.0
        if state.over * dt >= self.settings.overload:
            status |= TorqueStatus.OVERLOADED
            wanted = min(wanted, _OVERLOADED)
        share = stride(state.share, wanted, dt, self.settings.ramp)
        pace = pace_of(share)
        if pace < 1.0:
            status |= TorqueStatus.SLOWED if pace > 0.0 else TorqueStatus.HELD
        seeks = (state.off * dt >= self.settings.lost + _PATIENCE) & readings.good_force
        view = View(usable, pace, bears, asked, seeks, state.spare, status)
        return view, state._replace(share=share)

    def done(self, state: WatchState, goal: Goal, status: TorqueStatus) -> WatchState:
        """The state after the second stage's tick, which had a goal and a status."""
        over = state.over + 1 if status & TorqueStatus.SATURATED else 0
        return state._replace(over=over, mode=goal.mode, plan=goal.force, normals=goal.normals)

    def _timed(
        self, state: WatchState, measured: Measurement, dt: float
    ) -> tuple[WatchState, TorqueStatus]:
        """Whether the measurement comes in time and in order; only where it has a stamp."""
        told = given(measured, "stamp")
        if told is None:
            return state._replace(late=0), TorqueStatus.OK
        stamp = _number(told)
        if not np.isfinite(stamp):
            return state, TorqueStatus.BAD_MEASUREMENT
        passed = stamp - state.stamp
        status = TorqueStatus.OK
        if passed <= 0.0:
            status = TorqueStatus.STALE
        elif passed > _LATE * dt:
            status = TorqueStatus.LATE
        late = state.late + 1 if status else 0
        return state._replace(stamp=stamp, late=late), status

    def _felt(
        self, state: WatchState, measured: Measurement
    ) -> tuple[BoolArray | None, BoolArray, WatchState]:
        """Who is felt, who was planned to press a tick ago, and for how long who was not felt."""
        good = state.readings.good_force
        sensed = state.sensed | good
        force = state.plan if measured.force is None else measured.force
        inward = -state.normals
        planned = np.einsum("ir,ir->i", inward, state.plan)
        touches = np.einsum("ir,ir->i", inward, force) >= _FELT
        asked = (state.mode != ContactMode.FREE) & (planned >= PRESSING)
        # a reading that cannot be used neither finds a contact nor loses it
        off = np.where(asked & ~(touches & good), state.off + (good & ~touches), 0)
        state = state._replace(off=off, sensed=sensed)
        return (touches & good) | ~sensed if sensed.any() else None, asked, state


def _passed_on(spare: Array, lost: BoolArray, dt: float) -> Array:
    """How far fingers (N,) are left out of the planned forces a tick later, without a step."""
    taken, given = np.minimum(1.0, spare + dt / _TAKEN), np.maximum(0.0, spare - dt / _GIVEN)
    return np.where(lost, taken, given)


def _number(value: Any) -> float:
    """A time as a driver hands it over; NaN where it is no real number."""
    try:
        return float(value) if isinstance(value, Real) else np.nan
    except Exception:  # an object may raise anything when it is read
        return np.nan
