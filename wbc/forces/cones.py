"""The algebra of the friction cones z ≥ |s|, components (x, y, z[, t]) of each contact.

Over all contacts in one call: to hand arrays to a function of a single cone takes longer than its
few products.
"""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel


@kernel
def cone_margins(contact: IntArray, x: Array, out: Array) -> float:
    """Fill out (n,) with z − |s|; returns the smallest."""
    least = np.inf
    for i in range(len(contact) - 1):
        head, square = contact[i] + 2, 0.0
        for k in range(contact[i], contact[i + 1]):
            if k != head:
                square += x[k] * x[k]
        out[i] = x[head] - np.sqrt(square)
        least = min(least, out[i])
    return float(least)


@kernel
def cone_step(contact: IntArray, u: Array, d: Array) -> float:
    """Largest step for which u + step d, u inside, stays in all cones; inf if it never leaves."""
    longest = np.inf
    for i in range(len(contact) - 1):
        head = contact[i] + 2
        z, dz = u[head], d[head]
        square, b, a = 0.0, z * dz, dz * dz
        for k in range(contact[i], contact[i + 1]):
            if k != head:
                square += u[k] * u[k]
                b -= u[k] * d[k]
                a -= d[k] * d[k]
        s = np.sqrt(square)
        c = (z - s) * (z + s)
        # a t² + 2 b t + c = 0 with c > 0: its first positive root
        root = b * b - a * c
        if root > 0.0 and (a < 0.0 or b < 0.0):
            longest = min(longest, c / (np.sqrt(root) - b))
        elif dz < 0.0:
            longest = min(longest, -z / dz)
    return float(longest)


@kernel
def scaling(contact: IntArray, s: Array, z: Array, w: Array, eta: Array) -> None:
    """Nesterov-Todd scaling W with W z = W⁻¹ s: fills w (M,), of cone length 1, and η (n,).

    W = η [[w₀, w₁ᵀ], [w₁, I + w₁ w₁ᵀ / (1 + w₀)]], head first; see `times`.
    """
    for i in range(len(eta)):
        first, last = contact[i], contact[i + 1]
        head = first + 2
        s_square, z_square, product = 0.0, 0.0, s[head] * z[head]
        for k in range(first, last):
            if k != head:
                s_square += s[k] * s[k]
                z_square += z[k] * z[k]
                product += s[k] * z[k]
        s_side, z_side = np.sqrt(s_square), np.sqrt(z_square)
        rs = np.sqrt((s[head] - s_side) * (s[head] + s_side))
        rz = np.sqrt((z[head] - z_side) * (z[head] + z_side))
        half = 0.5 / np.sqrt(0.5 * (1.0 + product / (rs * rz)))
        square = 0.0
        for k in range(first, last):
            if k != head:
                w[k] = half * (s[k] / rs - z[k] / rz)
                square += w[k] * w[k]
        w[head] = np.sqrt(1.0 + square)
        eta[i] = np.sqrt(rs / rz)


@kernel
def times(contact: IntArray, w: Array, eta: Array, x: Array, inverse: bool, out: Array) -> None:
    """out = W x, or W⁻¹ x; out may be x."""
    sign = -1.0 if inverse else 1.0
    for i in range(len(eta)):
        first, last = contact[i], contact[i + 1]
        head = first + 2
        along = 0.0
        for k in range(first, last):
            if k != head:
                along += w[k] * x[k]
        scale = 1.0 / eta[i] if inverse else eta[i]
        top = x[head]
        out[head] = scale * (w[head] * top + sign * along)
        along = sign * top + along / (1.0 + w[head])
        for k in range(first, last):
            if k != head:
                out[k] = scale * (x[k] + along * w[k])


@kernel
def times_rows(contact: IntArray, w: Array, eta: Array, x: Array, out: Array) -> None:
    """The first columns of out = W x, for x (M, c)."""
    columns = x.shape[1]
    along = np.empty(columns)
    for i in range(len(eta)):
        first, last = contact[i], contact[i + 1]
        head = first + 2
        for c in range(columns):
            along[c] = 0.0
        for k in range(first, last):
            if k != head:
                for c in range(columns):
                    along[c] += w[k] * x[k, c]
        share = 1.0 / (1.0 + w[head])
        for c in range(columns):
            out[head, c] = eta[i] * (w[head] * x[head, c] + along[c])
            along[c] = x[head, c] + share * along[c]
        for k in range(first, last):
            if k != head:
                for c in range(columns):
                    out[k, c] = eta[i] * (x[k, c] + along[c] * w[k])


@kernel
def complement(
    contact: IntArray, w: Array, eta: Array, lam: Array, ds: Array, dz: Array, centre: float,
    weight: float, out: Array,
) -> None:  # fmt: skip
    """out with λ ∘ out = centre e − λ∘λ − weight (W⁻¹ds)∘(W dz); ds and dz become these factors.

    a ∘ b = (aᵀb, a₀ b₁ + b₀ a₁).
    """
    times(contact, w, eta, ds, True, ds)
    times(contact, w, eta, dz, False, dz)
    for i in range(len(eta)):
        first, last = contact[i], contact[i + 1]
        head = first + 2
        top, square, along = centre, 0.0, 0.0
        for k in range(first, last):
            top -= lam[k] * lam[k] + weight * ds[k] * dz[k]
            if k != head:
                square += lam[k] * lam[k]
                mixed = ds[head] * dz[k] + dz[head] * ds[k]
                out[k] = -2.0 * lam[head] * lam[k] - weight * mixed
                along += lam[k] * out[k]
        s = np.sqrt(square)
        first_entry = (lam[head] * top - along) / ((lam[head] - s) * (lam[head] + s))
        out[head] = first_entry
        for k in range(first, last):
            if k != head:
                out[k] = (out[k] - lam[k] * first_entry) / lam[head]
