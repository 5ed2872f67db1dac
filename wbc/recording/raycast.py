"""Solids as a shaded picture: rays through pixels, the nearest hit wins. No renderer, no browser.

With parallel rays a ball, a rod, a box or a triangle is hit where a linear or quadratic equation
says, so that a whole solid is one expression over its pixels.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from wbc.arrays import Array, IntArray
from wbc.recording.silhouette import View

_LIGHT = (-0.35, 0.55, 0.76)  # to the lamp: left, above, from the eye's side
_AMBIENT = 0.46
_LINE = (0.16, 0.18, 0.22)
_AT_ONCE = 1_000_000
_FINE = 2  # rays per pixel and axis


@final
class Picture:
    """A picture being made: colour, depth and normal of what each ray has hit so far."""

    def __init__(self, view: View, low: Array, high: Array, width: int) -> None:
        """
        Args:
            low, high: (2,) corners in picture coordinates, [m].
            width: of the picture, [pixel].
        """
        self._view = view
        self._low = low
        self._step = float(high[0] - low[0]) / (width * _FINE)
        rows = max(round(float(high[1] - low[1]) / self._step / _FINE), 1) * _FINE
        self._depth = np.full((rows, width * _FINE), -np.inf)
        self._normal = np.zeros((rows, width * _FINE, 3))
        self._color = np.ones((rows, width * _FINE, 3))

    def solid(
        self, kind: str, size: tuple[float, ...], pose: Array, rgb: tuple[float, ...]
    ) -> None:
        """Draw a ``sphere``, ``cylinder``, ``capsule`` or ``box``, see `silhouette.outline`."""
        half = half_extent(kind, size)
        axes = np.stack((self._view.right, self._view.up, self._view.towards))
        turn, middle = axes @ pose[:3, :3], axes @ pose[:3, 3]  # in the picture's axes
        reach = np.abs(turn) @ half
        window, u, v = self._window(middle[:2] - reach[:2], middle[:2] + reach[:2])
        if not u.size:
            return
        # rays start in the plane through the solid's middle and run towards the eye, in its axes
        start = (u - middle[0])[..., None] * turn[0] + (v - middle[1])[..., None] * turn[1]
        along, normal = _hit(kind, size, start, turn[2])
        self._take(window, middle[2] + along, normal @ turn.T, rgb)

    def mesh(
        self, vertices: Array, triangles: IntArray, pose: Array, rgb: tuple[float, ...]
    ) -> None:
        """Draw a mesh, its faces seen from both sides."""
        axes = np.stack((self._view.right, self._view.up, self._view.towards))
        turned = (vertices @ pose[:3, :3].T + pose[:3, 3]) @ axes.T
        smooth = vertex_normals(turned, triangles)
        corners = turned[triangles]
        with np.errstate(invalid="ignore"):  # a vertex that is no number: its faces are left out
            corners[..., :2] = (corners[..., :2] - self._low) / self._step - 0.5  # rays at integers
        low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
        limit = np.array(self._depth.shape[::-1]) - 1
        known = np.isfinite(corners).all(axis=(1, 2))
        first = np.clip(np.ceil(np.where(known[:, None], low, 0.0)), 0, limit + 1).astype(int)
        last = np.clip(np.floor(np.where(known[:, None], high, -1.0)), -1, limit).astype(int)
        size = (last - first + 1).min(axis=1), (last - first + 1).max(axis=1)
        left = np.flatnonzero(size[0] > 0)  # the others lie between the rays
        edge = 1
        while len(left):  # triangles of like size together, as many as fit into memory at once
            fits = left[size[1][left] <= edge]
            for part in np.array_split(fits, max(len(fits) * edge * edge // _AT_ONCE, 1)):
                if len(part):
                    self._faces(corners[part], smooth[triangles[part]], first[part], edge, rgb)
            left = left[size[1][left] > edge]
            edge *= 2

    def _faces(
        self, corners: Array, normals: Array, first: IntArray, edge: int, rgb: tuple[float, ...]
    ) -> None:
        """Triangles (m, 3, 3), each within the square of `edge` rays from `first` (m, 2) on."""
        steps = np.arange(edge)
        x = first[:, :1, None] + steps  # (m, 1, edge)
        y = first[:, 1:, None] + steps[:, None]
        a, b, c = (corners[:, k, :, None, None] for k in range(3))
        area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = ((x - a[:, 0]) * (c - a)[:, 1] - (y - a[:, 1]) * (c - a)[:, 0]) / area
            t = ((y - a[:, 1]) * (b - a)[:, 0] - (x - a[:, 0]) * (b - a)[:, 1]) / area
        rows, columns = self._depth.shape
        inside = (s >= -1e-9) & (t >= -1e-9) & (s + t <= 1.0 + 1e-9) & (x < columns) & (y < rows)
        face, j, i = np.nonzero(inside)
        s, t = s[inside], t[inside]
        parts = np.column_stack((1.0 - s - t, s, t))
        depth = np.sum(parts * corners[face, :, 2], axis=1)
        pixel = (first[face, 1] + j) * columns + first[face, 0] + i
        order = np.lexsort((depth, pixel))  # of the hits of one ray the nearest comes last
        nearest = order[np.append(np.diff(pixel[order]) > 0, True)] if len(order) else order
        seen = nearest[depth[nearest] > self._depth.ravel()[pixel[nearest]]]
        at = np.unravel_index(pixel[seen], self._depth.shape)
        side = np.sign(area[face[seen], 0])
        self._depth[at] = depth[seen]
        self._normal[at] = side * np.sum(parts[seen, :, None] * normals[face[seen]], axis=1)
        self._color[at] = rgb

    def image(self) -> Array:
        """(rows, columns, 3) in 0..1, the upper row first; white where nothing was hit."""
        seen = np.isfinite(self._depth)
        light = np.array(_LIGHT) / np.linalg.norm(_LIGHT)
        shade = _AMBIENT + (1.0 - _AMBIENT) * np.clip(self._normal @ light, 0.0, None)
        color = np.where(seen[..., None], self._color * shade[..., None], 1.0)
        color = np.where(self._edges()[..., None], _LINE, color)
        rows, columns = (n // _FINE for n in seen.shape)
        fine = color.reshape(rows, _FINE, columns, _FINE, 3)
        out: Array = np.clip(fine.mean(axis=(1, 3)), 0.0, 1.0)[::-1]
        return out

    def _edges(self) -> NDArray[np.bool_]:
        """Where something stands before something else by more than a slope explains."""
        depth = np.where(np.isfinite(self._depth), self._depth, -1e3)
        edge = np.zeros(depth.shape, dtype=bool)
        for axis in (0, 1):
            step = np.abs(np.diff(depth, axis=axis))
            jump = step > 8.0 * self._step
            # the line lies on the nearer side
            nearer = np.diff(depth, axis=axis) < 0.0
            low, high = [slice(None)] * 2, [slice(None)] * 2
            low[axis], high[axis] = slice(None, -1), slice(1, None)
            edge[tuple(low)] |= jump & nearer
            edge[tuple(high)] |= jump & ~nearer
        return edge

    def _window(self, low: Array, high: Array) -> tuple[tuple[slice, slice], Array, Array]:
        """Pixels that a rectangle of the picture covers, and the rays' coordinates in them."""
        first = np.floor((low - self._low) / self._step - 0.5).astype(int)
        last = np.ceil((high - self._low) / self._step + 0.5).astype(int)
        limit = np.array(self._depth.shape[::-1])
        (i, j), (m, n) = np.clip(first, 0, limit), np.clip(last, 0, limit)
        u = self._low[0] + (np.arange(i, m) + 0.5) * self._step
        v = self._low[1] + (np.arange(j, n) + 0.5) * self._step
        return (slice(j, n), slice(i, m)), *np.meshgrid(u, v)

    def _take(
        self, window: tuple[slice, slice], depth: Array, normal: Array, rgb: tuple[float, ...]
    ) -> None:
        nearer = depth > self._depth[window]
        self._depth[window][nearer] = depth[nearer]
        self._normal[window][nearer] = normal[nearer]
        self._color[window][nearer] = rgb


