"""What a driver hands over, whatever it is, as numbers: reading it must not end the tick."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wbc.arrays import Array

_KINDS = "fiuO"  # floats, integers, and what turns into them: no text, no complex numbers


def numbers(values: object, shape: tuple[int, ...]) -> Array | None:
    """A copy of what is given as floats of a shape, NaN and inf as they are; None if it is none."""
    try:
        found = np.array(values)  # a copy: a driver may fill its buffers again
        if found.dtype.kind == "O" and any(isinstance(x, str | bytes) for x in found.flat):
            return None
        if found.shape != shape or found.dtype.kind not in _KINDS:
            return None
        return found.astype(np.float64, copy=False)
    except Exception:  # an object may raise anything when it is read
        return None


def given(measured: object, name: str) -> Any:
    """A measurement's field as its driver hands it over: None where it has none, and NaN, which is
    no measurement, where the driver raises when it is asked."""
    try:
        return getattr(measured, name, None)
    except Exception:  # as above
        return math.nan


def reading(measured: object, name: str, shape: tuple[int, ...]) -> Array | None:
    """One of a measurement's readings, likewise; None where it is missing, too."""
    return numbers(given(measured, name), shape)


def finite_reading(measured: object, name: str, shape: tuple[int, ...]) -> Array | None:
    """The same where all of it is finite, else None."""
    values = reading(measured, name, shape)
    return values if values is not None and np.isfinite(values).all() else None
