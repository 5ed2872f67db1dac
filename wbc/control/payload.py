"""What the fingers have to carry: the object, and the water in it, whose surface stays level."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.control.references import minimum_jerk
from wbc.errors import WbcError
from wbc.rotations import cross

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_STEPS = 60
_LEAST = 1e-6  # part of the room from which on the water's form is computed


@kernel
def _below(
    radius: float, half: float, sine: float, cosine: float, d: float, nodes: Array, weights: Array,
    out: Array,
) -> float:  # fmt: skip
    """Moments of the part x sine + z cosine <= d of a cylinder about z; area of its surface.

    A slice across the axis is a segment x <= s(z), or whole, or empty. Over the heights where it is
    a segment s = -r cos a is the variable: what is integrated are then polynomials in sin a and
    cos a, and the quadrature is exact to rounding.

    Args:
        cosine: positive, as is sine.
        out: (7,) integrals of 1, x, z, x², y², z², xz.
    """
    whole = min(max((d - radius * sine) / cosine, -half), half)
    empty = min(max((d + radius * sine) / cosine, -half), half)
    disc, length = np.pi * radius * radius, whole + half
    out[0], out[1], out[2] = disc * length, 0.0, 0.5 * disc * (whole - half) * length
    out[3] = out[4] = 0.25 * disc * radius * radius * length
    out[5], out[6] = disc * (whole**3 + half**3) / 3.0, 0.0
    first, last = 0.0, np.pi
    if whole == -half:
        last = np.arccos(min(max(-(d + half * cosine) / (sine * radius), -1.0), 1.0))
    if empty == half:
        first = np.arccos(min(max(-(d - half * cosine) / (sine * radius), -1.0), 1.0))
    surface, reach = 0.0, 0.5 * (last - first)
    if whole == half or empty == -half or not reach > 0.0:
        return surface
    for k in range(nodes.shape[0]):
        a = 0.5 * (first + last) + reach * nodes[k]
        sin, cos = np.sin(a), np.cos(a)
        z = (d + radius * cos * sine) / cosine
        w = weights[k] * reach * radius * sin / cosine
        surface += 2.0 * radius * sin * w
        w *= sine
        area = radius**2 * (a - sin * cos)
        moment = -2.0 / 3.0 * (radius * sin) ** 3
        out[0] += w * area
        out[1] += w * moment
        out[2] += w * area * z
        out[3] += w * radius**4 * 0.25 * (a - sin * cos * (2.0 * cos * cos - 1.0))
        out[4] += w * radius**4 * 0.25 * (a - sin * cos * (1.0 + 2.0 / 3.0 * sin * sin))
        out[5] += w * area * z * z
        out[6] += w * moment * z
    return surface


@kernel
def level_water(
    radius: float, half: float, fill: float, up: Array, nodes: Array, weights: Array,
    com: Array, second: Array,
) -> None:  # fmt: skip
    """Water at rest in a cylinder: its centre and its second moments per volume.

    The surface is the plane across `up` that has the water's volume below it. The volume below
    grows with its height by the area of the surface, so Newton's rule finds the plane; a bracket
    keeps it from overshooting.

    Args:
        radius, half: of the room inside, and half its length, [m].
        fill: part of the room that is full, in (0, 1).
        up: (3,) against gravity, unit, in the room's axes.
        com: (3,) filled with the centre, from the room's centre, [m].
        second: (3, 3) filled with ∫ r rᵀ dV / V about the room's centre, [m²].
    """
    flat = np.sqrt(up[0] * up[0] + up[1] * up[1])
    ex, ey = (up[0] / flat, up[1] / flat) if flat > 0.0 else (1.0, 0.0)
    side = 1.0 if up[2] >= 0.0 else -1.0
    sine, cosine = max(flat, 1e-9), max(abs(up[2]), 1e-6)  # less is not seen, and divided by
    top = half * cosine + radius * sine
    low, high, d = -top, top, (2.0 * fill - 1.0) * top
    volume = fill * 2.0 * half * np.pi * radius * radius
    m = np.empty(7)
    for _ in range(_STEPS):
        surface = _below(radius, half, sine, cosine, d, nodes, weights, m)
        excess = m[0] - volume
        if excess > 0.0:
            high = d
        else:
            low = d
        step = d - excess / surface if surface > 0.0 else low
        last, d = d, step if low < step < high else 0.5 * (low + high)
        if abs(d - last) <= 1e-15 * top:
            break
    v = m[0]
    com[0], com[1], com[2] = ex * m[1] / v, ey * m[1] / v, side * m[2] / v
    xx, yy, xz = m[3] / v, m[4] / v, side * m[6] / v
    second[0, 0] = ex * ex * xx + ey * ey * yy
    second[1, 1] = ey * ey * xx + ex * ex * yy
    second[0, 1] = second[1, 0] = ex * ey * (xx - yy)
    second[0, 2] = second[2, 0] = ex * xz
    second[1, 2] = second[2, 1] = ey * xz
    second[2, 2] = m[5] / v


@kernel
def _inertia(mass: float, center: Array, com: Array, second: Array, out: Array) -> None:
    """Moments of inertia, (3, 3), about the point from which the room's centre is at `center`.

    Args:
        com, second: as `level_water` gives them.
    """
    for i in range(3):
        for j in range(3):
            a, b = center[i], center[j]
            out[i, j] = -mass * (second[i, j] + a * com[j] + com[i] * b + a * b)
    trace = out[0, 0] + out[1, 1] + out[2, 2]
    for i in range(3):
        out[i, i] -= trace


@kernel
def _supplied(
    rotation: Array, mass: float, com: Array, inertia: Array, gravity: Array, twist: Array,
    acceleration: Array, out: Array, arm: Array,
) -> None:  # fmt: skip
    """Newton and Euler about the object's origin, which moves; all in the world's axes."""
    arm[:] = rotation @ com
    spin = rotation @ inertia @ rotation.T
    w, turning = twist[3:], acceleration[3:]
    push = acceleration[:3] - gravity
    out[:3] = mass * (push + cross(turning, arm) + cross(w, cross(w, arm)))
    out[3:] = mass * cross(arm, push) + spin @ turning + cross(w, spin @ w)


class Body(NamedTuple):
    """A rigid body, in the object's axes.

    Attributes:
        mass: [kg].
        com: (3,) centre of mass [m].
        inertia: (3, 3) about the object's origin [kg m²].
    """

    mass: float
    com: Array
    inertia: Array


@final
@dataclass(frozen=True)
class Water:
    """Water in a cylindrical room about the object's z axis.

    It is taken to be at rest in the object at each instant (quasi-static): its surface is level,
    whatever the acceleration, it turns with the object like a rigid body, and the momentum that it
    has by moving in the object, or takes along when it leaves, is left out.

    Attributes:
        mass: at the start [kg].
        radius, length: of the room [m].
        center: (3,) of the room, in the object's axes [m].
        density: [kg/m³].
        pours: index of the phase in which it leaves; -1: it stays.
        left: mass after that phase [kg].
    """

    mass: float
    radius: float
    length: float
    center: Array
    density: float
    pours: int = -1
    left: float = 0.0

    def __post_init__(self) -> None:
        fill = self._fill(self.mass)
        if not 0.0 < fill <= 1.0 + 1e-12:
            raise WbcError(f"{self.mass:g} kg fill the room {fill:.3g} times")

    def _fill(self, mass: float) -> float:
        return mass / (self.density * self.length * math.pi * self.radius**2)

    def mass_at(self, t: float, phase: int, since: float, over: float) -> float:
        """[kg] at time t in a phase that began at `since` with motions of duration `over` [s]."""
        if self.pours < 0 or phase < self.pours:
            return self.mass
        share = minimum_jerk((t - since) / over)[0] if phase == self.pours else 1.0
        return self.mass + share * (self.left - self.mass)

    def body(self, mass: float, up: Array) -> Body:
        """The water as a body when there is `mass` of it and `up` (3,) is up in the object."""
        com, second, inertia = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
        fill = min(max(self._fill(mass), _LEAST), 1.0 - _LEAST)
        level_water(self.radius, 0.5 * self.length, fill, up, _NODES, _WEIGHTS, com, second)
        _inertia(mass, self.center, com, second, inertia)
        return Body(mass, self.center + com, inertia)


@final
@dataclass(frozen=True)
class Payload:
    """The object and what is in it.

    Attributes:
        mass: of the object alone [kg].
        com: (3,) its centre of mass, in its axes [m].
        inertia: (3,) principal moments about its centre of mass, along its axes [kg m²].
        water: what is in it; None: nothing.
    """

    mass: float
    com: Array
    inertia: Array
    water: Water | None = None

    @cached_property
    def alone(self) -> Body:
        """The object without what is in it."""
        r = self.com
        parallel = self.mass * ((r @ r) * np.eye(3) - np.outer(r, r))
        return Body(self.mass, r, np.diag(self.inertia) + parallel)

    def body(self, rotation: Array, gravity: Array, water: float) -> Body:
        """Everything together, turned by `rotation` (3, 3), with `water` left [kg]."""
        alone = self.alone
        if self.water is None:
            return alone
        size = math.sqrt(gravity @ gravity)
        up = -(gravity @ rotation) / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
        inside = self.water.body(water, up)
        mass = alone.mass + water
        com = (alone.mass * alone.com + water * inside.com) / mass
        return Body(mass, com, alone.inertia + inside.inertia)


def wrench_to_supply(
    body: Body, rotation: Array, twist: Array, acceleration: Array, gravity: Array
) -> tuple[Array, Array]:
    """h_e of (1): what the contacts must supply for a motion of the object against gravity.

    Args:
        rotation: (3, 3) of the object in the world.
        twist, acceleration: (6,) of its origin and of its turning, world axes [m/s, rad/s], [m/s²,
            rad/s²].
        gravity: (3,) [m/s²].

    Returns:
        (6,) force [N] and moment about its origin [Nm] in the world's axes, and (3,) the centre of
        mass from that origin, in the world's axes [m].
    """
    wrench, arm = np.empty(6), np.empty(3)
    _supplied(
        rotation, body.mass, body.com, body.inertia, gravity, twist, acceleration, wrench, arm
    )
    return wrench, arm
