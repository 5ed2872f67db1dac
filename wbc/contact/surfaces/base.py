"""What every object surface offers: charts, an implicit function, the closest point, and its body.

A surface is covered by one or more charts c(u, v), in metres in the object frame O, the closed-form
description of the object from which the chapter takes its Gauss frame (text between (27) and (28)).
The tick calls `Surface.evaluate` and nothing else; the rest serves loading, planning and drawing.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.errors import UnknownNameError, WbcError

POINT, D_U, D_V, D_UU, D_UV, D_VV = range(6)
"""Rows of a chart record (6,3): c, c_u, c_v, c_uu, c_uv, c_vv."""


@dataclass(frozen=True)
class Domain:
    """The rectangle of (u, v) that one chart uses.

    Attributes:
        lower, upper: (2,) bounds [rad or m], infinite where there are none.
        period: (2,) 2π for an angle that closes on itself, else 0.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    period: tuple[float, float] = (0.0, 0.0)

    def wrap(self, xi: Array) -> Array:
        """xi (2,) with its periodic coordinates brought into [lower, upper)."""
        out = np.array(xi, dtype=np.float64)
        for k in range(2):
            if self.period[k] > 0.0:
                out[k] = self.lower[k] + (out[k] - self.lower[k]) % self.period[k]
        return out

    def margin(self, xi: Array) -> float:
        """Distance of xi (2,) from the nearest bound, negative outside; periods have no bound."""
        out = math.inf
        for k in range(2):
            if self.period[k] == 0.0:
                out = min(out, float(xi[k]) - self.lower[k], self.upper[k] - float(xi[k]))
        return out


class Room(NamedTuple):
    """How far a contact can slide on its face.

    Attributes:
        axes: (2, 2) rows: two perpendicular directions in (u, v).
        back, ahead: (2,) way to the edge against and along each of them, negative beyond the edge,
            inf where there is none.
    """

    axes: Array
    back: Array
    ahead: Array


class Surface(ABC):
    """The surface of a rigid object as charts c(u, v) with outward normal c_u x c_v.

    A final class is a frozen dataclass of sizes in metres. `face` selects the chart of a contact:
    a side of a box, or which axis holds the poles of a sphere. An integer that names no face
    selects some face, so that `evaluate` can never fail.

    Attributes:
        planar: True for a contour, the cylinder (x(u), y(u), v) whose v stays 0.
        faces: names of the charts; a contact stores the index into this tuple.
        poles: True where a contact that slides towards a pole of its chart needs another one.
        edged: True where a contact that slides on a face can come to its edge.
    """

    planar: ClassVar[bool]
    faces: ClassVar[tuple[str, ...]]
    poles: ClassVar[bool] = False
    edged: ClassVar[bool] = False

    @abstractmethod
    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        """Fill the chart records of n contacts. Allocates nothing, never fails, no NaN.

        Args:
            xi: (n, 2) chart coordinates (u, v).
            face: (n,) int64, the chart of each contact.
            out: (n, 6, 3) filled with c [m], c_u, c_v, c_uu, c_uv, c_vv in the object frame.
        """

    @abstractmethod
    def domain(self, face: int = 0) -> Domain:
        """The bounds of a chart."""

    @abstractmethod
    def margin(self, xi: Array, face: int = 0) -> float:
        """How far xi (2,) is inside the part of the chart fit for a contact; negative outside it.

        In the unit of the coordinate that is nearest to its bound. The bound is an edge of the face
        or the latitude near a chart pole beyond which another face should be used.
        """

    @abstractmethod
    def level(self, p: Array) -> float:
        """F(p) [m]: negative inside, zero on the surface, positive outside; |grad F| = 1 on it.

        p: (3,) in the object frame; for a contour z is ignored.
        """

    @abstractmethod
    def level_gradient(self, p: Array) -> Array:
        """grad F (3,), the outward unit normal on the surface; finite also where F has a kink."""

    @abstractmethod
    def project(self, p: Array, face: int | None = None) -> tuple[Array, int]:
        """Chart coordinates (2,) of the surface point closest to p (3,), and their face.

        With `face` given, in that chart; otherwise in the one that suits the point best.
        """

    @abstractmethod
    def mesh(self, n: int = 48, half_thickness: float = 0.05) -> tuple[Array, IntArray]:
        """A closed, outward-oriented triangle mesh with vertices on the surface, to be drawn.

        Args:
            n: divisions of the full turn.
            half_thickness: [m] a contour is drawn from -half_thickness to +half_thickness.

        Returns:
            vertices (k, 3) [m] in the object frame, triangles (m, 3).
        """

    @abstractmethod
    def convex_pieces(self, thickness: float = 2.0, excess: float = 1e-3) -> list[Array]:
        """Vertices (k, 3) of convex pieces whose union contains the body, for collision checks.

        Args:
            thickness: [m] of an extruded contour; thick, so that a planar finger that touches it
                is pushed out within the plane.
            excess: [m] how far the union may stand out of the body.
        """

    def regular(self, xi: Array, face: int = 0) -> bool:
        """Whether xi (2,) is in the part of the chart fit for a contact."""
        return self.margin(xi, face) >= 0.0

    def rechart(self, xi: Array, face: int) -> tuple[Array, int] | None:
        """Coordinates and face of a chart that suits the point xi (2,) better, None to stay."""
        return None

    def room(self, xi: Array, face: int) -> Room:
        """How far xi (2,) is from the edges of its face, in its unit."""
        domain = self.domain(face)
        endless = np.array(domain.period) > 0.0
        back = np.where(endless, np.inf, xi - np.array(domain.lower))
        ahead = np.where(endless, np.inf, np.array(domain.upper) - xi)
        return Room(np.eye(2), back, ahead)

    def charts(self, xi: Array, face: IntArray | int = 0) -> Array:
        """As `evaluate`, into a new array. xi: (n, 2) -> (n, 6, 3)."""
        points = np.ascontiguousarray(xi, dtype=np.float64).reshape(-1, 2)
        faces = np.ascontiguousarray(np.broadcast_to(face, points.shape[:1]), dtype=np.int64)
        out = np.empty((points.shape[0], 6, 3))
        self.evaluate(points, faces, out)
        return out

    def point(self, xi: Array, face: int = 0) -> Array:
        """c(xi) (3,) [m] in the object frame."""
        out: Array = self.charts(np.asarray(xi), face)[0, POINT]
        return out

    def face_index(self, name: str) -> int:
        """The index of the chart called `name`."""
        if name not in self.faces:
            raise UnknownNameError("face", name, self.faces)
        return self.faces.index(name)


def check_sizes(surface: Surface, **sizes: Any) -> None:
    """Refuse a size that is not a positive finite number."""
    for name, value in sizes.items():
        for number in np.atleast_1d(np.asarray(value, dtype=np.float64)):
            if not (math.isfinite(number) and number > 0.0):
                raise WbcError(
                    f"{type(surface).__name__}: {name} = {value} must be positive and finite [m]"
                )


def check_exponent(surface: Surface, exponent: float) -> None:
    """Refuse an exponent below 2, for its infinite curvature on the axes, or like a box's."""
    if not 2.0 <= exponent <= 100.0:
        raise WbcError(f"{type(surface).__name__}: p = {exponent} must be from 2 to 100")
