"""What all planar contours share: the closest point, the outline and the body they enclose."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.surfaces import plane
from wbc.contact.surfaces.base import D_U, POINT, Domain, Surface
from wbc.contact.surfaces.closest import refine
from wbc.errors import WbcError

DOMAIN = Domain((-np.pi, -np.inf), (np.pi, np.inf), (2.0 * np.pi, 0.0))
SAMPLES = 360


class Contour(Surface):
    """A closed plane curve (x(u), y(u)), counterclockwise in u, as the cylinder (x(u), y(u), v).

    So c_u x c_v = (y', -x', 0) points outward, and a planar contact is one of space with v = 0.
    """

    planar: ClassVar[bool] = True
    faces: ClassVar[tuple[str, ...]] = ("contour",)

    def domain(self, face: int = 0) -> Domain:
        return DOMAIN

    def margin(self, xi: Array, face: int = 0) -> float:
        """No pole and no edge: infinite."""
        return float("inf")

    @cached_property
    def samples(self) -> Array:
        """Chart records (360, 6, 3) at equal steps of u from -π."""
        return read_only(self.charts(_heights_zero(SAMPLES)))

    def project(self, p: Array, face: int | None = None) -> tuple[Array, int]:
        """The closest point of the whole contour, from every nearby local minimum of a table."""
        q = np.array([p[0], p[1], 0.0])
        distance = np.linalg.norm(self.samples[:, POINT] - q, axis=1)
        step = np.max(np.linalg.norm(self.samples[:, D_U], axis=1)) * (2.0 * np.pi / SAMPLES)
        low = (distance <= np.roll(distance, 1)) & (distance <= np.roll(distance, -1))
        # between two samples the contour comes closer by less than one step
        low &= distance <= np.min(distance) + step
        seeds = _heights_zero(SAMPLES)[low][:64]
        xi, value = refine(self, q, seeds, np.zeros(seeds.shape[0], dtype=np.int64))
        return DOMAIN.wrap(xi[int(np.argmin(value))]), 0

    def outline(self, n: int = 96) -> Array:
        """Corners (n, 3) [m] on the contour at equal steps of u, counterclockwise, not closed."""
        out: Array = self.charts(_heights_zero(n))[:, POINT]
        return out

    def mesh(self, n: int = 48, half_thickness: float = 0.05) -> tuple[Array, IntArray]:
        """The prism over the outline: a wall, and two lids cut into triangles."""
        ring = self.outline(n)
        lid = plane.triangles(ring[:, :2])
        lift = np.array([0.0, 0.0, half_thickness])
        low = np.arange(n)
        next_low = np.roll(low, -1)
        wall = [
            np.stack([low, next_low, next_low + n], 1),
            np.stack([low, next_low + n, low + n], 1),
        ]
        faces = np.vstack([*wall, lid + n, lid[:, ::-1]]).astype(np.int64)
        return np.vstack([ring - lift, ring + lift]), faces

    def convex_pieces(self, thickness: float = 2.0, excess: float = 1e-3) -> list[Array]:
        """A convex contour is one prism; another is cut at its notches into a few."""
        half = 0.5 * thickness
        out = []
        for part in plane.convex_parts(self._enclosing(), 0.6 * excess):
            ring = plane.wrap_convex(part, 0.35 * excess)
            low = np.column_stack([ring, np.full(ring.shape[0], -half)])
            high = np.column_stack([ring, np.full(ring.shape[0], half)])
            out.append(np.vstack([low, high]))
        return out

    def _enclosing(self) -> Array:
        """A fine polygon (m, 2) around the body.

        Where the contour bulges the corners are those of the tangents, outside it; where it is
        hollow the chords between its points are.
        """
        records = self.charts(_heights_zero(2 * SAMPLES))
        point, tangent = records[:, POINT, :2], records[:, D_U, :2]
        next_point, next_tangent = np.roll(point, -1, axis=0), np.roll(tangent, -1, axis=0)
        turn = plane.cross2(tangent, next_tangent)
        scale = np.linalg.norm(tangent, axis=1) * np.linalg.norm(next_tangent, axis=1)
        bulge = turn > 1e-9 * scale
        reach = plane.cross2(next_point - point, next_tangent) / np.where(bulge, turn, 1.0)
        corner = np.where(bulge[:, None], point + reach[:, None] * tangent, point)
        out = np.stack([point, corner], axis=1).reshape(-1, 2)
        enclosing: Array = out[np.repeat(bulge, 2) | (np.arange(out.shape[0]) % 2 == 0)]
        return enclosing


def check_contour(contour: Contour) -> None:
    """Refuse a contour with a cusp, a crossing of itself, or the inside on its right."""
    name = type(contour).__name__
    speed = np.linalg.norm(contour.samples[:, D_U], axis=1)
    if not np.min(speed) > 1e-6 * np.max(speed):
        raise WbcError(f"{name}: the contour has a cusp, |c_u| vanishes (reduce the harmonics)")
    polygon = contour.samples[:, POINT, :2]
    side = np.roll(polygon, -1, axis=0) - polygon
    after = np.roll(side, -1, axis=0)
    turns = np.arctan2(plane.cross2(side, after), np.sum(side * after, axis=1))
    if not plane.is_simple(polygon) or abs(float(np.sum(turns))) > 3.0 * np.pi:
        raise WbcError(f"{name}: the contour crosses itself (reduce the harmonics)")
    if plane.signed_area(polygon) <= 0.0:
        raise WbcError(f"{name}: u must run counterclockwise (exchange the signs of y)")


def _heights_zero(n: int) -> Array:
    """(n, 2): n equal steps of u over the full turn from -π, v = 0."""
    return np.column_stack([np.linspace(-np.pi, np.pi, n, endpoint=False), np.zeros(n)])
