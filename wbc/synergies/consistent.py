"""Thirty-six full postures that every published table could have been computed from.

The chapter prints what its postures imply and not the postures. Two steps lead back: weights and
directions that are those of principal components exactly and round to Tables 1 to 4, then a rest
of every posture, outside the three synergies, of the printed size.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import nnls

from wbc.arrays import Array, read_only
from wbc.synergies.derived import measured_thumb
from wbc.synergies.tables import Tables, half_units, tables

_BOTH: Final = ("two_synergies", "three_synergies")
_WITHIN: Final = 0.999
"""Share of the half unit that is used: what is rounded must not stand on the border."""
_GIVE: Final = 0.01
"""Of a half unit, for one half unit further from all other printed numbers: so much dearer is it
to miss an entry of Table 3's column "two syn", three of which cannot be met."""
_SIGMA: Final = 0.8503
"""σ₃ of (53), from the chapter's text; Tables 2 and 4 as printed give 0.85026."""
_MARGIN: Final = 0.05
"""Kept from the ranges while searching, [deg]: the last, exact step moves the postures a little."""
_SEARCH: Final = 3000
_SEED: Final = 1


class _Spanned(NamedTuple):
    """Principal components that round to the tables: Ê (n, 3); Table 2, (N, 3) [deg]; Table 4's
    errors with three synergies (N,) [deg]; (N,) the thumb's c − ĉ [deg]; (n,) c̄ [deg]."""

    basis: Array
    weights: Array
    errors: Array
    thumb: Array
    mean: Array


def repaired_basis() -> Array:
    """(15, 3) Ê of Table 1, with the one entry of e₃ changed that makes its columns orthonormal.

    As printed |e₃|² is 0.996, 14 times further from 1 than four digits can bring it, and one entry
    alone can mend that together with the products with e₁ and e₂: that of the thumb's proximal
    joint, 0.3693 where the digits of 0.3639 were exchanged.
    """
    printed = tables().basis
    lack = 1.0 - printed[:, 2] @ printed[:, 2]
    candidates = []
    for joint, entry in enumerate(printed[:, 2]):
        basis = printed.copy()
        basis[joint, 2] = np.copysign(np.sqrt(entry**2 + lack), entry)
        candidates.append(basis)
    return read_only(min(candidates, key=lambda b: float(np.abs(b.T @ b - np.eye(3)).max())))


@cache
def consistent_postures() -> Array:
    """(36, 15) C1 to C36 with all joints, [rad], joints in Table 1's order.

    c_i = c̄ + Ê α_i + r_i, where r_i is orthogonal to Ê and has the norm 15 e_i of Table 4, the
    thumb's adduction/abduction is what Table 3 says was measured, Σ r_i = 0 and Σ α_i r_iᵀ = 0: so
    that the principal components of the postures (52) are those of Tables 1 and 2. All are within
    the hand's ranges. One set of many: the rest is found from a fixed seed.
    """
    t = tables()
    spanned = _spanned(t)
    basis, weights = spanned.basis, spanned.weights
    n, count = len(t.joints), len(t.names)
    first = np.eye(n)[0]
    along = first - basis @ basis[0]  # the part of the thumb's axis outside the synergies
    given = np.outer(spanned.thumb, along) / (along @ along)
    rows = _outside(np.column_stack((np.ones(count), weights)))
    columns = _outside(np.column_stack((basis, first)))
    squares = (n * spanned.errors) ** 2 - (given**2).sum(axis=1)
    known = spanned.mean + weights @ basis.T + given
    low, high = t.lower + _MARGIN, t.upper - _MARGIN
    rest = np.random.default_rng(_SEED).normal(size=known.shape)
    for _ in range(_SEARCH):  # from one condition to the next: linear, norms, ranges
        rest = rows @ rest @ columns
        rest *= np.sqrt(squares / (rest**2).sum(axis=1))[:, None]
        rest = np.clip(known + rest, low, high) - known
    rest = _of_norms(rows @ rest @ columns, rows, squares)
    return read_only(np.deg2rad(known + rest))


