"""Which of a robot's readings can be used, sensor by sensor, and what stands in for the others."""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.control.force_control import TorqueStatus
from wbc.control.numbers import reading
from wbc.control.state import Measurement

_BEYOND = 1.0  # [rad] or [m] that a reading may be beyond a joint's limits
_FAST = 10.0  # times its velocity limit that a joint may seem to move, and at least 10 rad/s
_STEP = 0.05  # [rad] or [m] that a reading may jump, beside what the joint could have moved
_REACH = 5.0  # times its velocity limit with which a joint could have moved
_STRONG = 1e3  # [N]: no fingertip's force is as large
_HUGE = 1e9  # no reading is as large, in SI units
_FADING = 0.8  # part of what was last off that is left a tick later, of a sensor that is blind
_NEWER = 0.2  # weight of the last difference in a velocity made of positions
_MOVED = 3e-3  # [rad] or [m] commanded, from which on a joint's reading must have changed
_CHANGED = 0.1  # [N] planned, from which on a fingertip's must


class ReadingState(NamedTuple):
    """What is known of the sensors from tick to tick.

    Attributes:
        q, v, force: (nv,), (nv,), (N, 3) last readings as they came; NaN where there was none.
        known: (nv,) last positions that could be used.
        off, off_rate: (nv,) what joints were last off their references, and their velocities.
        shown: (N, 3) the forces last taken for measured.
        good_q, good_force: (nv,), (N,) whether the present reading can be used.
        missed: (2 nv + N,) ticks in a row without a usable q, v and force.
        ever: (2 nv + N,) sensors that are there: every joint's position, the others once they gave
            a reading that can be used.
        same: (nv + N,) ticks in a row with the very same reading, of joints and fingertips.
        way: (nv,) commanded since then [rad] or [m]; plan: (N, 3) planned then [N].
    """

    q: Array
    v: Array
    force: Array
    known: Array
    off: Array
    off_rate: Array
    shown: Array
    good_q: BoolArray
    good_force: BoolArray
    missed: IntArray
    ever: BoolArray
    same: IntArray
    way: Array
    plan: Array


