"""Prioritized solve: augmented projection (37), with smooth activations and exact priorities.

Pure numerics. The unknown is the joint velocity v; a level of rows J with right-hand side r and
activation ρ is solved in what the levels above leave free. For one row j, with g = N jᵀ, d = j g:

    v ← v + ρ (gᵀg / d) (r − j v) g / d,        N ← N − ρ g gᵀ / d

and for several rows the same along each eigenvector of J N Jᵀ. With every ρ at 0 or 1, N is a
projector, gᵀg = d, and this is the (J N)† form: the error decays at exactly its gain while the
level does not conflict with those above, and lower levels never change it. In between, gᵀg / d is
the share that fading levels above leave: without it (J N)† would undo their fading, and a level
would jump to full speed as soon as one above it let go by a hair. So everything is continuous in
every ρ, and a task that fades in or out moves neither its own term nor what those below may do by
a step. The printed law, N J†, is in `wbc.stack.printed`.

The metric W (diagonal) is applied by the caller: rows come divided by √W, v is to be divided by it.
"""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel

# Of a row's squared length, the share d / |j|² that the levels above leave free: below CUT the
# direction counts as taken, from FULL on it is used fully and never lost to a lower level (between,
# lower levels may move the row by up to 0.5 % of what they could alone). From the level's own share
# `exact` on its gain is exact; below, the inverse is bounded: a level moves the joints at most
# 1.09 / √exact times as fast as it would alone.
_CUT = 1e-6
_FULL = 1e-4
# The directions of a block are measured by the shortest, but by no less than this share of the
# longest (squared): where an arm is almost straight, its rows alone are damped.
_STRAIGHT = 1e-3
_WORST = 4.0 / 3.0 * np.sqrt(2.0 / 3.0)  # the largest (2 − x) √x, x in [0, 1]
# Squared length below which a row is shorter than anything a task means, so that one that passes
# through zero neither drives the joints without bound nor takes a direction made of rounding.
_SHORT = 1e-12
# Main task: a row whose part independent of the rows before it is shorter than this ratio is
# nearly dependent; its inverse is damped, its direction stays in the projector.
_MAIN_NEAR = 1e-3
_MAIN_RANK = 1e-9
# Length below which a row of the main task is short whatever the others are, [m] per motion.
_MAIN_SHORT = 1e-6


@kernel
def _smooth(x: float) -> float:
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    return x * x * (3.0 - 2.0 * x)


@kernel
def _remove(y: Array, basis: Array, count: int) -> None:
    """Take the part along the first `count` orthonormal rows of basis out of y.

    Twice: what rounding leaves the first time, a small pivot below would amplify. Written out, for
    a call into BLAS costs more than these few products.
    """
    for _ in range(2):
        for k in range(count):
            along = 0.0
            for j in range(y.shape[0]):
                along += basis[k, j] * y[j]
            for j in range(y.shape[0]):
                y[j] -= along * basis[k, j]


@kernel
def solve_main(rows: Array, rhs: Array, basis: Array, v: Array) -> tuple[int, float]:
    """Least-norm solution of the main task by orthonormalising its rows; v is filled.

    Gram-Schmidt, each row twice against the ones before: orthonormal to rounding whatever the
    condition of the rows, no squaring of it, and the last quotient tells how independent a row is.
    Never damped while every row keeps more than 1e-3 of its length; nearer to a rank loss the
    inverse is (the projector is not), and rows dependent to rounding drop out. No row moves the
    joints more than 1.31e3 times as fast as it would alone.

    Args:
        rows: (r, n).
        rhs: (r,).
        basis: (>= r, n) workspace; its first rows become an orthonormal basis of the rows.
        v: (n,).

    Returns:
        Number of basis rows, and the smallest independent share of a row's length (1: orthogonal).
    """
    v[:] = 0.0
    rank = 0
    smallest = 1.0
    longest = _MAIN_SHORT / _MAIN_NEAR
    for i in range(rows.shape[0]):
        longest = max(longest, np.sqrt(np.sum(rows[i] * rows[i])))
    for i in range(rows.shape[0]):
        row = rows[i]
        # a row that has itself become short, as a stretched arm's along its line, counts as one
        # that is nearly dependent: what is left of it is not worth the speed it would take
        length = max(np.sqrt(np.sum(row * row)), _MAIN_NEAR * longest)
        if length == 0.0:
            smallest = 0.0
            continue
        direction = row.copy()
        _remove(direction, basis, rank)
        left = np.sqrt(np.sum(direction * direction))
        share = left / length
        smallest = min(smallest, share)
        if share < _MAIN_RANK:
            continue
        direction /= left
        basis[rank] = direction
        rank += 1
        missing = rhs[i] - np.sum(row * v)
        inverse = 1.0 / left
        if share < _MAIN_NEAR:
            damping = (_MAIN_NEAR * length) * (1.0 - _smooth(share / _MAIN_NEAR))
            inverse = left / (left * left + damping * damping)
        v += (missing * inverse) * direction
    return rank, smallest


