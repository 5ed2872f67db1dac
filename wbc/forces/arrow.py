"""Linear algebra of the force problems: blocks on the diagonal, a few rows across all of them.

Both the Newton method and the conic method solve, again and again,

    H x + Gᵀ ν = r₁,   G x = r₂,   H = B + U Uᵀ,

with B block diagonal (one block a finger: its friction and its own joints), U (M, n_a) the shared
joints, G (6, M). With K = [Gᵀ U]ᵀ and B = L Lᵀ the 6 + n_a unknowns [ν; Uᵀx] follow from
S = K B⁻¹ Kᵀ + diag(0, I), so that the work grows with the number of contacts, not with its cube.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.forces.blocks import HandJacobian


class Shape(NamedTuple):
    """How contacts, blocks and joints follow each other; contact, block, joint as in `Blocks`."""

    contact: IntArray
    block: IntArray
    joint: IntArray


class Matrix(NamedTuple):
    """Room for one matrix and its factors.

    Attributes:
        hessian: (M, widest) the blocks of B, each in the rows of its components; then their
            factors L, with the inverses of the pivots on the diagonal.
        across: (M, 6 + n_a) Kᵀ.
        y: (M, 6 + n_a) L⁻¹ Kᵀ.
        s: (6 + n_a, 6 + n_a) factor of S, likewise.
    """

    hessian: Array
    across: Array
    y: Array
    s: Array


@kernel
def room_for(shape: Shape, shared: int) -> Matrix:
    """An empty matrix."""
    widest = 0
    for b in range(len(shape.block) - 1):
        size = shape.contact[shape.block[b + 1]] - shape.contact[shape.block[b]]
        widest = max(widest, size)
    rows, columns = shape.contact[-1], 6 + shared
    return Matrix(
        np.empty((rows, widest)), np.empty((rows, columns)), np.empty((rows, columns)),
        np.empty((columns, columns)),
    )  # fmt: skip


@kernel
def dot(a: Array, b: Array) -> float:
    """Σ a_i b_i over the length of a."""
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@kernel
def largest(a: Array) -> float:
    """max |a_i|."""
    most = 0.0
    for k in range(len(a)):
        most = max(most, abs(a[k]))
    return most


@kernel
def add(factor: float, x: Array, out: Array) -> None:
    """out += factor x, over the length of out."""
    for k in range(len(out)):
        out[k] += factor * x[k]


@kernel
def cholesky(a: Array, first: int, n: int, rank: float, floor: float) -> bool:
    """Factor the lower triangle of the n columns of rows [first, first + n) of a in place.

    The diagonal is replaced by the inverses of the factor's.

    Args:
        rank: least pivot, relative to its diagonal entry.
        floor: what every pivot is known to reach; rounding may say otherwise.

    Returns:
        False where a pivot is not positive, or below rank.
    """
    for j in range(n):
        row = first + j
        pivot = a[row, j]
        least = rank * pivot
        for k in range(j):
            pivot -= a[row, k] * a[row, k]
        pivot = max(pivot, floor)
        if not (pivot > 0.0 and pivot >= least):
            return False
        inverse = 1.0 / np.sqrt(pivot)
        a[row, j] = inverse
        for i in range(row + 1, first + n):
            rest = a[i, j]
            for k in range(j):
                rest -= a[i, k] * a[row, k]
            a[i, j] = rest * inverse
    return True


@kernel
def back_substitute(lower: Array, x: Array) -> None:
    """x = (L Lᵀ)⁻¹ x in place, with lower as `cholesky` leaves it."""
    n = lower.shape[0]
    for i in range(n):
        rest = x[i]
        for j in range(i):
            rest -= lower[i, j] * x[j]
        x[i] = rest * lower[i, i]
    for i in range(n - 1, -1, -1):
        rest = x[i]
        for j in range(i + 1, n):
            rest -= lower[j, i] * x[j]
        x[i] = rest * lower[i, i]


@kernel
def factor(shape: Shape, matrix: Matrix, rank: float, floor: float) -> bool:
    """Factor the blocks and S in place; False where one is not positive to rounding.

    Args:
        rank: least pivot of S, relative; floor: what the pivots of B are known to reach.
    """
    contact, block, _ = shape
    lower, across, y, s = matrix
    q = s.shape[0]
    for i in range(q):
        for j in range(i + 1):
            s[i, j] = 0.0
        if i >= 6:
            s[i, i] = 1.0
    for b in range(len(block) - 1):
        first, last = contact[block[b]], contact[block[b + 1]]
        if not cholesky(lower, first, last - first, 0.0, floor):
            return False
        for i in range(first, last):
            inverse = lower[i, i - first]
            for k in range(q):
                y[i, k] = across[i, k]
            for j in range(first, i):
                along = lower[i, j - first]
                for k in range(q):
                    y[i, k] -= along * y[j, k]
            for k in range(q):
                y[i, k] *= inverse
            for k in range(q):
                left = y[i, k]
                if left != 0.0:  # 0: a joint of the other hand
                    for j in range(k + 1):
                        s[k, j] += left * y[i, j]
    return cholesky(s, 0, q, rank, 0.0)


@kernel
def solve(shape: Shape, matrix: Matrix, r1: Array, r2: Array, x: Array, nu: Array) -> None:
    """Solve with what `factor` left: x (M,) and ν with the shared unknowns (6 + n_a,) are filled.

    Args:
        r1: (M,), r2: (6,) right-hand sides.
    """
    contact, block, _ = shape
    lower, _, y, s = matrix
    q = len(nu)
    for k in range(q):
        nu[k] = -r2[k] if k < 6 else 0.0
    for b in range(len(block) - 1):  # x = L⁻¹ r₁, and its part in the few unknowns
        first, last = contact[block[b]], contact[block[b + 1]]
        for i in range(first, last):
            rest = r1[i]
            for j in range(first, i):
                rest -= lower[i, j - first] * x[j]
            rest *= lower[i, i - first]
            x[i] = rest
            for k in range(q):
                nu[k] += y[i, k] * rest
    back_substitute(s, nu)
    for b in range(len(block) - 1):
        first, last = contact[block[b]], contact[block[b + 1]]
        for i in range(last - 1, first - 1, -1):
            rest = x[i]
            for k in range(q):
                rest -= y[i, k] * nu[k]
            for j in range(i + 1, last):
                rest -= lower[j, i - first] * x[j]
            x[i] = rest * lower[i, i - first]


@kernel
def add_joints(shape: Shape, jacobian: HandJacobian, curvature: Array, matrix: Matrix) -> None:
    """Add Σ_j curvature_j J_j J_jᵀ: own joints to their blocks, shared ones as columns of Kᵀ."""
    contact, block, joint = shape
    own, shared = jacobian
    hessian, across, _, _ = matrix
    value = 0
    for b in range(len(block) - 1):
        first, last = contact[block[b]], contact[block[b + 1]]
        for j in range(joint[b], joint[b + 1]):
            for i in range(last - first):
                weighted = curvature[j] * own[value + i]
                for k in range(i + 1):
                    hessian[first + i, k] += weighted * own[value + k]
            value += last - first
    for a in range(shared.shape[0]):
        root = np.sqrt(curvature[joint[-1] + a])
        for i in range(shared.shape[1]):
            across[i, 6 + a] = root * shared[a, i]


@kernel
def transposed(shape: Shape, jacobian: HandJacobian, x: Array, out: Array) -> None:
    """Fill out (l',) with Jᵀ x, for x (M,) inside."""
    contact, block, joint = shape
    own, shared = jacobian
    value = 0
    for b in range(len(block) - 1):
        first = contact[block[b]]
        size = contact[block[b + 1]] - first
        for j in range(joint[b], joint[b + 1]):
            total = 0.0
            for i in range(size):
                total += own[value + i] * x[first + i]
            value += size
            out[j] = total
    for a in range(shared.shape[0]):
        total = 0.0
        for i in range(shared.shape[1]):
            total += shared[a, i] * x[i]
        out[joint[-1] + a] = total


@kernel
def add_product(shape: Shape, jacobian: HandJacobian, t: Array, out: Array) -> None:
    """Add J t to out (M,), for t (l',) inside."""
    contact, block, joint = shape
    own, shared = jacobian
    value = 0
    for b in range(len(block) - 1):
        first = contact[block[b]]
        size = contact[block[b + 1]] - first
        for j in range(joint[b], joint[b + 1]):
            for i in range(size):
                out[first + i] += own[value + i] * t[j]
            value += size
    for a in range(shared.shape[0]):
        for i in range(shared.shape[1]):
            out[i] += shared[a, i] * t[joint[-1] + a]


@kernel
def unbalanced(gt: Array, x: Array, h: Array, out: Array) -> None:
    """Fill out (6,) with G x − h; gt is Gᵀ (M, 6)."""
    for k in range(6):
        out[k] = -h[k]
    for i in range(len(x)):
        for k in range(6):
            out[k] += gt[i, k] * x[i]


@kernel
def largest_term(gt: Array, x: Array, h: Array) -> float:
    """The largest entry of h and of the components' parts in G x: what balance is relative to."""
    size = max(largest(h), 1e-300)
    for i in range(len(x)):
        for k in range(6):
            size = max(size, abs(gt[i, k] * x[i]))
    return size
