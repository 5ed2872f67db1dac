"""Manipulability of each finger: stay away from singular postures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.rotations import cross
from wbc.tasks.base import Task, TaskRows, fade


@kernel
def manipulability_gradient(
    joint_jacobian: Array, position: Array, linear: Array, chain: IntArray, leads: BoolArray,
    master: IntArray, ratio: Array, size: int, gradient: Array,
) -> float:  # fmt: skip
    """w = sqrt(det(J Jᵀ)) of a chain's position Jacobian (46) and its gradient.

    dw/dq_k = w tr((J Jᵀ)⁻¹ ∂J/∂q_k Jᵀ), with ∂J_j/∂q_k = ω_min(j,k) × J_max(j,k) for a serial chain
    listed from its root; in two sweeps along the chain. Where joints follow others, J is by the
    independent ones: a joint's column counts ratio times in its master's, and so does its
    derivative.

    Args:
        joint_jacobian: (6, n_full), as of `Kinematics`.
        position: (3,) the tip.
        linear: (3, nv) the tip's Jacobian by the independent joints.
        chain, leads: (L,) of `Kinematics`.
        master, ratio: (n_full,) of `RobotModel`.
        size: rows of J, 2 in the plane or 3.
        gradient: (nv,), zero on entry, filled at the chain's independent joints.

    Returns:
        w; at w = 0 the gradient is left zero.
    """
    n = 0
    gram = np.zeros((size, size))
    while n < chain.shape[0] and chain[n] >= 0:
        if leads[n]:
            j = master[chain[n]]
            for a in range(size):
                for b in range(size):
                    gram[a, b] += linear[a, j] * linear[b, j]
        n += 1
    det, adjugate = _det_adjugate(gram)
    if not det > 0.0:
        return 0.0
    w: float = np.sqrt(det)
    m = np.zeros((n, 3))  # ratio times the master's column of (J Jᵀ)⁻¹ J
    columns = np.zeros((n, 3))  # what each joint of the chain alone gives
    for k in range(n):
        j = chain[k]
        _add_cross(joint_jacobian[3:, j], position, 1.0, columns[k])
        for a in range(3):
            columns[k, a] += joint_jacobian[a, j]
        for a in range(size):
            for b in range(size):
                m[k, a] += ratio[j] * adjugate[a, b] * linear[b, master[j]] / det
    # Σ_i ∂J_i/∂q_k · m_i splits at k: J_k · Σ_{i<=k} m_i × ω_i + ω_k · Σ_{i>k} J_i × m_i
    before, after = np.zeros(3), np.zeros(3)
    for i in range(n):
        _add_cross(columns[i], m[i], 1.0, after)
    for k in range(n):
        j = chain[k]
        _add_cross(m[k], joint_jacobian[3:, j], 1.0, before)
        _add_cross(columns[k], m[k], -1.0, after)
        total = 0.0
        for a in range(3):
            total += columns[k, a] * before[a] + joint_jacobian[3 + a, j] * after[a]
        gradient[master[j]] += ratio[j] * (w * total)
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
    joint_jacobian: Array, position: Array, linear: Array, chains: IntArray, leads: BoolArray,
    master: IntArray, ratio: Array, fingers: IntArray, size: int, threshold: float, band: float,
    squared: bool, error: Array, jacobian: Array, activation: Array,
) -> None:  # fmt: skip
    nv = linear.shape[2]
    for r in range(fingers.shape[0]):
        f = fingers[r]
        gradient = jacobian[r, :nv]
        w = manipulability_gradient(
            joint_jacobian, position[f], linear[f], chains[f], leads[f], master, ratio, size,
            gradient,
        )  # fmt: skip
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
        threshold: w̄.
        band: width of the fade, in the units of w.
        planar: position Jacobian of two rows instead of three.
    """

    fingers: IntArray
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

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        robot = kin.robot
        _shortfall_rows(
            robot.joint_jacobian, robot.position, robot.linear, robot.chains, robot.leads,
            robot.model.master, robot.model.ratio, self.fingers, 2 if self.planar else 3,
            self.threshold, self.band, self.squared, out.error, out.jacobian, out.activation,
        )  # fmt: skip
