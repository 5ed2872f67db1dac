"""Joint-limit avoidance: a cost that grows outside a comfortable interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.costs.base import Cost
from wbc.robot.distances import Distances
from wbc.robot.kinematics import Kinematics


@kernel
def _joint_limit_cost(
    q: Array, lower: Array, upper: Array, stiffness: float, delta: float, offset: float,
    weight: float, gradient: Array,
) -> float:  # fmt: skip
    """C_JL of (49); adds weight · ∂C/∂q to gradient."""
    total = 0.0
    for j in range(q.shape[0]):
        beyond = min(q[j] - lower[j], 0.0) + max(q[j] - upper[j], 0.0)
        if beyond == 0.0:
            continue
        # past exp(50) only overflow would follow; the slope stays finite and still points inwards
        rise = stiffness * np.exp(min(delta * beyond * beyond, 50.0))
        total += rise - offset
        gradient[j] += weight * 2.0 * delta * beyond * rise
    return total


@final
@dataclass(frozen=True)
class JointLimits(Cost):
    """C_JL = Σ_j k (e^{δ (q_j − q̄_j)²} − 1) outside [lower, upper], 0 inside (49).

    As printed, k e^{...} − 1 jumps by k − 1 at the bound (`printed`). These bounds are soft; the
    URDF's are further out and are kept by the limit filter.

    Attributes:
        lower, upper: (nv,) soft bounds, [rad] or [m].
        stiffness: k.
        delta: δ, [1/rad²].
    """

    lower: Array
    upper: Array
    stiffness: float
    delta: float
    printed: bool = False

    def value(self, kin: Kinematics, distances: Distances | None) -> float:
        return self._evaluate(kin, np.zeros(kin.model.nv))

    def add_gradient(self, kin: Kinematics, distances: Distances | None, gradient: Array) -> float:
        return self._evaluate(kin, gradient)

    def _evaluate(self, kin: Kinematics, gradient: Array) -> float:
        offset = 1.0 if self.printed else self.stiffness
        return float(
            _joint_limit_cost(
                kin.q, self.lower, self.upper, self.stiffness, self.delta, offset, self.weight,
                gradient,
            )
        )  # fmt: skip
