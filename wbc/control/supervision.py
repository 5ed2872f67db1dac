"""What the tick's law foresees, for the supervisor."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.control.law import CostForecast, Law


@final
class TickForecast:
    """Answers the supervisor's questions (39)-(42) from the law as last evaluated.

    `fresh` binds it to a tick; the answers hold until the law is evaluated again.
    """

    def __init__(self, law: Law, costs: CostForecast, dt: float, horizon: float) -> None:
        self._law = law
        self._costs = costs
        self._dt = dt
        self._horizon = horizon
        self._q: Array = np.zeros(0)
        self._v: Array = np.zeros(0)
        self._order: IntArray = np.zeros(0, dtype=np.int64)
        self._target: Array = np.zeros(0)

    def fresh(self, q: Array, v: Array, order: IntArray, target: Array) -> TickForecast:
        """Bind to a tick: q, the present command v, the levels' order, the gains' targets (M,)."""
        self._q, self._v, self._order, self._target = q, v, order, target
        return self

    def cost_next(self) -> float:
        """C_Σ one tick ahead along the present command (39)."""
        return self._costs.at(self._q + self._dt * self._v, self._law)

    def still_rises(self) -> bool:
        """Whether the law with every gain at its target still raises the cost."""
        return bool(self._law.gradient @ self._velocity(self._target) > 0.0)

    def conflict(self, task: int) -> float:
        """P_h = ‖N(J_h)(−∇C_Σ)‖ (41); inf for a task whose rows are all out of force."""
        stack = self._law.stack
        rows = stack.jacobian[stack.task_slices[task]]
        weights = stack.row_activation[stack.task_slices[task]]
        rows = rows[(weights > 0.0) & (np.abs(rows).max(axis=1) > 1e-12)]
        if not len(rows):
            return float("inf")
        gradient = self._law.gradient * stack.scale
        along = np.linalg.lstsq(rows.T, gradient, rcond=None)[0]
        return float(np.linalg.norm(gradient - rows.T @ along))

    def cost_with(self, task: int) -> float:
        """C_Σ a horizon ahead along the law with the task's gain at 1 (42)."""
        target = self._target.copy()
        target[task] = 1.0
        v = self._velocity(target)
        return self._costs.at(self._q + self._horizon * v, self._law)

    def _velocity(self, target: Array) -> Array:
        motion = self._law.solve(self._order, target[self._law.stack.level_task])
        velocity: Array = motion.total[: len(self._q)]
        return velocity
