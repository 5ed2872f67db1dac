"""Triangle meshes the viewer needs: extruded contours, capsules, ribbons."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array, IntArray

Mesh = tuple[Array, IntArray]
"""Vertices (n, 3) and triangles (k, 3), seen counter-clockwise from outside."""


def _cross(a: Array, b: Array) -> Array:
    """z of the cross product of planar vectors."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def triangulate(contour: Array) -> IntArray:
    """Ear clipping of a simple counter-clockwise polygon (n, 2): (n - 2, 3) indices."""
    points = np.asarray(contour, dtype=np.float64)
    left = list(range(len(points)))
    triangles = []
    while len(left) > 3:
        ear = next((i for i in range(len(left)) if _is_ear(points, left, i)), 0)
        n = len(left)
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % n]))
        del left[ear]
    triangles.append((left[0], left[1], left[2]))
    return np.array(triangles, dtype=np.int64)


def _is_ear(points: Array, left: list[int], i: int) -> bool:
    a, b, c = points[left[i - 1]], points[left[i]], points[left[(i + 1) % len(left)]]
    if float(_cross(b - a, c - b)) <= 0.0:
        return False
    keep = [k for k in left if k not in (left[i - 1], left[i], left[(i + 1) % len(left)])]
    others = points[keep]
    inside = (
        (_cross(b - a, others - a) >= 0.0)
        & (_cross(c - b, others - b) >= 0.0)
        & (_cross(a - c, others - c) >= 0.0)
    )
    return not bool(inside.any())


def extrude(contour: Array, bottom: float, top: float) -> Mesh:
    """The prism over a closed planar contour (n, 2), given in either sense of rotation.

    Caps and wall have vertices of their own, so that shading is smooth along the wall and sharp at
    its rim.
    """
    ring = np.asarray(contour, dtype=np.float64)[:, :2]
    if np.allclose(ring[0], ring[-1]):
        ring = ring[:-1]
    if float(_cross(ring, np.roll(ring, -1, axis=0)).sum()) < 0.0:
        ring = ring[::-1]
    n = len(ring)
    low = np.column_stack((ring, np.full(n, bottom)))
    high = np.column_stack((ring, np.full(n, top)))
    caps = triangulate(ring)
    k = np.arange(n)
    after = (k + 1) % n
    wall = np.concatenate(
        (np.column_stack((k, after, n + after)), np.column_stack((k, n + after, n + k)))
    )
    vertices = np.concatenate((low, high, low, high))
    return vertices, np.concatenate((wall, caps[:, ::-1] + 2 * n, caps + 3 * n))


def capsule(radius: float, length: float, around: int = 24, rings: int = 6) -> Mesh:
    """A capsule about z: cylinder of `length` with half spheres at both ends."""
    angle = np.linspace(-np.pi / 2, 0.0, rings + 1)
    r = radius * np.cos(np.concatenate((angle, -angle[::-1])))
    z = radius * np.sin(np.concatenate((angle, -angle[::-1])))
    z[: rings + 1] -= length / 2
    z[rings + 1 :] += length / 2
    return revolved(r, z, around)


def revolved(r: Array, z: Array, around: int) -> Mesh:
    """The surface that a profile of radii r and heights z, upwards, (k,), sweeps about z."""
    turn = np.linspace(0.0, 2 * np.pi, around, endpoint=False)
    vertices = np.stack(
        (np.outer(r, np.cos(turn)), np.outer(r, np.sin(turn)), np.outer(z, np.ones(around))), 2
    ).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(len(r) - 1), np.arange(around), indexing="ij")
    a = (row * around + column).ravel()
    b = (row * around + (column + 1) % around).ravel()
    triangles = np.concatenate(
        (np.column_stack((a, b, b + around)), np.column_stack((a, b + around, a + around)))
    )
    return vertices, triangles


def ribbon(line: Array, width: float, height: float) -> Mesh:
    """A closed planar polyline as a flat band at `height`: WebGL draws lines one pixel thin."""
    ring = np.asarray(line, dtype=np.float64)[:, :2]
    if np.allclose(ring[0], ring[-1]):
        ring = ring[:-1]
    along = np.roll(ring, -1, axis=0) - np.roll(ring, 1, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    side = 0.5 * width * np.column_stack((along[:, 1], -along[:, 0]))
    n = len(ring)
    vertices = np.column_stack((np.concatenate((ring - side, ring + side)), np.full(2 * n, height)))
    k = np.arange(n)
    after = (k + 1) % n
    triangles = np.concatenate(
        (np.column_stack((k, n + k, n + after)), np.column_stack((k, n + after, after)))
    )
    return vertices, triangles
