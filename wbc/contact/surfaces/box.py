"""A box: six flat faces."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import ClassVar

import numpy as np

from wbc.arrays import Array, IntArray, read_only
from wbc.compiled import kernel
from wbc.contact.surfaces.base import Domain, Surface, check_sizes
from wbc.errors import WbcError

# Columns: axis of u, its sign, axis of v, its sign, axis of the normal, its sign. On the four sides
# v points up along z; everywhere c_u x c_v is the outward normal.
LAYOUT = (
    (1, 1.0, 2, 1.0, 0, 1.0),
    (1, -1.0, 2, 1.0, 0, -1.0),
    (0, -1.0, 2, 1.0, 1, 1.0),
    (0, 1.0, 2, 1.0, 1, -1.0),
    (0, 1.0, 1, 1.0, 2, 1.0),
    (0, 1.0, 1, -1.0, 2, -1.0),
)


@kernel
def box_charts(half: Array, xi: Array, face: IntArray, out: Array) -> None:
    """Chart records of the faces of a box.

    Args:
        half: (3,) half sizes [m].
        xi: (n, 2) distances from the middle of the face [m].
        face: (n,) 0 to 5: x+, x-, y+, y-, z+, z-.
        out: (n, 6, 3) filled with c, c_u, c_v and zeros.
    """
    for i in range(xi.shape[0]):
        axis_u, sign_u, axis_v, sign_v, axis_n, sign_n = LAYOUT[face[i] % 6]
        out[i] = 0.0
        out[i, 0, axis_n] = sign_n * half[axis_n]
        out[i, 0, axis_u] = sign_u * xi[i, 0]
        out[i, 0, axis_v] = sign_v * xi[i, 1]
        out[i, 1, axis_u] = sign_u
        out[i, 2, axis_v] = sign_v


@dataclass(frozen=True)
class Box(Surface):
    """A box centred on the object frame. F is the signed distance.

    Attributes:
        size: full lengths along x, y, z [m].
    """

    planar: ClassVar[bool] = False
    faces: ClassVar[tuple[str, ...]] = ("x+", "x-", "y+", "y-", "z+", "z-")
    edged: ClassVar[bool] = True

    size: tuple[float, float, float]
    half: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.size) != 3:
            raise WbcError(f"Box: size = {list(self.size)} must be three lengths [x, y, z]")
        check_sizes(self, size=self.size)
        object.__setattr__(self, "size", tuple(float(x) for x in self.size))
        object.__setattr__(self, "half", read_only(0.5 * np.array(self.size)))

    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        box_charts(self.half, xi, face, out)

    def domain(self, face: int = 0) -> Domain:
        """The rectangle of the face."""
        axis_u, _, axis_v, *_ = LAYOUT[face % 6]
        u, v = float(self.half[axis_u]), float(self.half[axis_v])
        return Domain((-u, -v), (u, v))

    def margin(self, xi: Array, face: int = 0) -> float:
        """Distance from the nearest edge of the face [m]."""
        return self.domain(face).margin(xi)

    def level(self, p: Array) -> float:
        beyond = np.abs(p) - self.half
        outside = float(np.linalg.norm(np.maximum(beyond, 0.0)))
        return outside + min(float(np.max(beyond)), 0.0)

    def level_gradient(self, p: Array) -> Array:
        """Away from the closest point; at an edge seen from inside, along one of its faces."""
        beyond = np.abs(p) - self.half
        sign = np.where(np.asarray(p) < 0.0, -1.0, 1.0)
        if np.max(beyond) > 0.0:
            away = np.maximum(beyond, 0.0)
            outward: Array = sign * away / np.linalg.norm(away)
            return outward
        out = np.zeros(3)
        axis = int(np.argmax(beyond))
        out[axis] = sign[axis]
        return out

    def project(self, p: Array, face: int | None = None) -> tuple[Array, int]:
        """The closest point; beyond an edge, on the face that p stands out of most."""
        q = np.asarray(p, dtype=np.float64)
        if face is None:
            axis = int(np.argmax(np.abs(q) - self.half))
            face = 2 * axis + int(q[axis] < 0.0)
        axis_u, sign_u, axis_v, sign_v, *_ = LAYOUT[face % 6]
        domain = self.domain(face)
        xi = np.array([sign_u * q[axis_u], sign_v * q[axis_v]])
        return np.clip(xi, domain.lower, domain.upper), face

    def mesh(self, n: int = 48, half_thickness: float = 0.05) -> tuple[Array, IntArray]:
        """Eight corners, twelve triangles."""
        corners = [
            self.charts(np.array([[-u, -v], [u, -v], [u, v], [-u, v]]), face)[:, 0]
            for face in range(6)
            for u, v in [self.domain(face).upper]
        ]
        points, index = np.unique(np.vstack(corners), axis=0, return_inverse=True)
        quads = index.reshape(6, 4)
        return points, np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int64)

    def convex_pieces(self, thickness: float = 2.0, excess: float = 1e-3) -> list[Array]:
        """The eight corners."""
        return [self.half * np.array(list(product((-1.0, 1.0), repeat=3)))]
