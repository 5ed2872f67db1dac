"""Tasks that change place: between contact and tip as a phase begins, in a new order of all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.contact.grasp import ContactMode, ContactState
from wbc.control.phases import Phase
from wbc.control.state import ControllerState
from wbc.stack.activation import Activation

_OUT = 1e-4
"""Gain below which a task has faded out."""


def handed_over(
    state: ControllerState, contact: ContactState, phase: Phase, tips: Sequence[int]
) -> ControllerState:
    """A new phase: rows pass between the main task and the tips without a step.

    A finger that leaves had its tip held by the contact's rows: its tip task takes over now,
    starting at rest. A tip that touches and pivots is held by the contact's rows from now on;
    one that may slide keeps its tip task, which fades.

    Args:
        contact: in the phase that begins.
        tips: (N,) indices of the tip tasks.
    """
    rho, lag = state.activation.rho.copy(), state.activation.lag.copy()
    for i, k in enumerate(tips):
        before, now = state.contact.mode[i], contact.mode[i]
        if before != ContactMode.FREE and now == ContactMode.FREE:
            rho[k] = lag[k] = float(phase.wanted[k])
        elif before == ContactMode.FREE and now == ContactMode.FIXED:
            rho[k] = lag[k] = 0.0
    stack = state.stack._replace(wanted=phase.wanted.copy())
    return state._replace(contact=contact, activation=Activation(rho, lag), stack=stack)


def moving(state: ControllerState, count: int) -> BoolArray:
    """(M,) tasks that must be out before the next order can be taken; M is `count`."""
    out = np.zeros(count, dtype=np.bool_)
    if state.next_order is not None:
        now = {k: place for place, k in enumerate(state.order)}
        for a, k in enumerate(state.next_order):
            for other in state.next_order[a + 1 :]:
                if now[k] > now[other]:
                    out[k] = out[other] = True
    return out


def ready(state: ControllerState, rho: Array) -> bool:
    """Whether another order was asked for and can be taken: all that change place are out."""
    if state.next_order is None:
        return False
    return not bool((rho[moving(state, len(rho))] > _OUT).any())
