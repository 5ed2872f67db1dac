"""Contact frames and their motion from chart records, one kernel for all surfaces.

The frame of a contact is R_OC = [x y n] with x along c_u, n the outward normal and y = n x x: the
Gauss frame of the chapter (text between (27) and (28)) when the chart is orthogonal, and a proper
rotation also when it is not.
"""

from __future__ import annotations

import math

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.surfaces.vectors import Vector, added, cross, dot, scaled, vector

POLE = 1e-10  # |c_u| below this fraction of |c_uv|: the tangent c_u has lost its direction
TINY = 1e-300


@kernel
def unit_rate(unit: Vector, length: float, rate: Vector) -> Vector:
    """Derivative of v/|v| from v/|v|, |v| and the derivative of v."""
    along = dot(unit, rate)
    return (
        (rate[0] - along * unit[0]) / length,
        (rate[1] - along * unit[1]) / length,
        (rate[2] - along * unit[2]) / length,
    )


@kernel
def tangent(record: Array) -> Vector:
    """c_u; at a chart pole, where it vanishes, a short vector along its limit in the chart.

    There c_u is (v - v_pole) c_uv to first order; of the two directions the one that makes the
    normal point away from the origin of the object is the limit.
    """
    c_u = vector(record[1])
    c_uv = vector(record[4])
    if dot(c_u, c_u) > POLE * POLE * dot(c_uv, c_uv):
        return c_u
    if dot(cross(c_uv, vector(record[2])), vector(record[0])) < 0.0:
        return scaled(-POLE, c_uv)
    return scaled(POLE, c_uv)


@kernel
def gauss_frames(charts: Array, frame: Array, normal_xi: Array, spin: Array) -> None:
    """Frame of each contact in the object, and how it moves with the chart coordinates.

    With N = c_u x c_v the rates are n_ξ = (I - n nᵀ) N_ξ/|N|, x_ξ = (I - x xᵀ) [c_uu c_uv]/|c_u|.
    The angular velocity of C relative to O, expressed in C, is W ξ̇ with
    W = [-yᵀ n_ξ; xᵀ n_ξ; yᵀ x_ξ]. At a chart pole, where W has no limit, the numbers stay finite.

    Args:
        charts: (n, 6, 3) chart records of `Surface.evaluate`.
        frame: (n, 3, 3) filled with R_OC.
        normal_xi: (n, 3, 2) filled with ∂n/∂ξ in the object frame.
        spin: (n, 3, 2) filled with W.
    """
    for i in range(charts.shape[0]):
        c_u = tangent(charts[i])
        c_v = vector(charts[i, 2])
        c_uv = vector(charts[i, 4])
        big_n = cross(c_u, c_v)
        length_u = max(math.sqrt(dot(c_u, c_u)), TINY)
        length_n = max(math.sqrt(dot(big_n, big_n)), TINY)
        x = scaled(1.0 / length_u, c_u)
        n = scaled(1.0 / length_n, big_n)
        y = cross(n, x)
        for k in range(3):
            frame[i, k, 0] = x[k]
            frame[i, k, 1] = y[k]
            frame[i, k, 2] = n[k]
        for j in range(2):
            # j = 0: rates with u; j = 1: rates with v
            c_uj = vector(charts[i, 3]) if j == 0 else c_uv
            c_vj = c_uv if j == 0 else vector(charts[i, 5])
            n_j = unit_rate(n, length_n, added(cross(c_uj, c_v), cross(c_u, c_vj)))
            x_j = unit_rate(x, length_u, c_uj)
            for k in range(3):
                normal_xi[i, k, j] = n_j[k]
            spin[i, 0, j] = -dot(y, n_j)
            spin[i, 1, j] = dot(x, n_j)
            spin[i, 2, j] = dot(y, x_j)
