"""What the limits take off a motion, taken off where the object does not feel it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.contact.extended_finger import HeldEdge
from wbc.contact.grasp import ContactMode, ContactState, Grasp, ObjectReference
from wbc.control.law import UNLOCKED, Law, Locks, Motion, moved
from wbc.stack.limits import (
    NOT_LIMITED,
    Bounds,
    Limited,
    filtered,
    limit_from,
    stuck,
    velocity_bounds,
)
from wbc.stack.projection import solve_main

_BRAKING = 1.0  # [m/s²] of a tip that slides towards an edge: from 0.1 m/s it stops within 5 mm
_EDGE = 1e-3  # [m] kept from an edge, or a twentieth of the face where it is narrow
_RETURN = 20.0  # [1/s] at which a contact held at a curved edge returns from beyond it


class Guarded(NamedTuple):
    """The coordinates that have position limits in a tick, as the limit filter sees them.

    They are the joints and, while a contact slides on a face with edges, all chart coordinates,
    each finger's along the axes of its `Room` and counted from where it is.

    Attributes:
        position: (nv,) or (nv + 2N,).
        bounds: of the same size.
        axes: (N, 2, 2) of each finger's ξ; None where only the joints are guarded.
    """

    position: Array
    bounds: Bounds
    axes: Array | None

    def rates(self, motion: Array) -> Array:
        """Velocities of the guarded coordinates in a velocity of q̃."""
        out: Array = motion[: len(self.position)]
        if self.axes is None:
            return out
        out, first = out.copy(), len(out) - 2 * len(self.axes)
        out[first:] = np.einsum("nij,nj->ni", self.axes, out[first:].reshape(-1, 2)).ravel()
        return out

    def put(self, rates: Array, motion: Array) -> None:
        """Write velocities of the guarded coordinates into a velocity of q̃."""
        n = len(self.position)
        motion[:n] = rates
        if self.axes is not None:
            first = n - 2 * len(self.axes)
            along = np.einsum("nji,nj->ni", self.axes, rates[first:].reshape(-1, 2))
            motion[first:n] = along.ravel()

    def stop(self, v: Array, dt: float, free: Array, held: Array) -> bool:
        """Find what v, of the guarded coordinates, would drive on against a limit.

        A joint stops at its limit; a contact is slowed already while it brakes towards an edge: its
        speed is what the edge allows, and the motion along the edge is not slowed with it.

        Args:
            free: (nv,) set to 0 for joints that are to stand still.
            held: (2N,) or (0,) set to the rate of the chart coordinates that are to have one, NaN
                for the others.

        Returns:
            Whether something was found that was free before.
        """
        nv = len(free)
        lower, upper, velocity, _, braking = self.bounds
        # `stuck` looks at as many as there are in free: the joints
        found: bool = stuck(self.position, v, lower, upper, velocity, braking, dt, free)
        if self.axes is not None:
            low, high = (speed[nv:] for speed in self.speeds(dt))
            beyond = np.maximum(self.bounds.lower[nv:], 0.0) + np.minimum(self.bounds.upper[nv:], 0)
            for bound, over in ((high, v[nv:] > high), (low, v[nv:] < low)):
                new = over & np.isnan(held)
                held[new] = (bound + _RETURN * beyond)[new]
                found |= bool(new.any())
        return found

    def speeds(self, dt: float) -> tuple[Array, Array]:
        """Least and largest velocities of the next tick."""
        low, high = np.empty_like(self.position), np.empty_like(self.position)
        lower, upper, velocity, _, braking = self.bounds
        velocity_bounds(self.position, lower, upper, velocity, braking, dt, low, high)
        return low, high

    def locks(self, free: Array, held: Array) -> Locks:
        """What `stop` has found, for the law."""
        edges = []
        if self.axes is not None:
            for k in np.flatnonzero(~np.isnan(held)).tolist():
                finger, axis = divmod(k, 2)
                edges.append(HeldEdge(finger, self.axes[finger, axis], float(held[k])))
        return Locks(None if free.all() else free, tuple(edges))


def guarded(q: Array, contact: ContactState, grasp: Grasp, joints: Bounds) -> Guarded:
    """What is to be kept within limits at a configuration; `joints` are the robot's."""
    if not grasp.surface.edged or not (contact.mode == ContactMode.SLIDING).any():
        return Guarded(q, joints, None)
    n, sliding = grasp.count, contact.mode == ContactMode.SLIDING
    axes = np.tile(np.eye(2), (n, 1, 1))
    back, ahead = np.full((n, 2), np.inf), np.full((n, 2), np.inf)
    for i in np.flatnonzero(sliding).tolist():
        axes[i], back[i], ahead[i] = grasp.surface.room(contact.xi[i], int(contact.face[i]))
    kept = np.minimum(_EDGE, 0.05 * (back + ahead))
    endless = np.full(2 * n, np.inf)
    bounds = Bounds(
        np.concatenate([joints.lower, (kept - back).ravel()]),
        np.concatenate([joints.upper, (ahead - kept).ravel()]),
        np.concatenate([joints.velocity, endless]),
        np.concatenate([joints.acceleration, endless]),
        np.concatenate([joints.braking, np.full(2 * n, _BRAKING)]),
    )
    return Guarded(np.concatenate([q, np.zeros(2 * n)]), bounds, axes)


