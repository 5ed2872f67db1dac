"""An ellipse in the plane."""

from __future__ import annotations

from dataclasses import dataclass, field

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.surfaces.base import check_sizes
from wbc.contact.surfaces.contour import Contour
from wbc.contact.surfaces.gauge import gauge_level, gauge_level_gradient
from wbc.contact.surfaces.harmonics import harmonic_charts


@dataclass(frozen=True)
class Ellipse(Contour):
    """x = a cos u, y = b sin u. F is the distance to first order, see `gauge.gauge_level`.

    Attributes:
        a, b: half axes along x and y [m].
    """

    a: float
    b: float
    rows: Array = field(init=False, repr=False, compare=False)
    sizes: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_sizes(self, a=self.a, b=self.b)
        object.__setattr__(self, "sizes", read_only([self.a, self.b]))
        object.__setattr__(self, "rows", read_only([[1.0, self.a, 0.0, 0.0, self.b]]))

    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        harmonic_charts(self.rows, xi, face, out)

    def level(self, p: Array) -> float:
        return gauge_level(p, self.sizes, 2.0)

    def level_gradient(self, p: Array) -> Array:
        return gauge_level_gradient(p, self.sizes, 2.0)
