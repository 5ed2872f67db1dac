"""Text of strangers' files: bounded, plain, and every fault one line with its place."""

from __future__ import annotations

import math
import os
import re
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np

from wbc.errors import WbcError

MAX_BYTES: Final = 16 << 20
MAX_JOINTS: Final = 1000
FULL_TURN: Final = 2.0 * math.pi
"""No joint of a hand turns so far, [rad]; a larger value was meant in degrees."""
_MOST_FAULTS: Final = 20
# float() would also take 1_000, figures of other scripts, nan and infinity
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


def read_text(path: str | os.PathLike[str], what: str) -> str:
    """The text of a file, without byte order mark.

    Args:
        what: what the file should be, for the messages, e.g. ``"a table of postures"``.

    Raises:
        WbcError: one line: not there, no regular file, too large, empty, not UTF-8, a NUL in it.
    """
    name = shown(os.fspath(path), 200)
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):  # opening a pipe would wait for ever
            raise WbcError(f"{name}: not a regular file; name {what}")
        with Path(path).open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise WbcError(f"{name}: cannot be read: {reason}") from None
    if len(data) > MAX_BYTES:
        raise WbcError(f"{name}: larger than {MAX_BYTES >> 20} MB; {what} was expected")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise WbcError(f"{name}:{line}: not UTF-8 text; save the file as UTF-8") from None
    if (at := text.find("\0")) >= 0:
        line = text.count("\n", 0, at) + 1
        raise WbcError(f"{name}:{line}: a NUL byte; {what} is plain text")
    if not text.strip():
        raise WbcError(f"{name}:1: the file is empty; {what} was expected")
    return text


def parse_number(written: str) -> float:
    """A finite decimal number.

    Raises:
        ValueError: what it is instead, e.g. ``"is not a number"``.
    """
    piece = written.strip()
    if _NUMBER.fullmatch(piece):
        value = float(piece)
        if math.isfinite(value):
            return value
        raise ValueError("is too large for a number")
    if not piece:
        raise ValueError("is empty")
    if re.fullmatch(r"[+-]?(nan|inf|infinity)", piece, re.IGNORECASE):
        raise ValueError("is not finite")
    raise ValueError("is not a number")


def shown(value: object, most: int = 60) -> str:
    """`value` on one line and not too long, for a message."""
    text = str(value)
    flat = "".join(c if c.isprintable() else "?" for c in text[: most + 1])
    return flat if len(flat) <= most else flat[:most] + "..."


def name_trouble(names: Iterable[object]) -> str | None:
    """What is wrong with a list of joint names, if anything."""
    seen: set[object] = set()
    for name in names:
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            return f"'{shown(name)}' is no name of a joint"
        if name in seen:
            return f"'{shown(name)}' is named twice"
        seen.add(name)
    if not 1 <= len(seen) <= MAX_JOINTS:
        return f"{len(seen)} joints; between 1 and {MAX_JOINTS} can be read"
    return None


def raise_faults(name: str, faults: list[str]) -> None:
    """Raise `WbcError` with the faults, one a line, of which the first twenty are shown."""
    if faults:
        more = len(faults) - _MOST_FAULTS
        rest = [f"{name}: ... and {more} more faults"] if more > 0 else []
        raise WbcError("\n".join(faults[:_MOST_FAULTS] + rest))


def angle_unit(unit: str) -> float:
    """How many radians one of `unit` is.

    Raises:
        ValueError: neither ``"rad"`` nor ``"deg"``.
    """
    try:
        return {"rad": 1.0, "deg": float(np.deg2rad(1.0))}[unit]
    except (KeyError, TypeError):
        raise ValueError(f"unit '{shown(unit)}' is not known; write 'rad' or 'deg'") from None
