"""A contour of a few harmonics: waisted, bulged or flat-sided outlines."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.surfaces.base import D_U, POINT, check_sizes
from wbc.contact.surfaces.contour import Contour, check_contour
from wbc.contact.surfaces.harmonics import harmonic_charts
from wbc.errors import WbcError


@dataclass(frozen=True)
class FourierContour(Contour):
    """x = a cos u, y = b sin u + h sin 3u, plus further harmonics. F is the signed distance.

    With h = b/6 the contour has a mild waist and two bulges on each side, so that two pairs of
    fingers can hold it across without their lines of grasp crossing.

    Attributes:
        a, b: half axes of the ellipse it starts from [m].
        h: amplitude of the third harmonic of y [m], of either sign.
        harmonics: rows (order >= 1, x_cos, x_sin, y_cos, y_sin) to be added [m].
    """

    a: float
    b: float
    h: float = 0.0
    harmonics: tuple[tuple[float, float, float, float, float], ...] = ()
    rows: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_sizes(self, a=self.a, b=self.b)
        extra = tuple(tuple(float(x) for x in row) for row in self.harmonics)
        if not math.isfinite(self.h):
            raise WbcError(f"FourierContour: h = {self.h} must be finite [m]")
        for row in extra:
            if len(row) != 5 or not np.all(np.isfinite(row)) or row[0] < 1.0 or row[0] % 1.0:
                raise WbcError(
                    f"FourierContour: harmonic {list(row)} must be [order, x_cos, x_sin, y_cos,"
                    " y_sin], the order a whole number from 1"
                )
        rows = [(1.0, self.a, 0.0, 0.0, self.b), (3.0, 0.0, 0.0, 0.0, self.h), *extra]
        object.__setattr__(self, "harmonics", extra)
        object.__setattr__(self, "rows", read_only(rows))
        check_contour(self)

    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        harmonic_charts(self.rows, xi, face, out)

    def level(self, p: Array) -> float:
        """Distance from the closest point, with the sign of the side of the normal p is on."""
        foot, normal = self._foot(p)
        gap = np.asarray(p, dtype=np.float64)[:2] - foot
        return math.copysign(float(np.linalg.norm(gap)), float(normal @ gap))

    def level_gradient(self, p: Array) -> Array:
        """The outward normal at the closest point."""
        return np.append(self._foot(p)[1], 0.0)

    def _foot(self, p: Array) -> tuple[Array, Array]:
        """The closest point (2,) and the outward normal there (2,)."""
        xi, _ = self.project(p)
        record = self.charts(xi)[0]
        normal = np.array([record[D_U, 1], -record[D_U, 0]])
        return record[POINT, :2], normal / np.linalg.norm(normal)
