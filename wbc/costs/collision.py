"""Collision avoidance: a cost over the distances of pairs of links, fingers and the object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.costs.base import Cost
from wbc.robot.distances import Distances
from wbc.robot.kinematics import Kinematics


@kernel
def _pair_cost(
    d: float, safety: float, floor: float, stiffness: float, printed: bool
) -> tuple[float, float]:
    """c(d) of (51) and its slope; below the floor the tangent goes on and keeps pushing apart."""
    if d >= safety:
        return 0.0, 0.0
    x = max(d, floor)
    gap = safety - x
    if printed:
        c = stiffness * gap / (x * x)
        slope = -stiffness * (1.0 / (x * x) + 2.0 * gap / (x * x * x))
    else:
        c = stiffness * gap * gap / (safety * x * x)
        slope = -2.0 * stiffness * gap / (safety * x * x) * (1.0 + gap / x)
    if d < floor:
        c += slope * (max(d, -1e3) - floor)
    return c, slope


@kernel
def _pair_costs(
    d: Array, pairs: IntArray, safety: float, floor: float, stiffness: float, printed: bool,
    slopes: Array,
) -> tuple[float, bool]:  # fmt: skip
    total = 0.0
    near = False
    for k in range(pairs.shape[0]):
        c, slopes[k] = _pair_cost(d[pairs[k]], safety, floor, stiffness, printed)
        total += c
        near = near or slopes[k] != 0.0
    return total, near


@final
@dataclass(frozen=True)
class Collision(Cost):
    """C_CA = Σ c(d) over pairs, c = k (d_s − d)² / (d_s d²) below d_s and 0 above it.

    The published c = k (d_s − d)/d² (50)-(51) (`printed`) has the same growth near contact, but its
    slope jumps to 1/d_s² at d_s, a velocity step each time a pair comes near. Both go on along
    their tangent below `floor`, where the published one would turn round and push together.

    Attributes:
        pairs: (P,) indices into the scene's pairs.
        safety_distance: d_s [m].
        floor: distance below which the slope is constant, [m].
        stiffness: k.
    """

    pairs: IntArray
    safety_distance: float
    floor: float
    stiffness: float
    printed: bool = False

    def value(self, kin: Kinematics, distances: Distances | None) -> float:
        return self._slopes(distances)[0]

    def add_gradient(self, kin: Kinematics, distances: Distances | None, gradient: Array) -> float:
        total, near, slopes = self._slopes(distances)
        if near and distances is not None:
            for k in np.flatnonzero(slopes):
                gradient += (self.weight * slopes[k]) * distances.gradient(int(self.pairs[k]), kin)
        return total

    def _slopes(self, distances: Distances | None) -> tuple[float, bool, Array]:
        slopes = np.zeros(len(self.pairs))
        if distances is None:
            return 0.0, False, slopes
        total, near = _pair_costs(
            distances.value, self.pairs, self.safety_distance, self.floor, self.stiffness,
            self.printed, slopes,
        )  # fmt: skip
        return float(total), bool(near), slopes
