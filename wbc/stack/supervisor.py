"""The three-layer supervisor (39)-(43): who is in the stack.

The lower layer is the solve. The middle one removes a task when the cost predicted for the next
tick passes an upper threshold and the law would still raise it; the upper one puts tasks back,
highest priority first, when the cost predicted with the task at work stays below a lower threshold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, final

import numpy as np

from wbc.arrays import BoolArray


class Forecast(Protocol):
    """What the supervisor asks about the future; each answer may cost a solve, so it asks late."""

    def cost_next(self) -> float:
        """C_Σ one tick ahead along the present command (39)."""

    def still_rises(self) -> bool:
        """Whether ∇C · v > 0 with every gain at its target: no removal has yet to take effect."""

    def conflict(self, task: int) -> float:
        """P_h = ‖N(J_h)(−∇C)‖ of (41); inf for a task without active rows."""

    def cost_with(self, task: int) -> float:
        """C_Σ a horizon ahead along the whole law with the task's gain at 1 (42)."""


class StackState(NamedTuple):
    """Who is in the stack.

    Attributes:
        wanted: (m,) asked for by the phase or the user.
        allowed: (m,) not removed by the supervisor; in the stack = wanted and allowed.
        changed_at: time of the supervisor's last event, [s].
        events: removals and insertions so far.
    """

    wanted: BoolArray
    allowed: BoolArray
    changed_at: float
    events: int

    @property
    def within(self) -> BoolArray:
        """(m,) in the stack."""
        both: BoolArray = self.wanted & self.allowed
        return both


class StackEvent(NamedTuple):
    """One decision: which task, in or out, and the predicted cost that decided it."""

    task: int
    inserted: bool
    cost: float


@final
@dataclass(frozen=True)
class Supervisor:
    """Thresholds and pace of the supervisor.

    Attributes:
        remove_above: C̄ of (40).
        insert_below: C̲ < C̄ of (43).
        horizon: how far ahead (42) looks along the full law, [s].
        dwell: least time from an event to an insertion, [s]; a removal never waits for it.
    """

    remove_above: float
    insert_below: float
    horizon: float
    dwell: float

    def decide(
        self, state: StackState, t: float, order: tuple[int, ...], forecast: Forecast
    ) -> tuple[StackState, StackEvent | None]:
        """At most one removal or insertion at time t.

        As printed, (40)-(41) removes one task per tick until the stack is empty, because a removed
        task's gain takes time to fade: here a removal waits until the law with every gain at its
        target would still raise the cost. A removal does not wait for the dwell time: (41) may take
        the wrong task first, and links that approach each other would not wait either.
        """
        cost = forecast.cost_next()
        if cost >= self.remove_above:
            candidates = [h for h in order if state.wanted[h] and state.allowed[h]]
            if not candidates or not forecast.still_rises():
                return state, None
            conflicts = [forecast.conflict(h) for h in candidates]
            least = int(np.argmin(conflicts))
            if not np.isfinite(conflicts[least]):
                return state, None
            return _changed(state, t, candidates[least], False, cost)
        settling = t - state.changed_at < self.dwell
        if settling or state.allowed.all() or cost > self.insert_below:
            return state, None
        for h in order:
            if state.wanted[h] and not state.allowed[h]:
                predicted = forecast.cost_with(h)
                if predicted <= self.insert_below:
                    return _changed(state, t, h, True, predicted)
        return state, None


def _changed(
    state: StackState, t: float, task: int, inserted: bool, cost: float
) -> tuple[StackState, StackEvent]:
    allowed = state.allowed.copy()
    allowed[task] = inserted
    return StackState(state.wanted, allowed, t, state.events + 1), StackEvent(task, inserted, cost)
