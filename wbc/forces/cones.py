"""The algebra of one friction cone z ≥ |s|, components (x, y, z[, t]), head at first + 2."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel


@kernel
def side(x: Array, first: int, last: int) -> float:
    """|s| of the contact with components [first, last)."""
    square = 0.0
    for k in range(first, last):
        if k != first + 2:
            square += x[k] * x[k]
    return float(np.sqrt(square))


@kernel
def cone_step(u: Array, d: Array, first: int, last: int) -> float:
    """Largest step for which u + step d, u inside, stays in the cone; inf if it never leaves."""
    s = side(u, first, last)
    z, dz = u[first + 2], d[first + 2]
    a, b, c = dz * dz, z * dz, (z - s) * (z + s)
    for k in range(first, last):
        if k != first + 2:
            a -= d[k] * d[k]
            b -= u[k] * d[k]
    # a t² + 2 b t + c = 0 with c > 0: its first positive root
    root = b * b - a * c
    if root > 0.0 and (a < 0.0 or b < 0.0):
        return float(c / (np.sqrt(root) - b))
    return np.inf if dz >= 0.0 else float(-z / dz)


@kernel
def scaling(s: Array, z: Array, first: int, last: int, w: Array) -> float:
    """Nesterov-Todd scaling W with W z = W⁻¹ s: fills w, of cone length 1, and returns η.

    W = η [[w₀, w₁ᵀ], [w₁, I + w₁ w₁ᵀ / (1 + w₀)]], head first; see `times`.
    """
    head = first + 2
    s_side, z_side = side(s, first, last), side(z, first, last)
    rs = np.sqrt((s[head] - s_side) * (s[head] + s_side))
    rz = np.sqrt((z[head] - z_side) * (z[head] + z_side))
    product = s[head] * z[head]
    for k in range(first, last):
        if k != head:
            product += s[k] * z[k]
    gamma = np.sqrt(0.5 * (1.0 + product / (rs * rz)))
    square = 0.0
    for k in range(first, last):
        if k != head:
            w[k] = 0.5 * (s[k] / rs - z[k] / rz) / gamma
            square += w[k] * w[k]
    w[head] = np.sqrt(1.0 + square)
    return float(np.sqrt(rs / rz))


@kernel
def times(w: Array, eta: float, x: Array, first: int, last: int, inverse: bool, out: Array) -> None:
    """out = W x or W⁻¹ x on one cone; out may be x."""
    head = first + 2
    along = 0.0
    for k in range(first, last):
        if k != head:
            along += w[k] * x[k]
    sign, scale = (-1.0, 1.0 / eta) if inverse else (1.0, eta)
    top = x[head]
    out[head] = scale * (w[head] * top + sign * along)
    along = sign * top + along / (1.0 + w[head])
    for k in range(first, last):
        if k != head:
            out[k] = scale * (x[k] + along * w[k])


@kernel
def divide(a: Array, b: Array, first: int, last: int, out: Array) -> None:
    """out with a ∘ out = b; a ∘ b = (aᵀb, a₀ b₁ + b₀ a₁)."""
    head = first + 2
    a_side, along = side(a, first, last), 0.0
    for k in range(first, last):
        if k != head:
            along += a[k] * b[k]
    top = (a[head] * b[head] - along) / ((a[head] - a_side) * (a[head] + a_side))
    out[head] = top
    for k in range(first, last):
        if k != head:
            out[k] = (b[k] - a[k] * top) / a[head]


@kernel
def correction(
    lam: Array, c1: Array, c2: Array, centre: float, weight: float, first: int, last: int,
    out: Array,
) -> None:  # fmt: skip
    """out = centre e − λ∘λ − weight c1∘c2."""
    head = first + 2
    top = centre
    for k in range(first, last):
        top -= lam[k] * lam[k] + weight * c1[k] * c2[k]
        if k != head:
            mixed = c1[head] * c2[k] + c2[head] * c1[k]
            out[k] = -2.0 * lam[head] * lam[k] - weight * mixed
    out[head] = top
