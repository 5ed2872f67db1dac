"""The point of a surface closest to a given point: Newton steps in the chart."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.surfaces.base import POINT, Surface
from wbc.contact.surfaces.vectors import added, dot, scaled, vector

ROUNDS = 60


@kernel
def newton_step(record: Array, p: Array, damping: float) -> tuple[float, float]:
    """Step of (u, v) towards a smaller |c - p|² from a chart record (6, 3) and a point p (3,).

    The second derivative is c_i·c_j + (c - p)·c_ij. Where it is not safely positive, with p beyond
    a centre of curvature, its first part takes its place: the metric, which is also what `damping`
    multiplies.
    """
    gap = added(vector(record[0]), scaled(-1.0, vector(p)))
    c_u = vector(record[1])
    c_v = vector(record[2])
    metric_u, metric_uv, metric_v = dot(c_u, c_u), dot(c_u, c_v), dot(c_v, c_v)
    h_u = metric_u + dot(gap, vector(record[3]))
    h_uv = metric_uv + dot(gap, vector(record[4]))
    h_v = metric_v + dot(gap, vector(record[5]))
    metric_det = metric_u * metric_v - metric_uv * metric_uv
    if h_u < 1e-6 * metric_u or h_u * h_v - h_uv * h_uv < 1e-6 * metric_det:
        h_u, h_uv, h_v = metric_u, metric_uv, metric_v
    h_u += damping * metric_u
    h_uv += damping * metric_uv
    h_v += damping * metric_v
    det = h_u * h_v - h_uv * h_uv
    if not det > 1e-300:
        return (0.0, 0.0)
    slope_u, slope_v = dot(gap, c_u), dot(gap, c_v)
    return ((h_uv * slope_v - h_v * slope_u) / det, (h_uv * slope_u - h_u * slope_v) / det)


@kernel
def newton_steps(records: Array, points: Array, damping: Array, step: Array) -> None:
    """Fill step (m, 2) for records (m, 6, 3), points (m, 3) and damping (m,)."""
    for i in range(records.shape[0]):
        step[i, 0], step[i, 1] = newton_step(records[i], points[i], damping[i])


@kernel
def move_closer(records: Array, points: Array, xi: Array) -> None:
    """One undamped step of every xi (n, 2)."""
    for i in range(records.shape[0]):
        du, dv = newton_step(records[i], points[i], 0.0)
        xi[i, 0] += du
        xi[i, 1] += dv


def follow(
    surface: Surface, points: Array, xi: Array, face: IntArray, records: Array, rounds: int = 2
) -> None:
    """Keep xi at the closest points of tips that have moved a little since the last call.

    The error is squared in every round. For a tip anywhere, use `Surface.project`.

    Args:
        points: (n, 3) [m] in the object frame; z = 0 for a contour.
        xi: (n, 2) of the last call, moved in place.
        face: (n,) charts.
        records: (n, 6, 3) filled with the chart records at the new xi.
    """
    surface.evaluate(xi, face, records)
    for _ in range(rounds):
        move_closer(records, points, xi)
        surface.evaluate(xi, face, records)


def refine(surface: Surface, p: Array, xi: Array, face: IntArray) -> tuple[Array, Array]:
    """Local minima of |c(ξ) - p| reached from m seeds, each in its own chart.

    Args:
        p: (3,) [m] in the object frame.
        xi: (m, 2) seeds.
        face: (m,) their charts.

    Returns:
        xi (m, 2) at the minima, and the squared distances (m,) [m²].
    """

    def squares(records: Array) -> Array:
        gap = records[:, POINT] - p
        out: Array = np.einsum("mi,mi->m", gap, gap)
        return out

    xi = np.array(xi, dtype=np.float64)
    points = np.tile(np.asarray(p, dtype=np.float64), (xi.shape[0], 1))
    records = surface.charts(xi, face)
    value = squares(records)
    damping, step = np.zeros(xi.shape[0]), np.empty_like(xi)
    for _ in range(ROUNDS):
        newton_steps(records, points, damping, step)
        trial = surface.charts(xi + step, face)
        trial_value = squares(trial)
        better = trial_value <= value
        xi[better] += step[better]
        records[better] = trial[better]
        value = np.where(better, trial_value, value)
        damping = np.where(better, 0.1 * damping, np.maximum(0.1, 4.0 * damping))
        damping[damping < 1e-3] = 0.0
        if np.max(np.abs(step)) < 1e-14:
            break
    return xi, value