def solved(
    law: Law, order: IntArray, levels: Array, here: Guarded, dt: float
) -> tuple[Motion, Locks]:
    """The law as last evaluated; what it would drive into a limit it stands at is locked."""
    motion, locks = law.solve(order, levels), UNLOCKED
    nv, n = law.kin.robot.model.nv, len(here.position)
    free, held = np.ones(nv), np.full(n - nv, np.nan)
    for _ in range(n):  # what is left may reach limits in turn
        if not here.stop(here.rates(motion.total), dt, free, held):
            break
        locks = here.locks(free, held)
        motion = law.solve(order, levels, locks)
    return motion, locks


def within_limits(
    law: Law, q: Array, contact: ContactState, rates: Array, motion: Motion, here: Guarded,
    locks: Locks, reference: Callable[[], ObjectReference] | None, dt: float,
) -> tuple[Array, Limited]:  # fmt: skip
    """A motion as far as the limits let it.

    Args:
        law: its kinematics may be overwritten.
        q, contact: at the start of the tick.
        rates: (nv + 5N,) the last command with the rates of the contact variables.
        motion: wanted over the tick.
        here, locks: limits at the start of the tick, and what they have locked.
        reference: gives the object's at the end of the tick; None: the robot brakes, along the
            straight line to rest.

    Returns:
        The velocity of q̃ and what was done to it.
    """
    main, total, last = here.rates(motion.main), here.rates(motion.total), here.rates(rates)
    command, shares = filtered(here.position, main, total, last, *here.bounds, dt)
    limited = Limited(*shares)
    if limited == NOT_LIMITED:
        return motion.total, limited
    if reference is None:
        step = (1.0 - limited.change) * rates
        here.put(command, step)
    else:
        step, limited = _keeping_the_main_task(
            law, q, contact, rates, motion, here, locks, reference(), dt
        )
    return step, limited if limited.joint < len(q) else limited._replace(joint=-1)


def _keeping_the_main_task(
    law: Law, q: Array, contact: ContactState, rates: Array, motion: Motion, here: Guarded,
    locks: Locks, reference: ObjectReference, dt: float,
) -> tuple[Array, Limited]:  # fmt: skip
    """The limit filter on a motion that does not fit, correcting in the main task's null space.

    A command on the line from the last one to the wanted one fulfils the main task only if its rows
    stay as they are, and they turn within a tick: where that line is cut short the object would pay
    with an error of the first order. So the way goes first to the velocity nearest to the last one
    that does what the main task asks of this tick, then on to the wanted one. The null space is
    that half-way between the motion wanted and the one that is left, hence two rounds.
    """
    nv, n = len(q), len(here.position)
    command, (low, high) = np.empty(n), here.speeds(dt)
    total, last = motion.total, here.rates(rates)
    step, limited = total, NOT_LIMITED
    for _ in range(2):
        law.kin.update(*moved(q, contact, 0.5 * (total + step), dt), reference)
        law.kin.hold(locks.edges)
        main = total + free_part(law, motion.main[:nv] - total[:nv])
        anchor = total + free_part(law, rates[:nv] - total[:nv])
        secondary, speed, change, clipped, joint, kept = limit_from(
            here.rates(anchor), here.rates(main), here.rates(total), last, low, high,
            here.bounds.acceleration, dt, command,
        )  # fmt: skip
        limited = Limited(secondary, min(speed, kept), change, clipped, joint)
        # the contact variables keep step with the joints: the same shares of the same motions
        wanted = speed * main + secondary * (total - main)
        step = rates + kept * (anchor - rates) + change * (wanted - anchor)
        here.put(command, step)
    return step, limited


def free_part(law: Law, v: Array) -> Array:
    """(nv + 5N,) the part of joint velocities v that leaves the object where it is."""
    kin, scale = law.kin, law.stack.scale
    rows = kin.rows[: kin.row_count] * scale
    basis = np.zeros(rows.shape)
    rank, _ = solve_main(rows, np.zeros(len(rows)), basis, np.zeros(len(v)))
    free = v / scale
    for _ in range(2):
        free -= (basis[:rank] @ free) @ basis[:rank]
    at_rest, moving = kin.extend(np.zeros(len(v)), free * scale)
    motion: Array = moving - at_rest
    return motion


def finite(motion: Motion) -> bool:
    """Whether a motion holds numbers only."""
    return math.isfinite(motion.total.sum() + motion.main.sum())
