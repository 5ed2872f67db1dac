"""What the round bodies share: three charts by longitude and latitude, one per axis of poles."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.spatial import ConvexHull

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.surfaces.base import POINT, Domain, Surface
from wbc.contact.surfaces.closest import refine
from wbc.contact.surfaces.gauge import gauge, gauge_level, gauge_level_gradient, support

DOMAIN = Domain((-np.pi, -0.5 * np.pi), (np.pi, 0.5 * np.pi), (2.0 * np.pi, 0.0))
REGULAR_LATITUDE = math.radians(70.0)


class PolarSurface(Surface):
    """A body Σ |x_i/a_i|^p <= 1 under charts (u, v) = (longitude, latitude), in rad.

    In that order c_u x c_v points outward. The torsion of the contact frame grows as tan v, so a
    chart is fit for a contact up to 70° of latitude. The three faces put the poles on z, x and y:
    every point is below 36° of latitude in one of them.
    F is the distance to first order, see `gauge.gauge_level`.
    """

    planar: ClassVar[bool] = False
    faces: ClassVar[tuple[str, ...]] = ("poles_z", "poles_x", "poles_y")
    poles: ClassVar[bool] = True

    @property
    @abstractmethod
    def half_axes(self) -> Array:
        """(a_x, a_y, a_z) [m]."""

    @property
    @abstractmethod
    def exponent(self) -> float:
        """p; 2 for spheres and spheroids."""

    @abstractmethod
    def direction(self, point: Array) -> Array:
        """A vector (3,) whose longitude and latitude are the coordinates of a surface point."""

    def domain(self, face: int = 0) -> Domain:
        return DOMAIN

    def margin(self, xi: Array, face: int = 0) -> float:
        """70° less the latitude [rad]."""
        return REGULAR_LATITUDE - abs(float(xi[1]))

    def rechart(self, xi: Array, face: int) -> tuple[Array, int] | None:
        """Beyond 70° the chart of least latitude: at most 36°, so there is no way straight back."""
        if self.margin(xi, face) >= 0.0:
            return None
        point = self.point(xi, face)
        charts = [self.coordinates(point, k) for k in range(3)]
        best = int(np.argmin([abs(coordinates[1]) for coordinates in charts]))
        return charts[best], best

    def level(self, p: Array) -> float:
        return gauge_level(p, self.half_axes, self.exponent)

    def level_gradient(self, p: Array) -> Array:
        return gauge_level_gradient(p, self.half_axes, self.exponent)

    def coordinates(self, point: Array, face: int) -> Array:
        """Chart coordinates (2,) of a surface point (3,) in one chart."""
        d = np.roll(self.direction(point), -face)
        return np.array([math.atan2(d[1], d[0]), math.atan2(d[2], math.hypot(d[0], d[1]))])

    @cached_property
    def seeds(self) -> tuple[Array, IntArray, Array]:
        """Where a search starts: chart coordinates (s, 2), faces (s,) and points (s, 3)."""
        u, v = np.meshgrid(np.radians(np.arange(-180, 180, 10)), np.radians(np.arange(-45, 46, 9)))
        xi = np.tile(np.column_stack([u.ravel(), v.ravel()]), (3, 1))
        face = np.repeat(np.arange(3), u.size)
        face.setflags(write=False)
        return read_only(xi), face, read_only(self.charts(xi, face)[:, POINT])

    def project(self, p: Array, face: int | None = None) -> tuple[Array, int]:
        """The closest point, on poles_z up to 70° of latitude, else where its latitude is least.

        Newton steps start at the nearest points of a table.
        """
        q = np.asarray(p, dtype=np.float64)
        xi, faces, points = self.seeds
        near = np.argsort(np.sum((points - q) ** 2, axis=1))[:8]
        found, value = refine(self, q, xi[near], faces[near])
        best = int(np.argmin(value))
        foot = self.charts(found[best], faces[near[best]])[0, POINT]
        if face is None:
            latitudes = [abs(self.coordinates(foot, k)[1]) for k in range(3)]
            face = 0 if latitudes[0] <= REGULAR_LATITUDE else int(np.argmin(latitudes))
        return self.coordinates(foot, face), face

    def mesh(self, n: int = 48, half_thickness: float = 0.05) -> tuple[Array, IntArray]:
        """Rings of equal latitude about z, closed by the two poles."""
        rings = max(n // 2 - 1, 1)
        v = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rings + 2)[1:-1]
        u = np.linspace(-np.pi, np.pi, n, endpoint=False)
        xi = np.column_stack([np.tile(u, rings), np.repeat(v, n)])
        poles = self.half_axes[2] * np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
        points = np.vstack([self.charts(xi, 0)[:, POINT], poles])
        here = np.arange(n)
        following = np.roll(here, -1)
        south, north = np.full(n, rings * n), np.full(n, rings * n + 1)
        top = (rings - 1) * n
        parts = [np.column_stack([following, here, south])]
        for k in range(rings - 1):
            low, high = k * n, (k + 1) * n
            parts.append(np.column_stack([here + low, following + low, following + high]))
            parts.append(np.column_stack([here + low, following + high, here + high]))
        parts.append(np.column_stack([here + top, following + top, north]))
        return points, np.vstack(parts).astype(np.int64)

    def convex_pieces(self, thickness: float = 2.0, excess: float = 1e-3) -> list[Array]:
        """Points spread over the body, blown up until no facet of their hull cuts into it."""
        count = 64
        while True:
            spread = spiral(count) * self.half_axes
            points = spread / gauge(spread, self.half_axes, self.exponent)[:, None]
            facets = ConvexHull(points).equations
            reach = support(facets[:, :3], self.half_axes, self.exponent)
            factor = float(np.max(-reach / facets[:, 3]))
            beyond = (factor - 1.0) * float(np.max(np.linalg.norm(points, axis=1)))
            if beyond <= excess or count > 2000:
                return [factor * points]
            count += count // 4


def spiral(n: int) -> Array:
    """n directions (n, 3) at equal steps of height, each turned on by the golden angle."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    turn = np.pi * (3.0 - math.sqrt(5.0)) * np.arange(n)
    across = np.sqrt(1.0 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
