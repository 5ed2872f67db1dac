"""The chart of a contour given by a few harmonics of the parameter angle."""

from __future__ import annotations

import math

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel


@kernel
def harmonic_charts(rows: Array, xi: Array, face: IntArray, out: Array) -> None:
    """Chart records of x = Σ xc cos(ku) + xs sin(ku), y = Σ yc cos(ku) + ys sin(ku), z = v.

    Args:
        rows: (h, 5) order k, then xc, xs, yc, ys [m].
        xi: (n, 2) angle u [rad] and height v [m].
        face: (n,) not used, a contour has one chart.
        out: (n, 6, 3) filled with c, c_u, c_v, c_uu, c_uv, c_vv.
    """
    for i in range(xi.shape[0]):
        x = y = x_u = y_u = x_uu = y_uu = 0.0
        for j in range(rows.shape[0]):
            k = rows[j, 0]
            c = math.cos(k * xi[i, 0])
            s = math.sin(k * xi[i, 0])
            even_x = rows[j, 1] * c + rows[j, 2] * s
            even_y = rows[j, 3] * c + rows[j, 4] * s
            x += even_x
            y += even_y
            x_u += k * (rows[j, 2] * c - rows[j, 1] * s)
            y_u += k * (rows[j, 4] * c - rows[j, 3] * s)
            x_uu -= k * k * even_x
            y_uu -= k * k * even_y
        out[i] = 0.0
        out[i, 0, 0] = x
        out[i, 0, 1] = y
        out[i, 0, 2] = xi[i, 1]
        out[i, 1, 0] = x_u
        out[i, 1, 1] = y_u
        out[i, 2, 2] = 1.0
        out[i, 3, 0] = x_uu
        out[i, 3, 1] = y_uu
