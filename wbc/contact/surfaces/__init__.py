"""Object surfaces: a new one is one file and one row of this table."""

from __future__ import annotations

from wbc.contact.surfaces.base import Surface
from wbc.contact.surfaces.box import Box
from wbc.contact.surfaces.circle import Circle
from wbc.contact.surfaces.cylinder import Cylinder
from wbc.contact.surfaces.ellipse import Ellipse
from wbc.contact.surfaces.fourier_contour import FourierContour
from wbc.contact.surfaces.gauss import gauss_frames
from wbc.contact.surfaces.sphere import Sphere
from wbc.contact.surfaces.spheroid import Spheroid
from wbc.contact.surfaces.superellipse import Superellipse
from wbc.contact.surfaces.superellipsoid import Superellipsoid

SURFACES: dict[str, type[Surface]] = {
    "circle": Circle,
    "ellipse": Ellipse,
    "superellipse": Superellipse,
    "fourier_contour": FourierContour,
    "sphere": Sphere,
    "spheroid": Spheroid,
    "cylinder": Cylinder,
    "superellipsoid": Superellipsoid,
    "box": Box,
}
"""Type names of scenario files and their classes."""

__all__ = ["SURFACES", "Surface", "gauss_frames"]
