"""Manipulability of each finger: stay away from singular postures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.errors import SetupError
from wbc.rotations import cross
from wbc.tasks.base import Task, TaskRows, fade


@kernel
def manipulability_gradient(
    linear: Array, angular: Array, chain: IntArray, size: int, gradient: Array
) -> float:
    """w = sqrt(det(J Jᵀ)) of a chain's position Jacobian (46) and its gradient.

    dw/dq_k = w tr((J Jᵀ)⁻¹ ∂J/∂q_k Jᵀ), with ∂J_j/∂q_k = ω_min(j,k) × J_max(j,k) for a serial chain
    listed from its root; in two sweeps along the chain.

    Args:
        linear, angular: (3, nv) Jacobians of the tip.
        chain: joints of the chain, root first, padded with -1.
        size: rows of J, 2 in the plane or 3.
        gradient: (nv,), filled at the chain's joints.

    Returns:
        w; at w = 0 the gradient is left zero.
    """
    n = 0
    while n < chain.shape[0] and chain[n] >= 0:
        n += 1
    gram = np.zeros((size, size))
    for k in range(n):
        for a in range(size):
            for b in range(size):
                gram[a, b] += linear[a, chain[k]] * linear[b, chain[k]]
    det, adjugate = _det_adjugate(gram)
    if not det > 0.0:
        return 0.0
    w: float = np.sqrt(det)
    m = np.zeros((n, 3))  # columns of (J Jᵀ)⁻¹ J
    for k in range(n):
        for a in range(size):
            for b in range(size):
                m[k, a] += adjugate[a, b] * linear[b, chain[k]] / det
    # Σ_i ∂J_i/∂q_k · m_i splits at k: J_k · Σ_{i<=k} m_i × ω_i + ω_k · Σ_{i>k} J_i × m_i
    before, after = np.zeros(3), np.zeros(3)
    for i in range(n):
        _add_cross(linear[:, chain[i]], m[i], 1.0, after)
    for k in range(n):
        column, turn = linear[:, chain[k]], angular[:, chain[k]]
        _add_cross(m[k], turn, 1.0, before)
        _add_cross(column, m[k], -1.0, after)
        total = 0.0
        for a in range(3):
            total += column[a] * before[a] + turn[a] * after[a]
        gradient[chain[k]] = w * total
    return w


@kernel
def _add_cross(a: Array, b: Array, sign: float, out: Array) -> None:
    """out += sign a × b, without a temporary."""
    out[0] += sign * (a[1] * b[2] - a[2] * b[1])
    out[1] += sign * (a[2] * b[0] - a[0] * b[2])
    out[2] += sign * (a[0] * b[1] - a[1] * b[0])


@kernel
def _det_adjugate(a: Array) -> tuple[float, Array]:
    """Determinant and adjugate of a symmetric (2, 2) or (3, 3) matrix."""
    out = np.zeros(a.shape)
    if a.shape[0] == 2:
        out[0, 0], out[1, 1] = a[1, 1], a[0, 0]
        out[0, 1], out[1, 0] = -a[0, 1], -a[1, 0]
        return a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0], out
    out[0] = cross(a[1], a[2])
    out[1] = cross(a[2], a[0])
    out[2] = cross(a[0], a[1])
    return np.sum(a[0] * out[0]), out


@kernel
def _shortfall_rows(
    linear: Array,
    angular: Array,
    chains: IntArray,
    fingers: IntArray,
    size: int,
    threshold: float,
    band: float,
    squared: bool,
    error: Array,
    jacobian: Array,
    activation: Array,
) -> None:
    nv = linear.shape[2]
    for r in range(fingers.shape[0]):
        f = fingers[r]
        gradient = jacobian[r, :nv]
        w = manipulability_gradient(linear[f], angular[f], chains[r], size, gradient)
        shortfall = threshold - w
        if shortfall <= 0.0:
            gradient[:] = 0.0
            activation[r] = 0.0
        elif squared:
            error[r] = -0.5 * shortfall * shortfall
            gradient *= -shortfall
        else:
            error[r] = -shortfall
            gradient *= -1.0
            activation[r] = fade(shortfall, band)


@final
@dataclass(frozen=True)
class Manipulability(Task):
    """σ_i = w̄ − w_i while w_i < w̄, else no row (46)-(47); one row per finger, m² in the plane.

    The rows fade in over `band` below the threshold. The published ½(w̄ − w)² (`squared`) has a
    Jacobian that vanishes with it.

    Attributes:
        fingers: (m,) fingers of the grasp.
        chains: (m, L) the joints of each finger's chain from the root, padded with -1.
        threshold: w̄.
        band: width of the fade, in the units of w.
        planar: position Jacobian of two rows instead of three.
    """

    fingers: IntArray
    chains: IntArray
    threshold: float
    band: float
    planar: bool
    squared: bool = False

    @property
    def rows(self) -> int:
        return len(self.fingers)

    @property
    def separate(self) -> bool:
        return True

    def frames_used(self) -> tuple[int, ...]:
        return tuple(int(f) for f in self.fingers)

    def check(self, kin: ExtendedKinematics) -> None:
        super().check(kin)
        if self.chains.size and not self.chains.max() < kin.robot.model.nv:
            raise SetupError(f"task '{self.name}': chains name a joint the robot does not have")

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        _shortfall_rows(
            kin.robot.linear, kin.robot.angular, self.chains, self.fingers,
            2 if self.planar else 3, self.threshold, self.band, self.squared,
            out.error, out.jacobian, out.activation,
        )  # fmt: skip


def finger_chains(kin_support: Array) -> IntArray:
    """Joints that move each tip, from the root, padded with -1, from 0/1 support rows (m, nv)."""
    width = int(kin_support.sum(axis=1).max(initial=0))
    chains = np.full((kin_support.shape[0], width), -1, dtype=np.int64)
    for row, support in enumerate(kin_support):
        joints = np.flatnonzero(support)
        chains[row, : len(joints)] = joints
    return chains