@final
class Readings:
    """The sensors of one robot; holds no state between ticks."""

    def __init__(
        self, lower: Array, upper: Array, velocity: Array, count: int, bridged: int, frozen: int
    ) -> None:
        """
        Args:
            lower, upper, velocity: (nv,) limits of the joints; may be inf.
            count: N fingertips.
            bridged, frozen: ticks after which a sensor is blind, or frozen.
        """
        self._lower, self._upper = lower - _BEYOND, upper + _BEYOND
        self._velocity = velocity
        self._fast = _FAST * np.maximum(velocity, 1.0)
        self._count = count
        self._bridged, self._frozen = bridged, frozen

    def init(self) -> ReadingState:
        """Before the first tick."""
        nv, n = len(self._lower), self._count
        none, forces = np.zeros(nv), np.zeros((n, 3))
        return ReadingState(
            np.full(nv, np.nan), np.full(nv, np.nan), np.full((n, 3), np.nan), np.full(nv, np.nan),
            none, none, forces,
            np.ones(nv, dtype=np.bool_), np.ones(n, dtype=np.bool_),
            np.zeros(2 * nv + n, dtype=np.int64), np.arange(2 * nv + n) < nv,
            np.zeros(nv + n, dtype=np.int64), none, forces,
        )  # fmt: skip

    def read(
        self, state: ReadingState, measured: Measurement | None, q: Array, v: Array, plan: Array,
        dt: float,
    ) -> tuple[Measurement, TorqueStatus, ReadingState]:  # fmt: skip
        """A complete, finite measurement: what was given, wherever it can be used.

        Args:
            measured: None: not to be used at all.
            q, v: (nv,) references of the joints.
            plan: (N, 3) planned forces [N].
        """
        nv, n = len(q), self._count
        raw_q, raw_v, raw_force = (
            _shaped(measured, name, shape)
            for name, shape in (("q", (nv,)), ("v", (nv,)), ("force", (n, 3)))
        )
        state, stuck = self._repeated(state, raw_q, raw_v, raw_force, v, plan, dt)
        good_q, good_v = self._sound(state, raw_q, raw_v, dt)
        good_q &= ~stuck[:nv]
        good_v &= ~stuck[:nv]
        good_force = (np.abs(raw_force) < _STRONG).all(axis=1) & ~stuck[nv:]
        status = TorqueStatus.FROZEN if stuck.any() else TorqueStatus.OK
        good = np.concatenate([good_q, good_v, good_force])
        missed = np.where(good, 0, state.missed + 1)
        ever = state.ever | good
        before = state
        state = state._replace(
            q=raw_q, v=raw_v, force=raw_force, known=np.where(good_q, raw_q, state.known),
            good_q=good_q, good_force=good_force, missed=missed, ever=ever,
        )  # fmt: skip
        if good.all():
            state = state._replace(off=raw_q - q, off_rate=raw_v - v, shown=raw_force)
            return Measurement(raw_q, raw_v, raw_force), status, state
        blind = (missed > self._bridged) & ever
        status |= TorqueStatus.BAD_MEASUREMENT
        if blind.any():
            status |= TorqueStatus.BLIND
        fade = np.where(blind, _FADING, 1.0)
        # a velocity that is missing, out of two positions; a position, out of the velocity
        two = good_q & (before.missed[:nv] == 0) & np.isfinite(before.known)
        slope = np.where(two, raw_q - before.known, 0.0) / dt - v
        rate = np.where(
            two, state.off_rate + _NEWER * (slope - state.off_rate),
            fade[nv : 2 * nv] * state.off_rate,
        )  # fmt: skip
        rate = np.where(good_v, np.where(good_v, raw_v, v) - v, rate)
        off = np.where(good_v, state.off + dt * rate, fade[:nv] * state.off)
        off = np.where(good_q, np.where(good_q, raw_q, q) - q, self._within(q, off))
        shown = np.where(good_force[:, None], raw_force, state.shown)
        gone = (blind | ~ever)[2 * nv :, None]  # as planned: nothing to correct
        shown = np.where(gone & ~good_force[:, None], plan, shown)
        found = Measurement(q + off, v + rate, shown)
        return found, status, state._replace(off=off, off_rate=rate, shown=shown)

    def _within(self, q: Array, off: Array) -> Array:
        """What joints are off (nv,), where only velocities tell: those may be wrong by a constant,
        and the integral would go on for ever."""
        low = np.minimum(self._lower + _BEYOND, q)
        high = np.maximum(self._upper - _BEYOND, q)
        return np.clip(np.clip(q + off, low, high) - q, -_BEYOND, _BEYOND)

    def _sound(
        self, state: ReadingState, q: Array, v: Array, dt: float
    ) -> tuple[BoolArray, BoolArray]:
        """Whether positions and velocities can be a robot's, (nv,) each."""
        good_q = (q >= self._lower) & (q <= self._upper)
        ticks = 1.0 + state.missed[: len(q)]  # since it was last known
        jumped = np.abs(q - state.known) > _STEP + _REACH * dt * ticks * self._velocity
        return good_q & ~jumped, np.abs(v) <= self._fast

    def _repeated(
        self, state: ReadingState, q: Array, v: Array, force: Array, rate: Array, plan: Array,
        dt: float,
    ) -> tuple[ReadingState, BoolArray]:  # fmt: skip
        """(nv + N,) sensors that say the very same while something is commanded."""
        joints = (q == state.q) & ((v == state.v) | ~state.ever[len(q) : 2 * len(q)])
        tips = (force == state.force).all(axis=1) & (force != 0.0).any(axis=1)
        repeated = np.concatenate([joints, tips])
        same = np.where(repeated, state.same + 1, 0)
        way = np.where(joints, state.way + dt * np.abs(rate), 0.0)
        then = np.where(tips[:, None], state.plan, plan)
        changed = np.abs(plan - then).max(axis=1, initial=0.0) >= _CHANGED
        stuck = (same >= self._frozen) & np.concatenate([way >= _MOVED, changed])
        return state._replace(same=same, way=way, plan=then), stuck


def _shaped(measured: Measurement | None, name: str, shape: tuple[int, ...]) -> Array:
    """Readings of a shape, copied; NaN where they are missing, of another size or no numbers."""
    found = reading(measured, name, shape)
    if found is None:
        return np.full(shape, np.nan)
    sound = np.abs(found) < _HUGE
    return found if sound.all() else np.where(sound, found, np.nan)
