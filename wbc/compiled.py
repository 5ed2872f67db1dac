"""One decorator for the numeric kernels of the tick.

With numba installed a kernel is compiled once per machine and cached; without it, or with
``NUMBA_DISABLE_JIT=1``, the same source runs as plain NumPy and gives the same numbers to rounding.
Kernels therefore take and fill arrays and hold no Python objects.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

_KEEP = 30 * 86400.0  # seconds that kernels of other versions stay cached


def _cache_folder() -> Path | None:
    """A folder of the user's cache for the kernels of exactly these sources; None: cannot be made.

    numba notices a change in a kernel's own file only, not in one that it calls from another file.
    """
    package = Path(__file__).resolve().parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        text = source.read_bytes()
        if b"@kernel" in text:
            digest.update(text)
    try:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        kernels = Path(base) / "wbc" / "kernels"
        folder = kernels / digest.hexdigest()[:16]
        if folder.is_dir():
            os.utime(folder)
        else:
            folder.mkdir(parents=True, mode=0o700)
            for other in kernels.iterdir():
                if time.time() - other.stat().st_mtime > _KEEP:
                    shutil.rmtree(other, ignore_errors=True)
        # numba loads what it finds there: nobody else may write to it
        stat = folder.lstat()
        private = stat.st_uid == os.getuid() and not stat.st_mode & 0o022
        return folder if private and not folder.is_symlink() else None
    except (OSError, RuntimeError):  # RuntimeError: no home
        return None


try:
    import numba
except ImportError:  # an optional extra: wbc[fast]
    COMPILED = False

    def kernel(function: F) -> F:
        """Leave `function` as it is: numba is not installed."""
        return function

else:
    COMPILED = not numba.config.DISABLE_JIT
    if COMPILED and not numba.config.CACHE_DIR and (_folder := _cache_folder()) is not None:
        numba.config.CACHE_DIR = str(_folder)

    def kernel(function: F) -> F:
        """Compile `function` on first use; division by zero gives inf/nan as in NumPy."""
        return cast(F, numba.njit(cache=True, error_model="numpy")(function))
