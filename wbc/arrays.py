"""Array aliases. Shapes, units and frames are stated where an array is documented."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Any array of doubles."""
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]


def read_only(values: Any) -> Array:
    """A contiguous copy of `values` as doubles that refuses to be written to."""
    array = np.array(values, dtype=np.float64, order="C")
    array.setflags(write=False)
    return array


def read_only_view(values: Array) -> Array:
    """The same numbers, which cannot be written to through what is returned."""
    if not values.flags.writeable:
        return values
    view: Array = values.view()
    view.setflags(write=False)
    return view
