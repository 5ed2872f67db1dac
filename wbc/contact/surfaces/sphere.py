"""A sphere."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.surfaces.base import check_sizes
from wbc.contact.surfaces.polar import PolarSurface
from wbc.contact.surfaces.radial import ellipsoid_charts


@dataclass(frozen=True)
class Sphere(PolarSurface):
    """|p| = r by longitude and latitude. F is the signed distance |p| - r.

    Montana's forms: metric diag(r cos v, r), curvature I/r, torsion [tan v / r, 0].

    Attributes:
        radius: r [m].
    """

    radius: float
    sizes: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_sizes(self, radius=self.radius)
        object.__setattr__(self, "sizes", read_only(np.full(3, self.radius)))

    @property
    def half_axes(self) -> Array:
        return self.sizes

    @property
    def exponent(self) -> float:
        return 2.0

    def direction(self, point: Array) -> Array:
        """The point itself: geographic and geometric latitude agree."""
        return point

    def evaluate(self, xi: Array, face: IntArray, out: Array) -> None:
        ellipsoid_charts(self.sizes, xi, face, out)
