"""What a driver hands over, whatever it is, as numbers: reading it must not end the tick."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array

_KINDS = "fiuO"  # floats, integers, and what turns into them: no text, no complex numbers


def numbers(given: object, shape: tuple[int, ...]) -> Array | None:
    """A copy of what is given as floats of a shape, NaN and inf as they are; None if it is none."""
    try:
        values = np.array(given)  # a copy: a driver may fill its buffers again
        if values.dtype.kind == "O" and any(isinstance(x, str | bytes) for x in values.flat):
            return None
        if values.shape != shape or values.dtype.kind not in _KINDS:
            return None
        return values.astype(np.float64, copy=False)
    except Exception:  # an object may raise anything when it is read
        return None


def reading(measured: object, name: str, shape: tuple[int, ...]) -> Array | None:
    """One of a measurement's readings, likewise; None where it is missing, too."""
    try:
        given = getattr(measured, name, None)
    except Exception:  # as above
        return None
    return numbers(given, shape)


def finite_reading(measured: object, name: str, shape: tuple[int, ...]) -> Array | None:
    """The same where all of it is finite, else None."""
    values = reading(measured, name, shape)
    return values if values is not None and np.isfinite(values).all() else None
