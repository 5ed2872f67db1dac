"""The law as published, (37) and its complete form at the end of 2.3, to compare with.

    q̃̇ = J̃† b + Σ ρ_h N(J^A_h) J_h† K_h e_h − k_∇ N(J^A_{m+1}) ∇C,    J^A_h = [J̃; J_1; …; J_{h−1}]

over all the columns of q̃, passive ones too, with the right pseudo-inverse weighted by W for every †
and N(J) = I − J† J. The double dot on the printed left side is a misprint.

What it does otherwise than `wbc.stack.projection`: level h converges at K times a share η, for a
row |N Jᵀ|² / |J|² in the metric, which depends on how ξ, θ and q are weighed against each other;
ρ fades a level's term while its rows stay in J^A; and the projector is cut at numerical rank, so
that it jumps by a whole dimension where a row comes, goes or turns into those above.

Pure numerics, for clarity and not for speed: one singular value decomposition per level.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wbc.arrays import Array

# Singular values below this share of the largest count as zero.
_RANK = 1e-10


class PrintedLevel(NamedTuple):
    """One level of (37).

    Attributes:
        jacobian: (m, n) J_h.
        rhs: (m,) K_h e_h, in the task's units per second.
        rho: ρ_h.
    """

    jacobian: Array
    rhs: Array
    rho: float


class PrintedMotion(NamedTuple):
    """What the law gives.

    Attributes:
        main: (n,) the first term alone.
        total: (n,) q̃̇.
        rank: of J̃.
        eta: (L,) mean share of its gain at which each level's error decays, tr(J N J†) / m.
    """

    main: Array
    total: Array
    rank: int
    eta: Array


def pseudo_inverse(rows: Array, metric: Array) -> tuple[Array, int]:
    """J†_W = W^−½ (J W^−½)†, (n, m), of rows (m, n) and the diagonal of W (n,), and the rank.

    With independent rows it is W⁻¹ Jᵀ (J W⁻¹ Jᵀ)⁻¹.
    """
    if not rows.size:
        return np.zeros(rows.shape[::-1]), 0
    scale = 1.0 / np.sqrt(metric)
    u, s, vt = np.linalg.svd(rows * scale, full_matrices=False)
    rank = int(np.sum(s > _RANK * s[0]))
    inverse: Array = scale[:, None] * ((vt[:rank].T / s[:rank]) @ u[:, :rank].T)
    return inverse, rank


def null_projector(rows: Array, metric: Array) -> Array:
    """N(J) = I − J†_W J, (n, n): oblique, unless W is a multiple of I."""
    projector: Array = np.eye(rows.shape[1]) - pseudo_inverse(rows, metric)[0] @ rows
    return projector


def solve_printed(
    rows: Array, rhs: Array, metric: Array, levels: Sequence[PrintedLevel], gradient: Array
) -> PrintedMotion:
    """The complete law of 2.3.

    Args:
        rows, rhs: (r, n), (r,) J̃ and the right-hand side of (35).
        metric: (n,) the diagonal of W.
        levels: from the highest priority down. One with ρ = 0 still has its rows in J^A; a task
            that is not in the stack is to be left out.
        gradient: (n,) k_∇ ∇C.

    Returns:
        Not a number throughout where anything given is not.
    """
    given = [rows, rhs, gradient, *(x for level in levels for x in level)]
    if not all(np.isfinite(x).all() for x in given):
        lost = np.full(len(metric), np.nan)
        return PrintedMotion(lost, lost.copy(), 0, np.zeros(len(levels)))
    inverse, rank = pseudo_inverse(rows, metric)
    main: Array = inverse @ rhs
    total, above = main.copy(), rows
    eta = np.zeros(len(levels))
    for h, level in enumerate(levels):
        term = null_projector(above, metric) @ pseudo_inverse(level.jacobian, metric)[0]
        total += level.rho * (term @ level.rhs)
        eta[h] = np.trace(level.jacobian @ term) / len(level.rhs)
        above = np.vstack([above, level.jacobian])
    total -= null_projector(above, metric) @ gradient
    return PrintedMotion(main, total, rank, eta)