@kernel
def _project(x: Array, basis: Array, whole: int, taken: Array, share: Array, count: int) -> Array:
    """N x: out of the rows taken whole, then by their shares out of those of fading levels."""
    y: Array = x.copy()
    _remove(y, basis, whole)
    if count > 0:
        used = taken[:count]
        y -= (share[:count] * (used @ y)) @ used
    return y


@kernel
def _project_rows(
    rows: Array, basis: Array, whole: int, taken: Array, share: Array, count: int
) -> Array:
    """`_project` of every row; for many rows at once a call into BLAS pays."""
    y: Array = rows.copy()
    if whole > 0:
        done = basis[:whole]
        for _ in range(2):
            y -= (y @ done.T) @ done
    if count > 0:
        used = taken[:count]
        y -= ((y @ used.T) * share[:count]) @ used
    return y


@kernel
def _shares(free: float, exact: float) -> tuple[float, float, float]:
    """The cut φ, φ / free, and the bounded inverse of free; all continuous, their slopes too."""
    inverse = 1.0 / free if free >= exact else (2.0 - free / exact) / exact
    if free <= _CUT:
        return 0.0, 0.0, inverse
    phi = _smooth((free - _CUT) / (_FULL - _CUT))
    return phi, phi / free, inverse


@kernel
def _add_row(
    row: Array, rhs: float, activation: float, exact: float,
    basis: Array, whole: int, taken: Array, share: Array, count: int, v: Array,
) -> tuple[int, int, float]:  # fmt: skip
    """One row as a level of its own: adds its motion to v and takes its direction.

    Returns the numbers of directions taken whole and by a share, and φ.
    """
    size = float(np.sum(row * row))
    if activation <= 0.0 or size <= _CUT * _SHORT:
        return whole, count, 0.0
    size = max(size, _SHORT)
    g = _project(row, basis, whole, taken, share, count)
    gg = np.sum(g * g)
    free = np.sum(row * g) / size
    phi, take, inverse = _shares(free, exact)
    if phi == 0.0:
        return whole, count, 0.0
    missing = rhs - np.sum(row * v)
    v += (activation * missing * take * inverse * gg / (size * size)) * g
    if count == 0 and activation == 1.0 and free >= _FULL:
        # N is still a projector: among the whole ones it is kept orthogonal to rounding
        basis[whole] = g / np.sqrt(gg)
        return whole + 1, count, 1.0
    taken[count] = g
    share[count] = activation * take / size
    return whole, count + 1, phi


@kernel
def _extremes(gram: Array) -> tuple[float, float]:
    """Least and largest eigenvalue; of rows at right angles, as joints', they are the diagonal's.

    A posture of many joints would otherwise pay for its own rows about as much as for all else.
    """
    for i in range(gram.shape[0]):
        for j in range(i):
            if gram[i, j] != 0.0:
                values = np.linalg.eigvalsh(gram)
                return values[0], values[-1]
    diagonal = np.diag(gram)
    return diagonal.min(), diagonal.max()


@kernel
def _add_block(
    rows: Array, rhs: Array, activation: float, exact: float,
    basis: Array, whole: int, taken: Array, share: Array, count: int, v: Array,
) -> tuple[int, int, float]:  # fmt: skip
    """A level of several rows: `_add_row` along each eigenvector of J N Jᵀ.

    Returns the numbers of directions taken whole and by a share, and the smallest φ.
    """
    if activation <= 0.0:
        return whole, count, 0.0
    gram = rows @ rows.T
    missing = rhs - rows @ v
    if np.trace(gram) <= _CUT * _SHORT:
        return whole, count, 0.0
    if not np.isfinite(np.sum(gram) + np.sum(missing)):  # eigh would raise
        v[:] = np.nan
        return whole, count, 0.0
    shortest, longest = _extremes(gram)
    size = max(shortest, _STRAIGHT * longest, _SHORT)
    g = _project_rows(rows, basis, whole, taken, share, count)
    gram = rows @ g.T
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    along = np.ascontiguousarray(vectors.T)
    g = along @ g
    free = values / size
    phi, take, inverse = np.empty(len(free)), np.empty(len(free)), np.empty(len(free))
    for k in range(len(free)):
        phi[k], take[k], inverse[k] = _shares(free[k], exact)
    # not eigenvector by eigenvector: as a product of functions of J N Jᵀ it is continuous where
    # eigenvalues cross; J v = (J N Jᵀ)^-½ J N² Jᵀ (J N Jᵀ)^-½ r is symmetric, for what fades in one
    # direction must not move the task in another
    root = np.sqrt(np.maximum(free, _CUT))
    unfaded = (inverse * root * (along @ missing) / size) @ g
    step = (activation * take / root * (g @ unfaded) / size) @ g
    # where a level above fades N is no projector, and what its directions have in common is in no
    # single inverse: the bound of a row is kept by the length of the whole step
    most = activation * _WORST / np.sqrt(exact * size) * np.sqrt(np.sum(missing * missing))
    speed = np.sqrt(np.sum(step * step))
    v += step if speed <= most else step * (most / speed)
    for k in range(len(free) - 1, -1, -1):  # the whole ones first
        if count == 0 and activation == 1.0 and free[k] >= _FULL:
            basis[whole] = g[k] / np.sqrt(np.sum(g[k] * g[k]))
            whole += 1
        elif phi[k] > 0.0:
            taken[count] = g[k]
            share[count] = activation * take[k] / size
            count += 1
    return whole, count, phi[0]


