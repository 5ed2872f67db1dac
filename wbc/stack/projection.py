"""Prioritized solve: augmented projection (37), with smooth activations and exact priorities.

Pure numerics. The unknown is the joint velocity v; a level of rows J with right-hand side r and
activation ρ is solved in what the levels above leave free. For one row j, with g = N jᵀ and d = j g:

    v ← v + ρ (gᵀg / d) (r − j v) g / d,        N ← N − ρ g gᵀ / d

and for several rows the same along each eigenvector of J N Jᵀ. With every ρ at 0 or 1, N is a
projector, gᵀg = d, and this is the (J N)† form: the error decays at exactly its gain while the level
does not conflict with those above, and lower levels never change it. In between, gᵀg / d is the share
that fading levels above leave: without it (J N)† would undo their fading, and a level would jump to
full speed as soon as one above it let go by a hair. So everything is continuous in every ρ, and a task
that fades in or out moves neither its own term nor what those below may do by a step.
The printed law, N J†, is in `wbc.stack.printed`.

The metric W (diagonal) is applied by the caller: rows come divided by √W, v is to be divided by it.
"""

from __future__ import annotations

import numpy as np

from wbc.compiled import kernel

# Of a row's squared length, what the levels above leave free of it (fading set aside): below CUT the
# direction counts as taken, from FULL on it is used fully. From the level's own share `exact` on its
# gain is exact; below, the inverse is bounded: no row moves the joints more than 1.1 / √exact times
# as fast as it would alone.
_CUT = 1e-6
_FULL = 1e-4
# Less than this of a row's squared length left by fading: nothing to compute with.
_NOTHING = 1e-12
# Main task: a row whose part independent of the rows before it is shorter than this ratio is
# nearly dependent; its inverse is damped, its direction stays in the projector.
_MAIN_NEAR = 1e-3
_MAIN_RANK = 1e-9


@kernel
def _smooth(x: float) -> float:
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    return x * x * (3.0 - 2.0 * x)


@kernel
def solve_main(rows, rhs, basis, v):  # type: ignore[no-untyped-def]
    """Least-norm solution of the main task by orthonormalising its rows; v is filled.

    Gram-Schmidt, each row twice against the ones before: orthonormal to rounding whatever the
    condition of the rows, no squaring of it, and the last quotient tells how independent a row is.
    Never damped while every row keeps more than 1e-3 of its length; nearer to a rank loss the
    inverse is (the projector is not), and rows dependent to rounding drop out.

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
    for i in range(rows.shape[0]):
        row = rows[i]
        length = np.sqrt(np.sum(row * row))
        if length == 0.0:
            smallest = 0.0
            continue
        direction = row.copy()
        if rank > 0:
            done = basis[:rank]
            direction -= (done @ direction) @ done
            direction -= (done @ direction) @ done
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
def _project(x, basis, rank, taken, share, count):  # type: ignore[no-untyped-def]
    """N x: out of the main task's rows, then out of what the levels so far have taken."""
    y = x.copy()
    if rank > 0:
        main = basis[:rank]
        y -= (main @ y) @ main
        y -= (main @ y) @ main  # twice: what rounding leaves, a small pivot below would amplify
    if count > 0:
        used = taken[:count]
        y -= (share[:count] * (used @ y)) @ used
    return y


@kernel
def _share_of(d, gg, size, exact):  # type: ignore[no-untyped-def]
    """φ and the factor on g, for d = j N jᵀ, gg = |N jᵀ|², size = |j|²: cut, bound and fading."""
    if d <= _NOTHING * size:
        return 0.0, 0.0
    free = d * d / (gg * size)  # d / |j|² where N is a projector; 1 where N only fades
    if free <= _CUT:
        return 0.0, 0.0
    phi = _smooth((free - _CUT) / (_FULL - _CUT))
    share = free / exact
    bounded = 1.0 if share >= 1.0 else share * (2.0 - share)  # meets 1 with a continuous slope
    return phi, phi * gg / (d * d) * bounded


