"""An ellipsoid of revolution about z."""

from __future__ import annotations

from dataclasses import dataclass, field

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.surfaces.base import check_sizes
from wbc.contact.surfaces.polar import PolarSurface
from wbc.contact.surfaces.radial import ellipsoid_charts


@dataclass(frozen=True)
class Spheroid(PolarSurface):
    """c = (a d_x, a d_y, b d_z) with d the direction of longitude u and (reduced) latitude v.

    On the face poles_z the chart is orthogonal; with D² = a² sin² v + b² cos² v Montana's forms are
    metric diag(a cos v, D), curvature diag(b/(a D), a b/D³), torsion [tan v / D, 0].

    Attributes:
        a: equatorial radius [m].
        b: polar half axis [m].
    """

    a: float
    b: float
    sizes: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_sizes(self, a=self.a, b=self.b)
        object.__setattr__(self, "sizes", read_only([self.a, self.a, self.b]))

    @property
    def half_axes(self) -> Array:
        return self.sizes

    @property
    def exponent(self) -> float:
        return 2.0

    def direction(self, point: Array) -> Array:
        direction: Array = point / self.sizes
        return direction

    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        ellipsoid_charts(self.sizes, xi, face, out)