def vertex_normals(vertices: Array, triangles: IntArray) -> Array:
    """(n, 3) unit normals, faces weighed by their areas; 0 at a vertex without faces."""
    corners = vertices[triangles]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    at, count = triangles.ravel(), len(vertices)
    sums = [np.bincount(at, weights=np.repeat(x, 3), minlength=count) for x in face.T]
    out: Array = np.column_stack(sums).astype(np.float64)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    out /= np.where(length > 0.0, length, 1.0)
    return out


def half_extent(kind: str, size: tuple[float, ...]) -> Array:
    """(3,) half edges of the box around a solid, in its own axes."""
    if kind == "box":
        return 0.5 * np.array(size)
    half = 0.5 * size[1] if len(size) > 1 else 0.0
    return np.array((size[0], size[0], half if kind == "cylinder" else half + size[0]))


def _hit(kind: str, size: tuple[float, ...], start: Array, ray: Array) -> tuple[Array, Array]:
    """How far along `ray` (3,) from `start` (…, 3) the last point of a solid is, and its normal.

    Depth -inf where the ray passes by. All in the solid's axes.
    """
    if kind == "box":
        return _slabs(0.5 * np.array(size), start, ray)
    if kind == "sphere":
        return _ball(start, ray, size[0], 0.0)
    radius, half = size[0], 0.5 * size[1]
    side = _side(start, ray, radius, half)
    ends = [
        _ball(start, ray, radius, z) if kind == "capsule" else _lid(start, ray, radius, z)
        for z in (-half, half)
    ]
    depth, normal = side
    for other, its_normal in ends:
        nearer = other > depth
        depth = np.where(nearer, other, depth)
        normal = np.where(nearer[..., None], its_normal, normal)
    return depth, normal


