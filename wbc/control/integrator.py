"""One tick of the references: Euler's rule, or the classical Runge-Kutta rule of fourth order."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.grasp import ContactState
from wbc.control.law import Motion, moved
from wbc.rotations import dexp_inverse

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
) -> Motion:
    """Mean velocity of q̃ over [t, t + dt] to fourth order.

    Args:
        first: the law at t.
        gains: gains of the levels at t + dt/2 and at t + dt.
    """
    main, total = first.main / 6.0, first.total / 6.0
    pivots = len(q) + 2 * len(contact.mode)
    k = first.total
    for share, weight, level_gains in (
        (0.5, 1.0 / 3.0, gains[0]),
        (0.5, 1.0 / 3.0, gains[0]),
        (1.0, 1.0 / 6.0, gains[1]),
    ):
        step = k * (share * dt)
        stage_q, stage_contact = moved(q, contact, k, share * dt)
        stage = evaluate(stage_q, stage_contact, t + share * dt, level_gains)
        _flatten_turns(step, stage.main, pivots)
        _flatten_turns(step, stage.total, pivots)
        k = stage.total
        main = main + weight * stage.main
        total = total + weight * k
    return Motion(main, total)