@kernel
def solve_stack(
    main_rows: Array, main_rhs: Array, jacobian: Array, rhs: Array, row_activation: Array,
    start: IntArray, size: IntArray, exact: Array, order: IntArray, activation: Array,
    gradient: Array, basis: Array, taken: Array, share: Array, v_main: Array, v: Array,
    freedom: Array,
) -> tuple[int, float]:  # fmt: skip
    """The whole law: main task, levels in order, cost gradient last.

    Args:
        main_rows, main_rhs: (r, n), (r,) main task.
        jacobian, rhs: (R, n), (R,) rows of all levels.
        row_activation: (R,) in [0, 1]; for a level of several rows the first row's counts.
        start, size: (L,) first row and number of rows of each level.
        exact: (L,) free share of a row from which the level's gain is exact.
        order: (L',) levels from the highest priority down.
        activation: (L,) ρ of each level.
        gradient: (n,) k_∇ ∇C, descended in what is left.
        basis, taken, share: workspaces (>= r + R, n), (R, n), (R,).
        v_main, v: (n,) filled: main task alone, and everything.
        freedom: (L,) filled: smallest φ of a level's rows, 1 where it had all the freedom it needs,
            0 where it is out of force.

    Returns:
        Rank of the main task and the smallest independent share of its rows.
    """
    rank, smallest = solve_main(main_rows, main_rhs, basis, v_main)
    v[:] = v_main
    whole, count = rank, 0
    for k in range(order.shape[0]):
        level = order[k]
        first, last = start[level], start[level] + size[level]
        rho = activation[level] * row_activation[first]
        if size[level] == 1:
            whole, count, freedom[level] = _add_row(
                jacobian[first], rhs[first], rho, exact[level],
                basis, whole, taken, share, count, v,
            )  # fmt: skip
        else:
            whole, count, freedom[level] = _add_block(
                jacobian[first:last], rhs[first:last], rho, exact[level],
                basis, whole, taken, share, count, v,
            )  # fmt: skip
    v -= _project(gradient, basis, whole, taken, share, count)
    return rank, smallest


@kernel
def task_rows(
    jacobian_ext: Array, error: Array, rate: Array, gain: Array, saturation: Array,
    start: IntArray, size: IntArray, xi_jacobian: Array, xi_drift: Array, scale: Array,
    jacobian: Array, rhs: Array,
) -> None:  # fmt: skip
    """Rows over the joints from rows over q̃ = [q, ξ]: ξ̇ is replaced by what the contacts make of q̇.

    Args:
        jacobian_ext, error, rate: (R, n + 2N), (R,), (R,) as the tasks wrote them.
        gain, saturation: (L,) of each level.
        start, size: (L,).
        xi_jacobian, xi_drift: (2N, n), (2N,) with ξ̇ = xi_jacobian q̇ + xi_drift.
        scale: (n,) 1/√W.
        jacobian, rhs: (R, n), (R,) filled.
    """
    n = scale.shape[0]
    for level in range(start.shape[0]):
        a, b = start[level], start[level] + size[level]
        length = np.sqrt(np.sum(error[a:b] * error[a:b]))
        k = gain[level]
        if length > saturation[level]:
            k *= saturation[level] / length
        for r in range(a, b):
            rhs[r] = k * error[r] + rate[r]
            jacobian[r] = jacobian_ext[r, :n]
            for x in range(xi_drift.shape[0]):
                passive = jacobian_ext[r, n + x]
                if passive != 0.0:
                    jacobian[r] += passive * xi_jacobian[x]
                    rhs[r] -= passive * xi_drift[x]
            jacobian[r] *= scale


@kernel
def solve_weighted(
    rows: Array, rhs: Array, jacobian: Array, task_rhs: Array, row_activation: Array,
    start: IntArray, size: IntArray, exact: Array, order: IntArray, activation: Array,
    gradient: Array, gain: float, scale: Array, basis: Array, taken: Array, share: Array,
    main: Array, rest: Array, freedom: Array,
) -> tuple[int, float]:  # fmt: skip
    """`solve_stack` under the metric W = diag(1/scale²), from unscaled main rows and gradient.

    Args:
        rows, rhs: (r, n), (r,) main task.
        jacobian, task_rhs: (R, n), (R,) rows of all levels, scaled already as by `task_rows`.
        gradient, gain: (n,) ∇C and k_∇.
        main, rest: (n,) filled: the main task's velocity, and what the others add to it.
    """
    rank, smallest = solve_stack(
        rows * scale, rhs, jacobian, task_rhs, row_activation, start, size, exact, order,
        activation, gain * gradient * scale, basis, taken, share, main, rest, freedom,
    )  # fmt: skip
    rest -= main
    rest *= scale
    main *= scale
    return rank, smallest
