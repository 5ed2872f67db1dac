"""The implicit function of bodies whose gauge is a p-norm: ellipses, spheroids, superquadrics."""

from __future__ import annotations

import math

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel


@kernel
def level_and_slope(x: Array, sizes: Array, p: float, slope: Array) -> float:
    """F = (g - 1)/|∇g| [m] and its gradient, for the gauge g(x) = (Σ |x_i/a_i|^p)^(1/p).

    g = 1 on the surface, F is the distance to first order there, and |x| - r for equal a_i and
    p = 2. With t_i = |x_i/a_i|: g_i = sign(x_i) t_i^(p-1) g^(1-p)/a_i,
    g_ij = (p-1) (δ_ij t_i^(p-2) g^(1-p)/a_i² - g_i g_j/g), ∇F = ∇g/|∇g| - (g - 1) ∇²g ∇g/|∇g|³.
    At the centre, where g has no gradient, the values of a point beside it on the first axis.

    Args:
        x: (3,) [m], of which the first k coordinates count.
        sizes: (k,) half axes a_i [m].
        p: exponent, at least 2.
        slope: (k,) or longer, its first k numbers filled with ∇F.

    Returns:
        F [m].
    """
    at = x[: sizes.shape[0]].copy()
    largest = np.max(np.abs(at) / sizes)
    if not largest > 1e-9:
        largest = 1e-9
        at[:] = 0.0
        at[0] = largest * sizes[0]
    # powers of ratios up to 1 neither overflow nor vanish together, whatever the exponent
    g = largest * np.sum((np.abs(at) / (sizes * largest)) ** p) ** (1.0 / p)
    power = (np.abs(at) / (sizes * g)) ** (p - 2.0) / (g * sizes**2)
    first = power * at
    square = np.sum(first**2)
    length = math.sqrt(square)
    bend = (g - 1.0) * (p - 1.0) * (power - square / g) / square
    slope[: at.shape[0]] = first / length * (1.0 - bend)
    level: float = (g - 1.0) / length
    return level


def gauge_level(p: Array, sizes: Array, exponent: float) -> float:
    """F [m] at p (3,), see `level_and_slope`."""
    return level_and_slope(np.asarray(p, dtype=np.float64), sizes, exponent, np.empty(3))


def gauge_level_gradient(p: Array, sizes: Array, exponent: float) -> Array:
    """∇F (3,) at p (3,), zero along z for the two half axes of a contour."""
    slope = np.zeros(3)
    level_and_slope(np.asarray(p, dtype=np.float64), sizes, exponent, slope)
    return slope


def gauge(points: Array, sizes: Array, p: float) -> Array:
    """g of points (m, k) -> (m,)."""
    t = np.abs(points) / sizes
    largest = np.max(t, axis=1)
    out: Array = largest * np.sum((t / largest[:, None]) ** p, axis=1) ** (1.0 / p)
    return out


def support(normals: Array, sizes: Array, p: float) -> Array:
    """max n·x over the body g(x) <= 1, the dual norm of (a_i n_i). normals (m, k) -> (m,) [m]."""
    return gauge(normals, 1.0 / sizes, p / (p - 1.0))
