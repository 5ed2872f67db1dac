"""Synergies as a JSON file that people can read and write; nothing in it is trusted."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np

from wbc.arrays import Array
from wbc.errors import WbcError, did_you_mean
from wbc.files import write_whole
from wbc.synergies.reading import FULL_TURN, angle_unit, name_trouble, read_text, shown

FORMAT: Final = "wbc synergies 1"
_LARGEST: Final = 1e9
_KEYS: Final = (
    "format", "unit", "joints", "mean", "synergies", "variances", "total_variance", "lower",
    "upper",
)  # fmt: skip


def write_fields(path: str | os.PathLike[str], fields: Mapping[str, Any]) -> Path:
    """Write what `read_fields` reads, whole or not at all; the same bytes for the same numbers.

    Args:
        fields: `Synergies`' attributes by name, [rad], [rad²].

    Raises:
        WbcError: the file cannot be written.
    """
    limits = {
        side: [value if math.isfinite(value) else None for value in fields[side].tolist()]
        for side in ("lower", "upper")
    }
    content = {
        "format": FORMAT,
        "unit": "rad",
        "joints": list(fields["joints"]),
        "mean": fields["mean"].tolist(),
        "synergies": fields["basis"].T.tolist(),
        "variances": fields["variances"].tolist(),
        "total_variance": float(fields["total_variance"]),
        **limits,
    }
    rows = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items()]
    data = ("{\n" + ",\n".join(rows) + "\n}\n").encode("ascii")
    return write_whole(path, lambda file: file.write(data))


def read_fields(path: str | os.PathLike[str]) -> dict[str, Any]:
    """`Synergies`' attributes by name, in rad and rad², from a file in radians or degrees.

    Raises:
        WbcError: one line: the file, the key, what is wrong and what to write.
    """
    name = shown(os.fspath(path), 200)
    try:
        content = _parsed(read_text(path, "a file of synergies"), name)
        return _fields(content)
    except _Fault as fault:
        raise WbcError(f"{name}: {fault}") from None


class _Fault(Exception):
    """What is wrong with the content, without the file's name."""


def _parsed(text: str, name: str) -> dict[str, Any]:
    def pairs(found: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in found]
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise _Fault(f"key '{shown(twice)}' is there twice; remove one")
        return dict(found)

    def constant(word: str) -> NoReturn:
        raise _Fault(f"{word} is no number of JSON; write null for a limit that is not known")

    try:
        # integers as floats: Python's own take quadratic time to read
        content = json.loads(
            text, object_pairs_hook=pairs, parse_constant=constant, parse_int=float
        )
    except json.JSONDecodeError as error:
        raise WbcError(
            f"{name}:{error.lineno}: not JSON: {shown(error.msg)}; is the file complete? "
            "(wbc synergy fit makes one of a table of postures)"
        ) from None
    except RecursionError:
        raise _Fault("nested too deeply; this is no file of synergies") from None
    if not isinstance(content, dict):
        raise _Fault(f"not an object with the keys {', '.join(_KEYS)}")
    return content


def _fields(content: dict[str, Any]) -> dict[str, Any]:
    if content.get("format") != FORMAT:
        raise _Fault(f"key 'format' must be \"{FORMAT}\"; is this a file of synergies?")
    for key in content:
        if key not in _KEYS:
            raise _Fault(f"key '{shown(key)}' is not known{did_you_mean(shown(key), _KEYS)}")
    for key in _KEYS:
        if key not in content:
            raise _Fault(f"key '{key}' is missing; add it")
    try:
        radians = angle_unit(content["unit"])
    except ValueError as error:
        raise _Fault(f"key 'unit': {error}") from None
    joints = content["joints"]
    if not isinstance(joints, list):
        raise _Fault("key 'joints' must be a list of names")
    if (trouble := name_trouble(joints)) is not None:
        raise _Fault(f"key 'joints': {trouble}; give every joint its own name")
    n = len(joints)
    rows = content["synergies"]
    if not isinstance(rows, list) or not 1 <= len(rows) <= n:
        raise _Fault(f"key 'synergies' must be a list of 1 to {n} lists, one for each synergy")
    basis = [_list(row, n, f"synergies, number {j}") for j, row in enumerate(rows, start=1)]
    (total,) = _list([content["total_variance"]], 1, "total_variance")
    fields = {
        "joints": tuple(joints),
        "mean": radians * _list(content["mean"], n, "mean"),
        "basis": np.array(basis).T,
        "variances": radians**2 * _list(content["variances"], len(rows), "variances"),
        "total_variance": float(radians**2 * total),
        "lower": radians * _list(content["lower"], n, "lower", unknown=-math.inf),
        "upper": radians * _list(content["upper"], n, "upper", unknown=math.inf),
    }
    for key in ("mean", "lower", "upper"):
        far = np.flatnonzero((np.abs(fields[key]) > FULL_TURN) & np.isfinite(fields[key]))
        if far.size:
            value = fields[key][far[0]] / radians
            remedy = 'write "unit": "deg"' if radians == 1.0 else "no joint turns so far"
            raise _Fault(f"key '{key}': {value:.4g} {content['unit']} of joint "
                         f"'{joints[far[0]]}' is more than a full turn; {remedy}")  # fmt: skip
    return fields


def _list(value: Any, size: int, key: str, unknown: float | None = None) -> Array:
    """(size,) numbers; `unknown` stands where the list has null."""
    if not isinstance(value, list) or len(value) != size:
        found = f"{len(value)} entries" if isinstance(value, list) else f"'{shown(value)}'"
        raise _Fault(f"key '{key}' must be a list of {size} numbers, got {found}")
    for place, entry in enumerate(value, start=1):
        if entry is None and unknown is not None:
            continue
        if not isinstance(entry, float) or not abs(entry) <= _LARGEST:
            raise _Fault(f"key '{key}', entry {place}: '{shown(entry)}' is no number, or too large")
    return np.array([unknown if entry is None else entry for entry in value], dtype=np.float64)
