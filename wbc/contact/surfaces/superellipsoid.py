"""A superellipsoid: an ellipsoid that tends to a rounded box as its exponent grows."""

from __future__ import annotations

from dataclasses import dataclass, field

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.surfaces.base import check_exponent, check_sizes
from wbc.contact.surfaces.polar import PolarSurface
from wbc.contact.surfaces.radial import superellipsoid_charts


@dataclass(frozen=True)
class Superellipsoid(PolarSurface):
    """Σ |x_i/a_i|^p = 1 by the radius along the direction of longitude u and latitude v.

    The usual chart by powers of sines has singular derivatives on the axes; this one is twice
    differentiable there for p >= 2. For p > 2 the six points on the axes are flat.

    Attributes:
        ax, ay, az: half axes [m].
        p: exponent, at least 2.
    """

    ax: float
    ay: float
    az: float
    p: float
    sizes: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_sizes(self, ax=self.ax, ay=self.ay, az=self.az)
        check_exponent(self, self.p)
        object.__setattr__(self, "sizes", read_only([self.ax, self.ay, self.az]))
        object.__setattr__(self, "p", float(self.p))

    @property
    def half_axes(self) -> Array:
        return self.sizes

    @property
    def exponent(self) -> float:
        return self.p

    def direction(self, point: Array) -> Array:
        """The point itself: the chart is by true directions."""
        return point

    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        superellipsoid_charts(self.sizes, self.p, xi, face, out)
