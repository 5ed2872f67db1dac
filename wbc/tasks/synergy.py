"""Synergy: a hand's joints within the few directions in which they move together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, final, get_args

import numpy as np

from wbc.arrays import Array, IntArray, read_only
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.errors import SetupError
from wbc.tasks.base import Task, TaskRows

SynergyMeasure: TypeAlias = Literal["weights", "outside", "posture"]


@kernel
def _linear_rows(
    q: Array, joints: IntArray, mean: Array, matrix: Array, target: Array, error: Array,
    jacobian: Array, rate: Array,
) -> None:  # fmt: skip
    """Rows of σ = M (q_h − c̄). The target is (m,), (2m,) with its rate, or empty for 0."""
    m, n = matrix.shape
    for r in range(m):
        value = 0.0
        for j in range(n):
            value += matrix[r, j] * (q[joints[j]] - mean[j])
            jacobian[r, joints[j]] = matrix[r, j]
        error[r] = -value
        if target.shape[0] >= m:
            error[r] += target[r]
        if target.shape[0] == 2 * m:
            rate[r] = target[m + r]


@kernel
def _posture_rows(
    q: Array, joints: IntArray, mean: Array, basis: Array, lower: Array, upper: Array,
    target: Array, error: Array, jacobian: Array, rate: Array,
) -> None:  # fmt: skip
    """Rows of σ = q_h, to be brought to clip(c̄ + Ê α); a joint that is clipped has no rate."""
    n, k = basis.shape
    for j in range(n):
        value, speed = mean[j], 0.0
        for s in range(k):
            value += basis[j, s] * target[s]
            if target.shape[0] == 2 * k:
                speed += basis[j, s] * target[k + s]
        if lower[j] < value < upper[j]:
            rate[j] = speed
        error[j] = min(max(value, lower[j]), upper[j]) - q[joints[j]]
        jacobian[j, joints[j]] = 1.0


@final
@dataclass(frozen=True)
class Synergy(Task):
    """The joints q_h of a hand beside the subspace c̄ + Ê α of its postures (55); rows in [rad].

    What is measured of them:

    - ``"weights"``: σ = Ê† (q_h − c̄), the weights (56), k rows; the hand's other directions are
      free for other tasks;
    - ``"outside"``: σ = Nᵀ (q_h − c̄), N an orthonormal basis of what Ê does not span, n − k rows
      to be brought to 0: low in a stack it draws the hand into the subspace, wherever there;
    - ``"posture"``: σ = q_h, n rows, brought to c̄ + Ê α with each joint clipped to its range.

    Attributes:
        joints: (n,) places in q, each once.
        mean: (n,) c̄, [rad].
        basis: (n, k) Ê, columns independent.
        lower, upper: (n,) ranges that ``"posture"`` keeps to, [rad]; may be infinite.
        goal: (k,) weights α [rad], or (2k,) with their rates; ``"outside"`` does not read it.
        measure: which of the three.
    """

    joints: IntArray
    mean: Array
    basis: Array
    lower: Array
    upper: Array
    goal: Array
    measure: SynergyMeasure = "weights"

    @property
    def rows(self) -> int:
        n, k = len(self.basis), int(self.basis.shape[1])
        return {"weights": k, "outside": n - k, "posture": n}[self.measure]

    @property
    def target(self) -> Array | None:
        return None if self.measure == "outside" else self.goal

    @property
    def target_sizes(self) -> tuple[int, ...]:
        k = self.basis.shape[1]
        return () if self.measure == "outside" else (k, 2 * k)

    @cached_property
    def matrix(self) -> Array:
        """(m, n) M of σ = M (q_h − c̄): Ê† or Nᵀ; not used by ``"posture"``."""
        if self.measure == "outside":
            return read_only(complement(self.basis).T)
        return read_only(np.linalg.pinv(self.basis))

    def check(self, kin: ExtendedKinematics) -> None:
        nv, n = kin.robot.model.nv, len(self.joints)
        if self.measure not in get_args(SynergyMeasure):
            raise SetupError(f"task '{self.name}': unknown measure '{self.measure}'")
        if self.joints.ndim != 1 or not np.issubdtype(self.joints.dtype, np.integer):
            raise SetupError(f"task '{self.name}': joints must be a row of places in q")
        if n and not (self.joints.min() >= 0 and self.joints.max() < nv):
            raise SetupError(f"task '{self.name}': joints must be places in q, 0 to {nv - 1}")
        if len(set(self.joints.tolist())) < n:
            raise SetupError(f"task '{self.name}': a joint is named twice")
        if any(array.shape != (n,) for array in (self.mean, self.lower, self.upper)) or (
            self.basis.ndim != 2 or len(self.basis) != n
        ):
            raise SetupError(f"task '{self.name}': mean, basis and ranges must have {n} rows")
        if not (np.isfinite(self.mean).all() and np.isfinite(self.basis).all()):
            raise SetupError(f"task '{self.name}': mean and basis must be finite")
        if not (self.lower <= self.upper).all():
            raise SetupError(f"task '{self.name}': a lower end of a range is above its upper one")
        k = self.basis.shape[1]
        if not k or np.linalg.matrix_rank(self.basis) < k:
            raise SetupError(f"task '{self.name}': its synergies are none or not independent")
        super().check(kin)

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        q = kin.robot.q
        if self.measure == "posture":
            assert target is not None  # the stack hands on the task's own or its replacement
            _posture_rows(
                q, self.joints, self.mean, self.basis, self.lower, self.upper, target, out.error,
                out.jacobian, out.rate,
            )  # fmt: skip
            return
        _linear_rows(
            q, self.joints, self.mean, self.matrix, _ZERO if target is None else target, out.error,
            out.jacobian, out.rate,
        )  # fmt: skip


_ZERO: Array = np.zeros(0)


def complement(basis: Array) -> Array:
    """(n, n − k) an orthonormal basis of what the columns of `basis` (n, k) do not span.

    The same on every machine, unlike that of a singular value decomposition: of what the projector
    leaves of the unit vectors the longest is taken first, its own entry positive.
    """
    n, k = basis.shape
    q, _ = np.linalg.qr(basis)
    left = np.eye(n) - q @ q.T
    out = np.zeros((n, n - k))
    for c in range(n - k):
        lengths = np.round(np.linalg.norm(left, axis=0), 9)  # of equal ones the first
        column = left[:, int(np.argmax(lengths))].copy()
        for _ in range(2):  # once leaves rounding errors, twice is enough
            column -= out[:, :c] @ (out[:, :c].T @ column)
            column -= q @ (q.T @ column)
            column /= np.linalg.norm(column)
        out[:, c] = column
        left -= np.outer(column, column @ left)
    return out