def _ball(start: Array, ray: Array, radius: float, z: float) -> tuple[Array, Array]:
    off = start - (0.0, 0.0, z)
    b = off @ ray
    inside = b * b - np.sum(off * off, axis=-1) + radius * radius
    along = np.where(inside >= 0.0, -b + np.sqrt(np.maximum(inside, 0.0)), -np.inf)
    hit = off + np.where(inside >= 0.0, along, 0.0)[..., None] * ray
    return along, hit / radius


def _side(start: Array, ray: Array, radius: float, half: float) -> tuple[Array, Array]:
    a = float(ray[0] ** 2 + ray[1] ** 2)
    if a < 1e-12:
        return np.full(start.shape[:-1], -np.inf), np.zeros(start.shape)
    b = start[..., 0] * ray[0] + start[..., 1] * ray[1]
    c = start[..., 0] ** 2 + start[..., 1] ** 2 - radius * radius
    inside = b * b - a * c
    along = (-b + np.sqrt(np.maximum(inside, 0.0))) / a
    hit = start + along[..., None] * ray
    along = np.where((inside >= 0.0) & (np.abs(hit[..., 2]) <= half), along, -np.inf)
    return along, hit * (1.0 / radius, 1.0 / radius, 0.0)


def _lid(start: Array, ray: Array, radius: float, z: float) -> tuple[Array, Array]:
    if abs(ray[2]) < 1e-9:
        return np.full(start.shape[:-1], -np.inf), np.zeros(start.shape)
    along = (z - start[..., 2]) / ray[2]
    hit = start + along[..., None] * ray
    along = np.where(hit[..., 0] ** 2 + hit[..., 1] ** 2 <= radius * radius, along, -np.inf)
    return along, np.broadcast_to((0.0, 0.0, np.sign(z)), start.shape)


def _slabs(half: Array, start: Array, ray: Array) -> tuple[Array, Array]:
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(((-half - start) / ray, (half - start) / ray))
    flat = np.abs(ray) < 1e-9
    inside = np.where(flat, np.abs(start) <= half, True).all(axis=-1)
    leave = np.where(flat, np.inf, ends.max(axis=0))
    enter = np.where(flat, -np.inf, ends.min(axis=0))
    along, axis = leave.min(axis=-1), leave.argmin(axis=-1)
    along = np.where(inside & (along >= enter.max(axis=-1)), along, -np.inf)
    return along, np.eye(3)[axis] * np.sign(ray)[axis][..., None]
