"""Thirty-six full postures that every published table could have been computed from.

The chapter prints what its postures imply and not the postures. Two steps lead back: weights and
directions that are those of principal components exactly and round to Tables 1 to 4, then a rest
of every posture, outside the three synergies, of the printed size.
"""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from wbc.arrays import Array, read_only
from wbc.synergies.derived import measured_thumb
from wbc.synergies.tables import Tables, half_units, tables

_BOTH: Final = ("two_synergies", "three_synergies")
_WITHIN: Final = 0.999
"""Share of the half unit that is used: what is rounded must not stand on the border."""
_SIGMA: Final = 0.8503
"""σ₃ of (53), from the chapter's text; Tables 2 and 4 as printed give 0.85026."""
_MARGIN: Final = np.deg2rad(0.05)
"""Kept from the ranges while searching, [rad]: the last, exact step moves the postures a little."""
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

    As printed |e₃|² is 0.996, forty times further from 1 than four digits allow, and one entry
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
    margin = np.rad2deg(_MARGIN)
    rest = np.random.default_rng(_SEED).normal(size=known.shape)
    for _ in range(_SEARCH):  # from one condition to the next: linear, norms, ranges
        rest = rows @ rest @ columns
        rest *= np.sqrt(squares / (rest**2).sum(axis=1))[:, None]
        rest = np.clip(known + rest, t.lower + margin, t.upper - margin) - known
    rest = _of_norms(rows @ rest @ columns, rows, squares)
    return read_only(np.deg2rad(known + rest))


def _spanned(t: Tables) -> _Spanned:
    """Numbers within the printed ones' half units that are principal components exactly.

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
    of_thumb = half_units("table3", _BOTH) * _WITHIN
    of_two = half_units("table4", _BOTH)[:, 0] * _WITHIN
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

    def all_misfits(y: Array) -> Array:
        """`exact`, and how far Tables 3 and 4 and σ₃ are missed beyond their rounding."""
        basis, weights, errors = parts(y)
        thumb = np.abs(offset[:, None] - np.stack(
            (weights[:, :2] @ basis[0, :2], weights @ basis[0]), axis=1))  # fmt: skip
        two = np.hypot(n * errors, weights[:, 2]) / n
        spread, rest = (weights**2).sum(), ((n * errors) ** 2).sum()
        sigma = np.array([spread / (spread + rest) - _SIGMA])
        return np.concatenate((
            exact(y),
            (_beyond(thumb - t.thumb_errors, of_thumb) / of_thumb).ravel(),
            _beyond(two - t.errors[:, 0], of_two) / of_two,
            _beyond(sigma, np.array([0.5e-4 * _WITHIN])) / 0.5e-4,
        ))  # fmt: skip

    near = least_squares(all_misfits, np.zeros(len(printed)), bounds=(-_WITHIN, _WITHIN),
                         max_nfev=100).x  # fmt: skip
    for _ in range(4):  # what is left, by the shortest step; differences serve as derivatives
        slope = [(exact(near + d) - exact(near - d)) / 2e-4 for d in 1e-4 * np.eye(len(near))]
        near = near - np.linalg.lstsq(np.array(slope).T, exact(near), rcond=None)[0]
    basis, weights, errors = parts(near)
    return _Spanned(basis, weights, errors, offset - weights @ basis[0], mean)


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


def _beyond(value: Array, allowed: Array) -> Array:
    beyond: Array = value - np.clip(value, -allowed, allowed)
    return beyond
