"""The point of a surface closest to a given point, by damped Newton steps from several seeds."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.contact.surfaces.base import D_U, D_UU, D_UV, D_V, D_VV, POINT, Surface

ROUNDS = 60


def newton_step(records: Array, gap: Array, damping: Array) -> Array:
    """Steps (m, 2) towards a smaller |c - p|² for m chart records (m, 6, 3) and gaps c - p (m, 3).

    The second derivative is c_i·c_j + (c - p)·c_ij; where it is not safely positive (p beyond a
    centre of curvature) its first part, the metric, takes its place.
    """

    def along(a: Array, b: Array) -> Array:
        out: Array = np.einsum("mi,mi->m", a, b)
        return out

    tangents = records[:, [D_U, D_V]]
    gradient = np.einsum("mji,mi->mj", tangents, gap)
    metric = np.einsum("mji,mki->mjk", tangents, tangents)
    bend_u, bend_uv, bend_v = (along(records[:, k], gap) for k in (D_UU, D_UV, D_VV))
    hessian = metric + np.stack([bend_u, bend_uv, bend_uv, bend_v], axis=1).reshape(-1, 2, 2)
    det_metric = metric[:, 0, 0] * metric[:, 1, 1] - metric[:, 0, 1] ** 2
    det = hessian[:, 0, 0] * hessian[:, 1, 1] - hessian[:, 0, 1] ** 2
    bad = (det < 1e-6 * det_metric) | (hessian[:, 0, 0] < 1e-6 * metric[:, 0, 0])
    hessian[bad] = metric[bad]
    hessian += damping[:, None, None] * metric
    det = hessian[:, 0, 0] * hessian[:, 1, 1] - hessian[:, 0, 1] ** 2
    det = np.where(det > 1e-300, det, 1.0)
    step = np.empty_like(gradient)
    step[:, 0] = -(hessian[:, 1, 1] * gradient[:, 0] - hessian[:, 0, 1] * gradient[:, 1]) / det
    step[:, 1] = -(hessian[:, 0, 0] * gradient[:, 1] - hessian[:, 0, 1] * gradient[:, 0]) / det
    return step


def refine(surface: Surface, p: Array, xi: Array, face: IntArray) -> tuple[Array, Array]:
    """Local minima of |c(ξ) - p| reached from m seeds, each in its own chart.

    Args:
        p: (3,) or (m, 3) [m], the object frame.
        xi: (m, 2) seeds.
        face: (m,) their charts.

    Returns:
        xi (m, 2) at the minima, and the squared distances (m,) [m²].
    """
    xi = np.array(xi, dtype=np.float64)
    records = surface.charts(xi, face)
    gap = records[:, POINT] - p
    value = np.einsum("mi,mi->m", gap, gap)
    damping = np.zeros(xi.shape[0])
    for _ in range(ROUNDS):
        step = newton_step(records, gap, damping)
        trial = surface.charts(xi + step, face)
        trial_gap = trial[:, POINT] - p
        trial_value = np.einsum("mi,mi->m", trial_gap, trial_gap)
        better = trial_value <= value
        xi[better] += step[better]
        records[better], gap[better] = trial[better], trial_gap[better]
        value = np.where(better, trial_value, value)
        damping = np.where(better, 0.1 * damping, np.maximum(0.1, 4.0 * damping))
        damping[damping < 1e-3] = 0.0
        if np.max(np.abs(step)) < 1e-14 or np.all(damping > 1e9):
            break
    return xi, value
