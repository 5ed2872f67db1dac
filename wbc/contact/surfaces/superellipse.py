"""A superellipse in the plane: an ellipse that tends to a rounded rectangle."""

from __future__ import annotations

from dataclasses import dataclass, field

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.surfaces.base import check_exponent, check_sizes
from wbc.contact.surfaces.contour import Contour
from wbc.contact.surfaces.gauge import gauge_level, gauge_level_gradient
from wbc.contact.surfaces.radial import superellipse_charts


@dataclass(frozen=True)
class Superellipse(Contour):
    """|x/a|^p + |y/b|^p = 1 by polar angle u. F is the distance to first order.

    For p > 2 the four points on the axes are flat, and fingers can face each other side by side.

    Attributes:
        a, b: half axes along x and y [m].
        p: exponent, at least 2.
    """

    a: float
    b: float
    p: float
    sizes: Array = field(init=False, repr=False, compare=False)
    half_axes: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_sizes(self, a=self.a, b=self.b)
        check_exponent(self, self.p)
        object.__setattr__(self, "sizes", read_only([self.a, self.b, 1.0]))
        object.__setattr__(self, "half_axes", read_only([self.a, self.b]))
        object.__setattr__(self, "p", float(self.p))

    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        superellipse_charts(self.sizes, self.p, xi, face, out)

    def level(self, p: Array) -> float:
        return gauge_level(p, self.half_axes, self.p)

    def level_gradient(self, p: Array) -> Array:
        return gauge_level_gradient(p, self.half_axes, self.p)