@kernel
def _add_direction(row, missing, activation, exact, basis, rank, taken, share, count, v):  # type: ignore[no-untyped-def]
    """One row as a level of its own: adds its motion to v and takes its direction. Returns count, φ."""
    size = np.sum(row * row)
    if size < 1e-24 or activation <= 0.0:
        return count, 0.0
    g = _project(row, basis, rank, taken, share, count)
    d = np.sum(row * g)
    phi, factor = _share_of(d, np.sum(g * g), size, exact)
    if phi == 0.0:
        return count, 0.0
    v += (activation * missing * factor) * g
    taken[count] = g
    share[count] = activation * phi / d
    return count + 1, phi


@kernel
def _add_block(rows, missing, activation, exact, basis, rank, taken, share, count, v):  # type: ignore[no-untyped-def]
    """A level of several rows: along the eigenvectors of J N Jᵀ, each cut and damped on its own."""
    m = rows.shape[0]
    g = np.zeros(rows.shape)
    size = 0.0
    for i in range(m):
        g[i] = _project(rows[i], basis, rank, taken, share, count)
        size = max(size, np.sum(rows[i] * rows[i]))
    if size < 1e-24 or activation <= 0.0:
        return count, 0.0
    gram = rows @ g.T
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    wanted = missing - rows @ v
    least = 1.0
    for k in range(m - 1, -1, -1):
        along = np.ascontiguousarray(vectors[:, k])
        direction = along @ g
        phi, factor = _share_of(values[k], np.sum(direction * direction), size, exact)
        least = min(least, phi)
        if phi == 0.0:
            continue
        v += (activation * np.sum(along * wanted) * factor) * direction
        taken[count] = direction
        share[count] = activation * phi / values[k]
        count += 1
    return count, least


@kernel
def solve_stack(
    main_rows,
    main_rhs,
    jacobian,
    rhs,
    row_activation,
    start,
    size,
    exact,
    order,
    activation,
    gradient,
    basis,
    taken,
    share,
    v_main,
    v,
    freedom,
):  # type: ignore[no-untyped-def]
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
        basis, taken, share: workspaces (>= r, n), (R, n), (R,).
        v_main, v: (n,) filled: main task alone, and everything.
        freedom: (L,) filled: smallest φ of a level's rows, 1 where it had all the freedom it needs.

    Returns:
        Rank of the main task and the smallest independent share of its rows.
    """
    rank, smallest = solve_main(main_rows, main_rhs, basis, v_main)
    v[:] = v_main
    count = 0
    for k in range(order.shape[0]):
        level = order[k]
        first, last = start[level], start[level] + size[level]
        rho = activation[level] * row_activation[first]
        if size[level] == 1:
            missing = rhs[first] - np.sum(jacobian[first] * v)
            count, freedom[level] = _add_direction(
                jacobian[first], missing, rho, exact[level], basis, rank, taken, share, count, v
            )
        else:
            rows = jacobian[first:last]
            count, freedom[level] = _add_block(
                rows, rhs[first:last], rho, exact[level], basis, rank, taken, share, count, v
            )
    v -= _project(gradient, basis, rank, taken, share, count)
    return rank, smallest


@kernel
def task_rows(
    jacobian_ext,
    error,
    rate,
    gain,
    saturation,
    start,
    size,
    xi_jacobian,
    xi_drift,
    scale,
    jacobian,
    rhs,
):  # type: ignore[no-untyped-def]
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
    passive = jacobian_ext[:, n:]
    jacobian[:] = (jacobian_ext[:, :n] + passive @ xi_jacobian) * scale
    drift = passive @ xi_drift
    for level in range(start.shape[0]):
        a, b = start[level], start[level] + size[level]
        length = np.sqrt(np.sum(error[a:b] * error[a:b]))
        k = gain[level]
        if length > saturation[level]:
            k *= saturation[level] / length
        rhs[a:b] = k * error[a:b] + rate[a:b] - drift[a:b]
