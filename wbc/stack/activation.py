"""Smooth gains ρ: two first-order lags in series, so that neither ρ nor its slope jumps.

The published ρ = 1 − e^{−μ(t−τ)} (before Fig. 13) starts anew at 0 or 1 when a task is switched
back early, and its slope jumps at every switch: the command steps by μT times the task's term. Two
lags step by half the square of that and start from wherever they are. At t = 0 every ρ is 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel

# Closer than this a gain has arrived: what is out is then left out of the work. The lags alone
# would leave it a rounding error short of 1 for good, and a task long removed in force by 1e-300.
_ARRIVED = 1e-9


class Activation(NamedTuple):
    """State of the gains of L levels.

    Attributes:
        rho: (L,) the gains, in [0, 1].
        lag: (L,) the first lag's output, which ρ follows.
    """

    rho: Array
    lag: Array


def start(levels: int) -> Activation:
    """Every gain at 0."""
    return Activation(np.zeros(levels), np.zeros(levels))


def advance(activation: Activation, target: Array, rate: float, dt: float) -> Activation:
    """The gains a time dt later, exactly: target (L,) constant meanwhile, rate μ in 1/s.

    They arrive: within 1e-12 of the target they are there. An infinite rate switches at once.
    """
    if math.isinf(rate):
        return Activation(target.copy(), target.copy())
    return Activation(*_advance(activation.rho, activation.lag, target, rate * dt))


@kernel
def _advance(rho: Array, lag: Array, target: Array, turns: float) -> tuple[Array, Array]:
    decay = np.exp(-turns)
    gap = lag - target
    new_rho, new_lag = target + (rho - target + gap * turns) * decay, target + gap * decay
    for k in range(target.shape[0]):
        if max(abs(new_rho[k] - target[k]), abs(new_lag[k] - target[k])) < _ARRIVED:
            new_rho[k], new_lag[k] = target[k], target[k]
    return new_rho, new_lag


def published(t: float, since: float, rate: float, *, inserted: bool) -> float:
    """ρ(t) as printed: 1 − e^{−μ(t−τ)} after an insertion at τ, e^{−μ(t−τ′)} after a removal."""
    decay = math.exp(-rate * (t - since))
    return 1.0 - decay if inserted else decay
