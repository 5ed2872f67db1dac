"""Recorded postures from a CSV file: one row for each, one column for each joint."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from wbc.arrays import Array, read_only
from wbc.errors import WbcError, did_you_mean
from wbc.synergies.reading import (
    FULL_TURN,
    MAX_JOINTS,
    angle_unit,
    name_trouble,
    parse_number,
    raise_faults,
    read_text,
    shown,
)

_MOST_LINES: Final = 100_000
_NAMES: Final = ("posture", "name", "time")
_BEYOND: Final = 1.0
"""How far outside its range a posture's joint may be, [rad]: a recording is noisy and a projected
posture is up to 23° outside; what is further out has the wrong unit."""
_UNIT = re.compile(r"#\s*units?\s*[:=](.*)", re.IGNORECASE)


@final
@dataclass(frozen=True)
class Postures:
    """Postures as read.

    Attributes:
        names: (m,) as in the column ``posture``; ``posture_1`` and so on where there is none.
        values: (m, n) [rad].
        joints: (n,) the columns' joints.
    """

    names: tuple[str, ...]
    values: Array
    joints: tuple[str, ...]


@dataclass(frozen=True)
class _Units:
    """What the numbers of the file mean."""

    name: str
    radians: float
    stated: bool
    lower: Array
    upper: Array


def read_postures(
    path: str | os.PathLike[str],
    joints: Sequence[str] | None = None,
    *,
    unit: str | None = None,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Postures:
    """Read a table of postures.

    The header names the joints, in any order, after a first column ``posture``, ``name`` or
    ``time`` that says which row is which, and may be missing. Radians, unless `unit` or a line
    ``# unit: deg`` says otherwise; other lines that start with ``#`` are comments.

    Args:
        joints: (n,) those that the file must have, and their order in the result; those of the
            header where not given.
        unit: ``"rad"`` or ``"deg"``.
        lower, upper: (n,) ranges of `joints`, [rad]. A value more than 1 rad outside them is a
            fault, and where there is none, a value beyond a full turn: the unit is wrong.

    Raises:
        WbcError: one line for each fault: file, line, what is wrong and the remedy.
    """
    name = shown(os.fspath(path), 200)
    text = read_text(path, "a table of postures")
    if text.count("\n") > _MOST_LINES:
        raise WbcError(f"{name}: more than {_MOST_LINES} lines; split the file")
    declared, rows = _split(name, text)
    head_line, header = next(rows, (1, []))
    columns = [cell.strip() for cell in header]
    named = bool(columns) and columns[0].lower() in _NAMES
    columns = columns[1:] if named else columns
    _check_columns(f"{name}:{head_line}", columns, joints)
    order = tuple(columns if joints is None else joints)
    units = _units(name, declared, unit, (lower, upper), len(order))
    names, values = _body(name, rows, named, columns, order, units)
    return Postures(names, read_only(values), order)


def _split(name: str, text: str) -> tuple[tuple[int, str] | None, Iterator[tuple[int, list[str]]]]:
    """Where and which unit the file declares, and its rows of cells with their lines."""
    declared: tuple[int, str] | None = None
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(text.split("\n"), start=1):
        stripped = line.strip()
        if (found := _UNIT.match(stripped)) is not None:
            said = found.group(1).rstrip(",; \t").strip()  # a spreadsheet fills the row up
            if declared is not None and declared[1] != said:
                raise WbcError(
                    f"{name}:{number}: another unit than in line {declared[0]} (keep one of them)"
                )
            declared = (number, said)
        elif stripped and not stripped.startswith("#"):
            lines.append((number, stripped))
    return declared, ((number, _cells(f"{name}:{number}", line)) for number, line in lines)


def _cells(place: str, line: str) -> list[str]:
    try:
        return next(csv.reader([line], strict=True))
    except csv.Error as error:
        raise WbcError(f"{place}: not a row of comma-separated values: {shown(error)}") from None


def _check_columns(place: str, columns: list[str], joints: Sequence[str] | None) -> None:
    if not columns:
        raise WbcError(f"{place}: no joint is named (write a header row with the joints' names)")
    if len(columns) == 1 and (other := re.search(r"[;\t|]", columns[0])) is not None:
        sign = "tabs" if other[0] == "\t" else f"'{other[0]}'"
        raise WbcError(f"{place}: the columns are separated by {sign} (separate them by commas)")
    if all(_is_number(c) for c in columns):
        raise WbcError(f"{place}: the header row is missing (name the joints in the first row)")
    if (trouble := name_trouble(columns[: MAX_JOINTS + 1])) is not None:
        raise WbcError(f"{place}: {trouble} (the header row has one name for each joint)")
    faults: list[str] = []
    if joints is not None:
        if not set(columns) & set(joints):
            raise WbcError(f"{place}: none of the joints {_listed(list(joints))} has a column "
                           f"({shown(columns[0])} and so on are another hand's?)")  # fmt: skip
        faults += [
            f"{place}: no joint is called '{shown(c)}'{did_you_mean(shown(c), joints)}"
            for c in columns
            if c not in joints
        ]
        missing = [joint for joint in joints if joint not in columns]
        if missing and not faults:  # else a name is misspelt rather than missing
            faults.append(f"{place}: no column for {_listed(missing)} (add it)")
    raise_faults(place, faults)


def _units(
    name: str,
    declared: tuple[int, str] | None,
    unit: str | None,
    limits: tuple[ArrayLike | None, ArrayLike | None],
    n: int,
) -> _Units:
    line, found = (1, "") if declared is None else declared
    if unit is not None and declared is not None and unit != found:
        raise WbcError(
            f"{name}:{line}: the file says '{shown(found)}', the caller '{shown(unit)}' "
            "(leave one out)"
        )
    chosen = unit if unit is not None else (found if declared is not None else "rad")
    try:
        radians = angle_unit(chosen)
    except ValueError as error:
        raise WbcError(f"{name}:{line}: {error}") from None
    ends = [np.full(n, sign * np.inf) if given is None else np.asarray(given, dtype=np.float64)
            for sign, given in zip((-1.0, 1.0), limits, strict=True)]  # fmt: skip
    if any(end.shape != (n,) or np.isnan(end).any() for end in ends):
        raise WbcError(f"ranges of {n} joints are needed, got {ends[0].shape}, {ends[1].shape}")
    low, high = (np.where(np.isinf(end), np.sign(end) * FULL_TURN, end + sign * _BEYOND)
                 for sign, end in zip((-1.0, 1.0), ends, strict=True))  # fmt: skip
    return _Units(chosen, radians, unit is not None or declared is not None, low, high)


def _body(
    name: str,
    rows: Iterator[tuple[int, list[str]]],
    named: bool,
    columns: list[str],
    order: tuple[str, ...],
    units: _Units,
) -> tuple[tuple[str, ...], list[list[float]]]:
    names: dict[str, int] = {}
    values: list[list[float]] = []
    faults: list[str] = []
    places = [columns.index(joint) for joint in order]
    for line, cells in rows:
        place = f"{name}:{line}"
        if len(cells) != named + len(columns):
            hint = "separate them by commas" if len(cells) == 1 else "one for each column"
            faults.append(
                f"{place}: {len(cells)} values, the header has {named + len(columns)} ({hint})"
            )
            continue
        called = cells[0].strip() if named else f"posture_{len(names) + 1}"
        if not called or not called.isprintable():
            faults.append(f"{place}: the posture has no name (write one in the first column)")
        elif called in names:
            faults.append(f"{place}: '{shown(called)}' is in line {names[called]} too (rename one)")
        names.setdefault(called, line)
        row, wrong = _row(place, [cells[named + p] for p in places], order, units)
        values.append(row)
        faults += wrong
    raise_faults(name, faults)
    if not values:
        raise WbcError(f"{name}: no posture (write one row of values for each below the header)")
    return tuple(names), values


def _row(
    place: str, cells: list[str], order: tuple[str, ...], units: _Units
) -> tuple[list[float], list[str]]:
    """One posture [rad] and its faults."""
    row: list[float] = []
    faults: list[str] = []
    far: list[str] = []
    for j, (joint, cell) in enumerate(zip(order, cells, strict=True)):
        try:
            value = units.radians * parse_number(cell)
        except ValueError as error:
            said = f"'{shown(cell)}' " if cell.strip() else ""
            faults.append(f"{place}: {joint}: {said}{error} (write a plain decimal number)")
            continue
        if not units.lower[j] <= value <= units.upper[j]:
            far.append(f"{joint} = {shown(cell.strip(), 20)} {units.name}")
        row.append(value)
    if far:
        remedy = "looks like degrees, say '# unit: deg'"
        if units.stated:
            remedy = f"is the unit {units.name} right?"
        faults.append(f"{place}: {_listed(far)} far beyond what the joint can do ({remedy})")
    return row, faults


def _listed(items: Sequence[str], most: int = 3) -> str:
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(shown(item) for item in items[:most]) + more


def _is_number(text: str) -> bool:
    try:
        parse_number(text)
    except ValueError:
        return False
    return True
