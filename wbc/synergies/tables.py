"""The chapter's Tables 1 to 5 as data, and everything that follows from them."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import final

import numpy as np

from wbc.arrays import Array, read_only
from wbc.errors import UnknownNameError

_DATA = Path(__file__).resolve().parent / "data"


@final
@dataclass(frozen=True)
class Tables:
    """Tables 1 to 5 as printed. N = 36 reference postures, n = 15 joints, 3 synergies.

    Attributes:
        joints: (n,) in Table 1's order.
        basis: (n, 3) Ê, Table 1; mean: (n,) c̄, Table 1, [deg].
        names: (N,) C1 to C36; weights: (N, 3) Table 2, [deg].
        marks: (N,) ``"star"``: grasped with two synergies; ``"diamond"``: with the third; or "".
        thumb_errors: (N, 2) Table 3, [deg], with two and with three synergies.
        errors: (N, 2) Table 4, [deg], with two and with three synergies.
        new_names: G1 to G5; new_weights: (5, 3) Table 5, [deg].
        lower, upper: (n,) ranges of the hand, [deg], see ``data/ranges.csv``.
    """

    joints: tuple[str, ...]
    basis: Array
    mean: Array
    names: tuple[str, ...]
    weights: Array
    marks: tuple[str, ...]
    thumb_errors: Array
    errors: Array
    new_names: tuple[str, ...]
    new_weights: Array
    lower: Array
    upper: Array


@cache
def tables() -> Tables:
    """The tables that travel with the package."""
    eigen, ranges = _rows("table1"), _rows("ranges")
    weights, new = _rows("table2"), _rows("table5")
    alpha = ("alpha1", "alpha2", "alpha3")
    both = ("two_synergies", "three_synergies")
    return Tables(
        joints=tuple(row["joint"] for row in eigen),
        basis=_numbers(eigen, ("e1", "e2", "e3")),
        mean=_numbers(eigen, ("mean",))[:, 0],
        names=tuple(row["posture"] for row in weights),
        weights=_numbers(weights, alpha),
        marks=tuple(row["mark"] for row in weights),
        thumb_errors=_numbers(_rows("table3"), both),
        errors=_numbers(_rows("table4"), both),
        new_names=tuple(row["posture"] for row in new),
        new_weights=_numbers(new, alpha),
        lower=_numbers(ranges, ("lower",))[:, 0],
        upper=_numbers(ranges, ("upper",))[:, 0],
    )


def weights_of(name: str) -> Array:
    """(3,) weights of a published grasp, ``C1`` to ``C36`` or ``G1`` to ``G5``, [rad].

    Raises:
        UnknownNameError: no such grasp.
    """
    t = tables()
    known = dict(zip(t.names + t.new_names, [*t.weights, *t.new_weights], strict=True))
    if name not in known:
        raise UnknownNameError("grasp", name, known)
    return read_only(np.deg2rad(known[name]))


def half_units(name: str, columns: tuple[str, ...]) -> Array:
    """(m, columns) half a unit of the last printed digit, of a table by its file's name."""
    fractions = [[row[column].partition(".")[2] for column in columns] for row in _rows(name)]
    return read_only([[0.5 * 10.0 ** -len(digits) for digits in row] for row in fractions])


def _rows(name: str) -> list[dict[str, str]]:
    with open(_DATA / f"{name}.csv", encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def _numbers(rows: list[dict[str, str]], columns: tuple[str, ...]) -> Array:
    return read_only([[float(row[column]) for column in columns] for row in rows])
