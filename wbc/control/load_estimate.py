"""What the fingers carry, as the forces measured at their tips say: a mass and a centre of mass.

While nothing else bears the object, Newton and Euler for it are the sums of the tip forces and of
their moments. The force gives the mass exactly, wherever the contacts are. The moment is only as
good as the contact points believed, and forces planned for a moment that is partly an error of
them press harder, which makes the error larger: so it goes into a shift of the centre of mass
that is bounded. Each sample is explained by the reference's acceleration, and smoothed by time,
not by ticks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.control.numbers import numbers
from wbc.control.payload import Body
from wbc.rotations import cross

_HUGE = 1e9
_FALLING = 1.0  # m/s²: an object that is borne with less says too little about its mass


class LoadState(NamedTuple):
    """What the estimate carries from tick to tick: how the object differs from the one believed.

    Attributes:
        mass: beyond the believed one [kg].
        shift: (3,) of the centre of mass, in the object's axes [m].
    """

    mass: float
    shift: Array


@kernel
def _about(mass: float, r: Array, out: Array, sign: float) -> None:
    """Add sign times the inertia of a point mass at r to out, (3, 3)."""
    square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    for i in range(3):
        for j in range(3):
            out[i, j] -= sign * mass * r[i] * r[j]
        out[i, i] += sign * mass * square


@kernel
def _sampled(
    force: Array, arm: Array, rotation: Array, mass: float, com: Array, inertia: Array,
    least: float, most: float, gravity: Array, twist: Array, acceleration: Array, found: Array,
) -> float:  # fmt: skip
    """The mass within bounds, and in `found` (3,) the centre of mass, that explain one sample.

    The moment says nothing about the centre along the push on it: there it stays where it was.

    Returns:
        The mass; NaN where the sample is no number or the object all but falls.
    """
    total, moment = np.zeros(3), np.zeros(3)
    for i in range(force.shape[0]):
        total += force[i]
        moment += cross(arm[i], force[i])
    w, turning, push = twist[3:], acceleration[3:], acceleration[:3] - gravity
    center = rotation @ com
    borne = push + cross(turning, center) + cross(w, cross(w, center))
    weight, square = np.sum(borne * borne), np.sum(push * push)
    sound = np.abs(total).max() < _HUGE and np.abs(moment).max() < _HUGE
    if not sound or not min(weight, square) > _FALLING * _FALLING:
        return np.nan
    seen = min(max(np.sum(total * borne) / weight, least), most)
    spin = rotation @ inertia @ rotation.T
    moment -= seen / mass * (spin @ turning + cross(w, spin @ w))
    across = cross(push, moment) / (seen * square)
    along = np.sum(push * center) / square
    found[:] = rotation.T @ (across + along * push)
    return seen


@final
@dataclass(frozen=True)
class LoadEstimate:
    """How mass and centre of mass are estimated.

    Attributes:
        phase: index of the phase from which on fingers alone bear the object.
        smoothing: time constant [s].
        least, most: bounds of the mass, as shares of the believed one.
        shift: largest distance of the centre of mass from where it is believed [m].
    """

    phase: int
    smoothing: float
    least: float
    most: float
    shift: float

    def init(self) -> LoadState:
        """Before the first sample: the object is as believed."""
        return LoadState(0.0, np.zeros(3))

    def body(self, believed: Body, state: LoadState) -> Body:
        """The object with the estimate: its inertia about its centre of mass goes with its mass."""
        mass, com = believed.mass + state.mass, believed.com + state.shift
        inertia = np.array(believed.inertia)
        _about(believed.mass, believed.com, inertia, -1.0)
        inertia *= mass / believed.mass
        _about(mass, com, inertia, 1.0)
        return Body(mass, com, inertia)

    def updated(
        self, state: LoadState, believed: Body, force: Array | None, arm: Array, rotation: Array,
        twist: Array, acceleration: Array, gravity: Array, dt: float,
    ) -> LoadState:  # fmt: skip
        """The state after a sample; the same where it is missing or says nothing.

        Args:
            force: (N, 3) measured, of all fingertips on the object, world axes [N].
            arm: (N, 3) contact points believed, from the object's origin, world axes [m].
            rotation: (3, 3) of the object.
            twist, acceleration, gravity: as in `wrench_to_supply`.
            dt: [s] since the sample before.
        """
        tips = numbers(force, arm.shape)
        if tips is None or not dt > 0.0:
            return state
        now, com = self.body(believed, state), np.empty(3)
        mass = _sampled(
            tips, arm, rotation, *now, self.least * believed.mass, self.most * believed.mass,
            gravity, twist, acceleration, com,
        )  # fmt: skip
        if not math.isfinite(mass):
            return state
        share = 1.0 - math.exp(-dt / self.smoothing)
        shift = state.shift + share * (com - now.com)
        size = math.sqrt(shift @ shift)
        if size > self.shift:
            shift *= self.shift / size
        extra = state.mass + share * (mass - now.mass)
        low, high = self.least - 1.0, self.most - 1.0
        return LoadState(min(max(extra, low * believed.mass), high * believed.mass), shift)
