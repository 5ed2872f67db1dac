"""What the limits take off a motion, taken off where the object does not feel it."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.contact.grasp import ContactState, ObjectReference
from wbc.control.law import Law, Motion, moved
from wbc.stack.limits import NOT_LIMITED, Limited, limit_from, velocity_bounds
from wbc.stack.projection import solve_main


def keeping_the_main_task(
    law: Law, q: Array, contact: ContactState, rates: Array, motion: Motion,
    reference: ObjectReference, limits: tuple[Array, Array, Array, Array], dt: float,
) -> tuple[Array, Limited]:  # fmt: skip
    """The limit filter on a motion that does not fit, correcting in the main task's null space.

    A command on the line from the last one to the wanted one fulfils the main task only if its rows
    stay as they are, and they turn within a tick: where that line is cut short the object would pay
    with an error of the first order. So the way goes first to the velocity nearest to the last one
    that does what the main task asks of this tick, then on to the wanted one. The null space is
    that half-way between the motion wanted and the one that is left, hence two rounds.

    Args:
        law: its kinematics are overwritten.
        q, contact: at the start of the tick.
        rates: (nv + 5N,) the last command with the rates of the contact variables.
        motion: wanted over the tick.
        reference: the object's at the end of the tick.
        limits: of `velocity_bounds`: lower, upper, velocity, acceleration.

    Returns:
        The velocity of q̃ and what was done to it.
    """
    nv = len(q)
    low, high, command = np.empty(nv), np.empty(nv), np.empty(nv)
    velocity_bounds(q, *limits, dt, low, high)
    total, last = motion.total, rates[:nv]
    step, limited = total, NOT_LIMITED
    for _ in range(2):
        law.kin.update(*moved(q, contact, 0.5 * (total + step), dt), reference)
        main = total + free_part(law, motion.main[:nv] - total[:nv])
        anchor = total + free_part(law, last - total[:nv])
        secondary, speed, change, clipped, joint, kept = limit_from(
            anchor[:nv], main[:nv], total[:nv], last, low, high, limits[3], dt, command
        )
        limited = Limited(secondary, min(speed, kept), change, clipped, joint)
        # the contact variables keep step with the joints: the same shares of the same motions
        wanted = speed * main + secondary * (total - main)
        step = rates + kept * (anchor - rates) + change * (wanted - anchor)
        step[:nv] = command
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
