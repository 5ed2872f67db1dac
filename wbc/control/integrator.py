"""One tick of the references: Euler's rule, or the classical Runge-Kutta rule of fourth order."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.grasp import ContactState
from wbc.control.law import Motion, moved
from wbc.rotations import dexp_inverse
from wbc.stack.limits import speed_shares

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
) -> tuple[Motion, tuple[float, float]]:
    """Mean velocity of q̃ over [t, t + dt] to fourth order.

    Args:
        first: the law at t.
        gains: gains of the levels at t + dt/2 and at t + dt.
        velocity: (nv,) limits of the joints; what a stage wants beyond them the filter will take
            off anyway, and the next stage is not evaluated where the robot cannot be.

    Returns:
        The mean, and the least shares of the main and of the secondary motion that the limits left
        of any stage.
    """
    motion, least = _reachable(first, velocity)
    main, total = motion.main / 6.0, motion.total / 6.0
    pivots = len(q) + 2 * len(contact.mode)
    for share, weight, level_gains in (
        (0.5, 1.0 / 3.0, gains[0]),
        (0.5, 1.0 / 3.0, gains[0]),
        (1.0, 1.0 / 6.0, gains[1]),
    ):
        step = motion.total * (share * dt)
        stage_q, stage_contact = moved(q, contact, motion.total, share * dt)
        wanted = evaluate(stage_q, stage_contact, t + share * dt, level_gains)
        motion, shares = _reachable(wanted, velocity)
        least = min(least[0], shares[0]), min(least[1], shares[1])
        _flatten_turns(step, motion.main, pivots)
        _flatten_turns(step, motion.total, pivots)
        main = main + weight * motion.main
        total = total + weight * motion.total
    return Motion(main, total), least


def _reachable(motion: Motion, velocity: Array) -> tuple[Motion, tuple[float, float]]:
    """The motion less what no joint can do, of the secondary part first; the shares kept."""
    main, secondary = speed_shares(motion.main, motion.total, velocity)
    if main == 1.0 and secondary == 1.0:
        return motion, (1.0, 1.0)
    kept = main * motion.main
    return Motion(kept, kept + secondary * (motion.total - motion.main)), (main, secondary)
