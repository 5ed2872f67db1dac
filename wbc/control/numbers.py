"""What a driver hands over, whatever it is, as numbers."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array

_KINDS = "fiub"  # floats, integers, booleans: no text, no complex numbers, no objects


def numbers(given: object, shape: tuple[int, ...]) -> Array | None:
    """A copy of what is given as floats of a shape, NaN and inf as they are; None if it is none."""
    try:
        values = np.asarray(given)
        if values.dtype.kind not in _KINDS or values.shape != shape:
            return None
        return np.array(values, dtype=np.float64)
    except Exception:  # an object may raise anything when it is read
        return None


def finite(given: object, shape: tuple[int, ...]) -> Array | None:
    """The same where all of it is finite, else None."""
    values = numbers(given, shape)
    return values if values is not None and np.isfinite(values).all() else None
