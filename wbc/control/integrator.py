"""One tick of the references: Euler's rule, or the classical Runge-Kutta rule of fourth order."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.grasp import ContactState
from wbc.control.law import Motion, moved
from wbc.rotations import dexp_inverse
from wbc.stack.limits import NOT_LIMITED, Limited, speed_shares

Evaluate = Callable[[Array, ContactState, float, Array], Motion]
"""The law at (q, contact, time, gains of the levels)."""


@kernel
def _flatten_turns(step: Array, rates: Array, first: int) -> None:
    """Turning rates at a stage, carried back to rates of the rotation vector from the tick's start.

    Rotations do not add; their vectors do, to the order the rule needs (Munthe-Kaas).
    """
    for k in range(first, step.shape[0], 3):
        rates[k : k + 3] = dexp_inverse(step[k : k + 3], rates[k : k + 3])


def runge_kutta(
    first: Motion,
    evaluate: Evaluate,
    q: Array,
    contact: ContactState,
    t: float,
    dt: float,
    gains: Sequence[Array],
    velocity: Array,
) -> tuple[Motion, Limited]:
    """Mean velocity of q̃ over [t, t + dt] to fourth order.

    Each stage is held to the velocity limits: otherwise the next would be evaluated where the robot
    cannot be, and the mean would no longer do what the main task asks.

    Args:
        first: the law at t.
        gains: gains of the levels at t + dt/2 and at t + dt.
        velocity: (nv,) limits of the joints.

    Returns:
        The motion, and the least that the limits left of it at a stage.
    """
    motion, limited = _reachable(first, velocity, NOT_LIMITED)
    main, total = motion.main / 6.0, motion.total / 6.0
    pivots = len(q) + 2 * len(contact.mode)
    for share, weight, level_gains in (
        (0.5, 1.0 / 3.0, gains[0]),
        (0.5, 1.0 / 3.0, gains[0]),
        (1.0, 1.0 / 6.0, gains[1]),
    ):
        step = motion.total * (share * dt)
        stage_q, stage_contact = moved(q, contact, motion.total, share * dt)
        stage = evaluate(stage_q, stage_contact, t + share * dt, level_gains)
        motion, limited = _reachable(stage, velocity, limited)
        _flatten_turns(step, motion.main, pivots)
        _flatten_turns(step, motion.total, pivots)
        main = main + weight * motion.main
        total = total + weight * motion.total
    return Motion(main, total), limited


def _reachable(motion: Motion, velocity: Array, so_far: Limited) -> tuple[Motion, Limited]:
    """The motion less what no joint can do, of the secondary part first; the least shares so far."""
    main, secondary, joint = speed_shares(motion.main, motion.total, velocity)
    if joint < 0:
        return motion, so_far
    kept = main * motion.main
    limited = so_far._replace(
        main=min(main, so_far.main), secondary=min(secondary, so_far.secondary), joint=joint
    )
    return Motion(kept, kept + secondary * (motion.total - motion.main)), limited
