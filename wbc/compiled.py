"""One decorator for the numeric kernels of the tick.

With numba installed a kernel is compiled once per machine and cached; without it, or with
``NUMBA_DISABLE_JIT=1``, the same source runs as plain NumPy and gives the same numbers to rounding.
Kernels are therefore written in array style (slices, ``@``), take and fill arrays, and hold no Python
objects, so that both ways stay fast enough and readable.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

try:
    import numba
except ImportError:  # an optional extra: wbc[fast]
    COMPILED = False

    def kernel(function: F) -> F:
        """Leave `function` as it is: numba is not installed."""
        return function

else:
    COMPILED = not numba.config.DISABLE_JIT

    def kernel(function: F) -> F:
        """Compile `function` on first use; division by zero gives inf/nan as in NumPy."""
        return cast(F, numba.njit(cache=True, error_model="numpy")(function))
