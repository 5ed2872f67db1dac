"""A cylinder about z, closed by two flat ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from wbc.arrays import Array, IntArray, read_only
from wbc.compiled import kernel
from wbc.contact.surfaces.base import Domain, Room, Surface, check_sizes

SIDE, TOP, BOTTOM = range(3)


@kernel
def cylinder_charts(sizes: Array, xi: Array, face: IntArray, out: Array) -> None:
    """Chart records of the side and the ends of a cylinder.

    Args:
        sizes: (2,) radius and half length [m].
        xi: (n, 2) on the side the angle [rad] and height [m]; on an end x and y (top) or x and
            -y (bottom), so that the normal points outward [m].
        face: (n,) 0 side, 1 top, 2 bottom.
        out: (n, 6, 3) filled with c, c_u, c_v, c_uu, c_uv, c_vv.
    """
    for i in range(xi.shape[0]):
        out[i] = 0.0
        kind = face[i] % 3
        if kind == 0:
            x = sizes[0] * math.cos(xi[i, 0])
            y = sizes[0] * math.sin(xi[i, 0])
            out[i, 0, 0], out[i, 0, 1], out[i, 0, 2] = x, y, xi[i, 1]
            out[i, 1, 0], out[i, 1, 1] = -y, x
            out[i, 2, 2] = 1.0
            out[i, 3, 0], out[i, 3, 1] = -x, -y
        else:
            sign = 1.0 if kind == 1 else -1.0
            out[i, 0, 0], out[i, 0, 1], out[i, 0, 2] = xi[i, 0], sign * xi[i, 1], sign * sizes[1]
            out[i, 1, 0] = 1.0
            out[i, 2, 1] = sign


@dataclass(frozen=True)
class Cylinder(Surface):
    """A closed cylinder centred on the object frame. F is the signed distance.

    Montana's forms on the side: metric diag(r, 1), curvature diag(1/r, 0), torsion 0.

    Attributes:
        radius: r [m].
        length: full length along z [m].
    """

    planar: ClassVar[bool] = False
    faces: ClassVar[tuple[str, ...]] = ("side", "top", "bottom")
    edged: ClassVar[bool] = True

    radius: float
    length: float
    sizes: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_sizes(self, radius=self.radius, length=self.length)
        object.__setattr__(self, "sizes", read_only([self.radius, 0.5 * self.length]))

    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        cylinder_charts(self.sizes, xi, face, out)

    def domain(self, face: int = 0) -> Domain:
        """The whole side; the square around an end, of which `margin` cuts the corners."""
        r, h = self.radius, 0.5 * self.length
        if face % 3 == SIDE:
            return Domain((-np.pi, -h), (np.pi, h), (2.0 * np.pi, 0.0))
        return Domain((-r, -r), (r, r))

    def margin(self, xi: Array, face: int = 0) -> float:
        """Distance from the nearest rim [m]."""
        if face % 3 == SIDE:
            return 0.5 * self.length - abs(float(xi[1]))
        return self.radius - math.hypot(float(xi[0]), float(xi[1]))

    def room(self, xi: Array, face: int) -> Room:
        """On an end along the radius and across it."""
        if face % 3 == SIDE:
            return super().room(xi, face)
        radius = float(np.linalg.norm(xi))
        x, y = xi / radius if radius > 0.0 else (1.0, 0.0)
        endless = np.full(2, np.inf)
        return Room(np.array([[x, y], [-y, x]]), endless, np.array([self.radius - radius, np.inf]))

    def level(self, p: Array) -> float:
        out, up = self._beyond(p)
        return math.hypot(max(out, 0.0), max(up, 0.0)) + min(max(out, up), 0.0)

    def level_gradient(self, p: Array) -> Array:
        """Away from the closest point; on the axis seen from inside, along x."""
        out, up = self._beyond(p)
        if max(out, up) > 0.0:
            weights = np.array([max(out, 0.0), max(up, 0.0)])
            weights /= np.linalg.norm(weights)
        else:
            weights = np.array([1.0, 0.0]) if out >= up else np.array([0.0, 1.0])
        angle = math.atan2(p[1], p[0])
        across = weights[0] * np.array([math.cos(angle), math.sin(angle), 0.0])
        out_and_up: Array = across + np.array([0.0, 0.0, math.copysign(weights[1], p[2])])
        return out_and_up

    def project(self, p: Array, face: int | None = None) -> tuple[Array, int]:
        """The closest point; beyond a rim, on the face that p stands out of most."""
        if face is None:
            out, up = self._beyond(p)
            face = SIDE if out >= up else (TOP if p[2] >= 0.0 else BOTTOM)
        h = 0.5 * self.length
        if face % 3 == SIDE:
            return np.array([math.atan2(p[1], p[0]), min(max(float(p[2]), -h), h)]), face
        xi = np.array([p[0], p[1] if face % 3 == TOP else -p[1]], dtype=np.float64)
        return xi * min(1.0, self.radius / max(float(np.linalg.norm(xi)), 1e-300)), face

    def mesh(self, n: int = 48, half_thickness: float = 0.05) -> tuple[Array, IntArray]:
        """A prism of n sides; the ends are fans about their centres."""
        u = np.linspace(-np.pi, np.pi, n, endpoint=False)
        h = 0.5 * self.length
        low, high = (self.charts(np.column_stack([u, np.full(n, z)]))[:, 0] for z in (-h, h))
        points = np.vstack([low, high, [[0.0, 0.0, -h], [0.0, 0.0, h]]])
        i = np.arange(n)
        j = np.roll(i, -1)
        triangles = np.vstack(
            [
                np.column_stack([i, j, j + n]),
                np.column_stack([i, j + n, i + n]),
                np.column_stack([j, i, np.full(n, 2 * n)]),
                np.column_stack([i + n, j + n, np.full(n, 2 * n + 1)]),
            ]
        )
        return points, triangles.astype(np.int64)

    def convex_pieces(self, thickness: float = 2.0, excess: float = 1e-3) -> list[Array]:
        """One prism whose sides touch the cylinder."""
        sides = int(np.clip(math.ceil(np.pi * math.sqrt(0.5 * self.radius / excess)), 12, 128))
        points, _ = self.mesh(sides)
        return [points[: 2 * sides] * np.array([*[1.0 / math.cos(np.pi / sides)] * 2, 1.0])]

    def _beyond(self, p: Array) -> tuple[float, float]:
        """How far p is beyond the side and beyond the ends; negative inside [m]."""
        return math.hypot(p[0], p[1]) - self.radius, abs(float(p[2])) - 0.5 * self.length
