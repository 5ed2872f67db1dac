"""Charts by longitude and latitude: directions, and bodies by their radius along each."""

from __future__ import annotations

import math

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel


@kernel
def longitude_latitude(u: float, v: float, face: int, record: Array) -> None:
    """Fill a record (6,3) with the unit direction d(u, v) and its derivatives.

    For face 0, poles on z, d = (cos v cos u, cos v sin u, sin v); for faces 1 and 2 the same turned
    so that the poles are on x and y. d_u x d_v points along d.
    """
    cu, su, cv, sv = math.cos(u), math.sin(u), math.cos(v), math.sin(v)
    i = face % 3
    j = (face + 1) % 3
    k = (face + 2) % 3
    record[0, i], record[0, j], record[0, k] = cv * cu, cv * su, sv
    record[1, i], record[1, j], record[1, k] = -cv * su, cv * cu, 0.0
    record[2, i], record[2, j], record[2, k] = -sv * cu, -sv * su, cv
    record[3, i], record[3, j], record[3, k] = -cv * cu, -cv * su, 0.0
    record[4, i], record[4, j], record[4, k] = sv * su, -sv * cu, 0.0
    record[5, i], record[5, j], record[5, k] = -cv * cu, -cv * su, -sv


@kernel
def superquadric_radius(sizes: Array, p: float, record: Array) -> None:
    """Turn the record of a direction d into that of c = ρ d, ρ = (Σ |d_i/a_i|^p)^(-1/p).

    With S = Σ |d_i/a_i|^p, A_u = S_u/(p S) and B_uv = S_uv/(p S): ρ_u = -ρ A_u and
    ρ_uv = ρ ((p + 1) A_u A_v - B_uv). Only powers p - 2 >= 0 occur, hence finite on the axes.
    """
    largest = 0.0
    for k in range(3):
        largest = max(largest, abs(record[0, k]) / sizes[k])
    total = a_u = a_v = b_uu = b_uv = b_vv = 0.0
    for k in range(3):
        # relative to the largest term, so that no exponent overflows
        ratio = abs(record[0, k]) / (sizes[k] * largest)
        power = ratio ** (p - 2.0)
        total += power * ratio * ratio
        weight = power / (sizes[k] * largest) ** 2
        d, d_u, d_v = record[0, k], record[1, k], record[2, k]
        a_u += weight * d * d_u
        a_v += weight * d * d_v
        b_uu += weight * ((p - 1.0) * d_u * d_u + d * record[3, k])
        b_uv += weight * ((p - 1.0) * d_u * d_v + d * record[4, k])
        b_vv += weight * ((p - 1.0) * d_v * d_v + d * record[5, k])
    rho = total ** (-1.0 / p) / largest
    a_u /= total
    a_v /= total
    rho_u = -rho * a_u
    rho_v = -rho * a_v
    rho_uu = rho * ((p + 1.0) * a_u * a_u - b_uu / total)
    rho_uv = rho * ((p + 1.0) * a_u * a_v - b_uv / total)
    rho_vv = rho * ((p + 1.0) * a_v * a_v - b_vv / total)
    for k in range(3):
        d, d_u, d_v = record[0, k], record[1, k], record[2, k]
        record[0, k] = rho * d
        record[1, k] = rho_u * d + rho * d_u
        record[2, k] = rho_v * d + rho * d_v
        record[3, k] = rho_uu * d + 2.0 * rho_u * d_u + rho * record[3, k]
        record[4, k] = rho_uv * d + rho_u * d_v + rho_v * d_u + rho * record[4, k]
        record[5, k] = rho_vv * d + 2.0 * rho_v * d_v + rho * record[5, k]


@kernel
def ellipsoid_charts(sizes: Array, xi: Array, face: IntArray, out: Array) -> None:
    """Chart records of c = (a_x d_x, a_y d_y, a_z d_z), the direction d of the given poles.

    Args:
        sizes: (3,) half axes [m].
        xi: (n, 2) longitude and latitude [rad].
        face: (n,) 0, 1, 2: poles on z, x, y.
        out: (n, 6, 3) filled with c, c_u, c_v, c_uu, c_uv, c_vv.
    """
    for i in range(xi.shape[0]):
        longitude_latitude(xi[i, 0], xi[i, 1], face[i], out[i])
        for j in range(6):
            for k in range(3):
                out[i, j, k] *= sizes[k]


@kernel
def superellipsoid_charts(sizes: Array, p: float, xi: Array, face: IntArray, out: Array) -> None:
    """Chart records of c = ρ(d) d, see `superquadric_radius`; arguments as `ellipsoid_charts`."""
    for i in range(xi.shape[0]):
        longitude_latitude(xi[i, 0], xi[i, 1], face[i], out[i])
        superquadric_radius(sizes, p, out[i])


@kernel
def superellipse_charts(sizes: Array, p: float, xi: Array, face: IntArray, out: Array) -> None:
    """Chart records of the contour ρ(d) d with d = (cos u, sin u), and z = v.

    Args:
        sizes: (3,) half axes [m], the last one of no effect.
        p: exponent, at least 2.
        xi: (n, 2) polar angle u [rad] and height v [m].
        face: (n,) not used, a contour has one chart.
        out: (n, 6, 3) filled with c, c_u, c_v, c_uu, c_uv, c_vv.
    """
    for i in range(xi.shape[0]):
        c, s = math.cos(xi[i, 0]), math.sin(xi[i, 0])
        out[i] = 0.0
        out[i, 0, 0], out[i, 0, 1] = c, s
        out[i, 1, 0], out[i, 1, 1] = -s, c
        out[i, 3, 0], out[i, 3, 1] = -c, -s
        superquadric_radius(sizes, p, out[i])
        out[i, 0, 2] = xi[i, 1]
        out[i, 2, 2] = 1.0