def _spanned(t: Tables) -> _Spanned:
    """The numbers nearest to the printed ones that are principal components exactly.

    Each is within half a unit of the last printed digit, and so are Tables 3 and 4 from them.
    Three entries of Table 3's column "two syn", C4, C15 and C16, cannot be met with all others:
    they stay off by less than a unit of their last digit.
    """
    measured = measured_thumb()
    mean = t.mean.copy()
    mean[0] = measured.mean()
    offset = measured - mean[0]
    printed = np.concatenate((repaired_basis().ravel(), t.weights.ravel(), t.errors[:, 1]))
    units = np.concatenate((
        half_units("table1", ("e1", "e2", "e3")).ravel(),
        half_units("table2", ("alpha1", "alpha2", "alpha3")).ravel(),
        half_units("table4", _BOTH)[:, 1],
    ))  # fmt: skip
    of_thumb = half_units("table3", _BOTH)
    of_two = half_units("table4", _BOTH)[:, 0]
    cut, n = t.basis.size, len(t.joints)

    def parts(y: Array) -> tuple[Array, Array, Array]:
        x = printed + units * y
        errors = x[cut + t.weights.size :]
        return x[:cut].reshape(-1, 3), x[cut : -len(errors)].reshape(-1, 3), errors

    def exact(y: Array) -> Array:
        """Zero if Ê is orthonormal, α centred and uncorrelated, and (52) holds for the thumb."""
        basis, weights, _ = parts(y)
        product, square = basis.T @ basis - np.eye(3), weights.T @ weights
        pairs = ([0, 0, 1], [1, 2, 2])
        of_thumb = basis[0] - offset @ weights / np.diag(square)
        return np.concatenate((
            1e4 * np.diag(product), 1e4 * product[pairs], weights.sum(axis=0),
            1e-2 * square[pairs], 1e4 * of_thumb,
        ))  # fmt: skip

    def misfit(y: Array) -> Array:
        """Of Table 3, column after column, Table 4's two synergies, σ₃ and y, in half units."""
        basis, weights, errors = parts(y)
        thumb = np.stack((weights[:, :2] @ basis[0, :2], weights @ basis[0]), axis=1)
        two = np.hypot(n * errors, weights[:, 2]) / n
        spread, rest = (weights**2).sum(), ((n * errors) ** 2).sum()
        return np.concatenate((
            ((np.abs(offset[:, None] - thumb) - t.thumb_errors) / of_thumb).T.ravel(),
            (two - t.errors[:, 0]) / of_two, [(spread / (spread + rest) - _SIGMA) / 0.5e-4], y,
        ))  # fmt: skip

    y = np.zeros(len(printed))
    for _ in range(6):  # linear but for little: each step finds the nearest of all y anew
        zero, slope = exact(y), _slope(exact, y)
        fit, bend = misfit(y), _slope(misfit, y)
        y = _nearest(slope, slope @ y - zero, bend, fit - bend @ y, len(t.names))
    for _ in range(3):
        y = y - np.linalg.lstsq(_slope(exact, y), exact(y), rcond=None)[0]
    basis, weights, errors = parts(y)
    return _Spanned(basis, weights, errors, offset - weights @ basis[0], mean)


def _slope(function: Callable[[Array], Array], y: Array) -> Array:
    """The derivative, by central differences."""
    columns = [(function(y + d) - function(y - d)) / 2e-4 for d in 1e-4 * np.eye(len(y))]
    return np.stack(columns, axis=1)


def _nearest(equal: Array, value: Array, band: Array, centre: Array, give: int) -> Array:
    """The shortest y with equal y = value and |band y + centre| within a half unit.

    The first `give` rows of `band` may be missed at a price. As a problem of least distance, which
    Lawson and Hanson, Solving Least Squares Problems, chapter 23, turn into one of least squares
    with a positive solution: unique, and found in a finite number of steps.
    """
    slack = np.zeros((len(band), give))
    slack[:give] = _GIVE * np.eye(give)
    equal = np.hstack((equal, np.zeros((len(equal), give))))
    band = np.hstack((band, slack))
    start = np.linalg.lstsq(equal, value, rcond=None)[0]
    free = np.linalg.svd(equal)[2][len(equal) :].T
    there = band @ start + centre
    sides = np.vstack((band @ free, -band @ free))
    limits = np.concatenate((-_WITHIN - there, there - _WITHIN))
    stacked = np.vstack((sides.T, limits))
    target = np.append(np.zeros(free.shape[1]), 1.0)
    gap = stacked @ nnls(stacked, target)[0] - target
    nearest: Array = (start - free @ (gap[:-1] / gap[-1]))[: equal.shape[1] - give]
    return nearest


def _of_norms(rest: Array, rows: Array, squares: Array) -> Array:
    """The nearest rest with the given squared norms, kept within the projections: by Newton."""
    for _ in range(20):
        gap = squares - (rest**2).sum(axis=1)
        if np.abs(gap).max() < 1e-11:
            break
        share = np.linalg.solve(2.0 * rows * (rest @ rest.T), gap)
        rest = rest + rows @ (share[:, None] * rest)
    return rest


def _outside(columns: Array) -> Array:
    """The projector on everything orthogonal to some columns."""
    base = np.linalg.qr(columns)[0]
    outside: Array = np.eye(len(base)) - base @ base.T
    return outside
