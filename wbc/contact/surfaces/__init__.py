"""Object surfaces: a new one is one file and one row of this table."""

from __future__ import annotations

from wbc.contact.surfaces.base import Surface
from wbc.contact.surfaces.circle import Circle
from wbc.contact.surfaces.ellipse import Ellipse
from wbc.contact.surfaces.fourier_contour import FourierContour

SURFACES: dict[str, type[Surface]] = {
    "circle": Circle,
    "ellipse": Ellipse,
    "fourier_contour": FourierContour,
}
"""Type names of scenario files and their classes."""
