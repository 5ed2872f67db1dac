"""The implicit function of bodies whose gauge is a p-norm: ellipses, spheroids, superquadrics."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array


def gauge(x: Array, sizes: Array, p: float) -> tuple[float, Array, Array]:
    """g(x) = (Σ |x_i/a_i|^p)^(1/p) with its gradient and second derivative; g = 1 on the surface.

    With t_i = |x_i/a_i|: g_i = sign(x_i) t_i^(p-1) g^(1-p) / a_i and
    g_ij = (p-1) (δ_ij t_i^(p-2) g^(1-p) / a_i² - g_i g_j / g).

    Args:
        x: (k,) [m]; at the centre, where g has no gradient, a point beside it on the first axis.
        sizes: (k,) half axes a_i [m].

    Returns:
        g, ∂g/∂x (k,) [1/m], ∂²g/∂x² (k, k) [1/m²].
    """
    t = np.abs(x) / sizes
    largest = float(np.max(t))
    if largest < 1e-9:
        beside = np.zeros_like(sizes)
        beside[0] = 1e-9 * sizes[0]
        return gauge(beside, sizes, p)
    # powers of ratios up to 1 neither overflow nor vanish together, whatever the exponent
    ratio = t / largest
    total = float(np.sum(ratio**p))
    g = largest * total ** (1.0 / p)
    power = ratio ** (p - 2.0) * (largest / g) ** (p - 2.0) / (g * sizes**2)
    first = power * x
    second = (p - 1.0) * (np.diag(power) - np.outer(first, first) / g)
    return g, first, second


def gauge_level(x: Array, sizes: Array, p: float) -> float:
    """F = (g - 1)/|∇g| [m]: the distance to first order; |x| - r for equal a_i and p = 2."""
    g, first, _ = gauge(x, sizes, p)
    return (g - 1.0) / float(np.linalg.norm(first))


def gauge_level_gradient(x: Array, sizes: Array, p: float) -> Array:
    """∇F = ∇g/|∇g| - (g - 1) ∇²g ∇g/|∇g|³, shape (k,)."""
    g, first, second = gauge(x, sizes, p)
    length = float(np.linalg.norm(first))
    out: Array = first / length - (g - 1.0) * (second @ first) / length**3
    return out


def support(normals: Array, sizes: Array, p: float) -> Array:
    """max n·x over the body g(x) <= 1, the dual norm of (a_i n_i). normals (m, k) -> (m,) [m]."""
    q = p / (p - 1.0)
    t = np.abs(normals * sizes)
    largest = np.max(t, axis=1, keepdims=True)
    out: Array = largest[:, 0] * np.sum((t / largest) ** q, axis=1) ** (1.0 / q)
    return out
