"""The foot of a point: the surface point closest to it, as a chart record."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.contact.surfaces.base import D_U, D_V, POINT, Surface

_FLAT = np.array([1.0, 1.0, 0.0])
_BESIDE = 1e-6  # [m] tangential distance from point to foot at which a foot is none any more


def flat(surface: Surface, p: Array) -> Array:
    """Points (..., 3) as a surface takes them: of a contour z does not count."""
    out: Array = p * _FLAT if surface.planar else p
    return out


def sought(surface: Surface, p: Array) -> tuple[Array, int, Array]:
    """Chart coordinates (2,), face and record (6, 3) of the foot of p (3,), by search."""
    xi, face = surface.project(p)
    return xi, face, surface.charts(xi[None], face)[0]


def is_foot(surface: Surface, xi: Array, face: int, record: Array, p: Array) -> bool:
    """Whether a foot that was followed has arrived below p (3,), in what its chart is good for."""
    gap, c_u, c_v = p - record[POINT], record[D_U], record[D_V]
    beside = max(abs(gap @ c_u) / np.linalg.norm(c_u), abs(gap @ c_v) / np.linalg.norm(c_v))
    return bool(surface.margin(xi, face) >= 0.0 and beside < _BESIDE)


def outward(records: Array) -> Array:
    """Outward unit normals (n, 3) of chart records (n, 6, 3), object frame."""
    normals = np.cross(records[:, D_U], records[:, D_V])
    out: Array = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return out
