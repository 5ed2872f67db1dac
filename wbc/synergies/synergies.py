"""Postural synergies: the few directions in which the joints of a hand move together."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np

from wbc.arrays import Array, read_only
from wbc.errors import WbcError
from wbc.synergies.storage import read_fields, write_fields
from wbc.synergies.tables import tables

_LARGEST: Final = 1e6
"""No posture has a larger entry, [rad]; squares of such entries are far from overflow."""


@final
@dataclass(frozen=True, eq=False)
class Synergies:
    """A hand's postures as c = c̄ + Ê α (55).

    Attributes:
        joints: (n,) names, in the order of every posture.
        mean: (n,) c̄, the zero-offset posture, [rad].
        basis: (n, k) Ê (54), columns as nearly orthonormal as their source gives them.
        variances: (k,) s_j of (53), the variance along each synergy, [rad²], falling if fitted.
        total_variance: of all n components, [rad²].
        lower, upper: (n,) the hand's ranges, [rad]; infinite where none is known.
    """

    joints: tuple[str, ...]
    mean: Array
    basis: Array
    variances: Array
    total_variance: float
    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        if np.ndim(self.basis) != 2:
            raise WbcError(f"synergies: 'basis' must be (n, k), got shape {np.shape(self.basis)}")
        n, k = len(self.joints), np.shape(self.basis)[1]
        shapes = {
            "mean": (n,), "basis": (n, k), "variances": (k,), "lower": (n,), "upper": (n,),
        }  # fmt: skip
        for name, shape in shapes.items():
            values = read_only(getattr(self, name))
            if values.shape != shape:
                raise WbcError(f"synergies of {n} joints: '{name}' must be {shape}, "
                               f"got {values.shape}")  # fmt: skip
            finite = np.isfinite(values) if name not in ("lower", "upper") else ~np.isnan(values)
            if not finite.all():
                raise WbcError(f"synergies: '{name}' holds what is no finite number")
            object.__setattr__(self, name, values)
        if len(set(self.joints)) != n:
            raise WbcError("synergies: two joints have the same name")
        if not 1 <= k <= n:
            raise WbcError(f"{k} synergies of {n} joints: between 1 and the number of joints")
        lengths = np.linalg.svd(self.basis, compute_uv=False)
        if lengths.min() <= 1e-9 * max(1.0, lengths.max()):
            raise WbcError(f"synergies: {k} directions of {n} joints are not independent")
        if not (self.lower <= self.upper).all():
            raise WbcError("synergies: a joint's lower limit is above its upper one")
        if (self.variances < 0.0).any():
            raise WbcError("synergies: a variance is negative")
        if not self.variances.sum() <= self.total_variance * (1.0 + 1e-9) < np.inf:
            raise WbcError("synergies: the total variance is below that of the synergies")

    @classmethod
    def from_table(cls) -> Synergies:
        """The published ones of the DEXMART hand: Table 1, variances (53) from Tables 2 and 4."""
        t = tables()
        n, m = len(t.joints), len(t.names)
        spread = (t.weights**2).sum(axis=0)  # along the synergies, and what is left of each posture
        rest = ((n * t.errors[:, 1]) ** 2).sum()
        square = np.deg2rad(1.0) ** 2 / m
        return cls(
            joints=t.joints,
            mean=np.deg2rad(t.mean),
            basis=t.basis,
            variances=square * spread,
            total_variance=float(square * (spread.sum() + rest)),
            lower=np.deg2rad(t.lower),
            upper=np.deg2rad(t.upper),
        )

    @classmethod
    def fit(
        cls,
        postures: Array,
        joints: Sequence[str] | None = None,
        *,
        count: int = 3,
        lower: Array | None = None,
        upper: Array | None = None,
    ) -> Synergies:
        """The principal components of a set of postures (52), by singular values of the offsets.

        A column's sign is such that the sum of its cubes is positive: the large entries decide,
        and not one of them alone, so that it is the same for postures a little different.

        Args:
            postures: (m, n) [rad], m >= 2.
            joints: (n,) names; ``joint_1`` and so on where not given.
            count: k, how many synergies are kept, at most min(m − 1, n).
            lower, upper: (n,) the hand's ranges, [rad].

        Raises:
            WbcError: not a table of finite numbers, too few postures, none differs in k directions.
        """
        values = np.array(postures, dtype=np.float64, order="C")  # the order of sums is fixed
        if values.ndim != 2 or not values.size:
            raise WbcError(f"postures must be a table (m, n) of numbers, got shape {values.shape}")
        if not (np.abs(values) <= _LARGEST).all():
            raise WbcError(f"posture {_first_bad(values)} holds what is no angle in rad")
        m, n = values.shape
        names = tuple(f"joint_{j + 1}" for j in range(n)) if joints is None else tuple(joints)
        if len(names) != n:
            raise WbcError(f"{len(names)} joints are named, but a posture has {n} values")
        mean = values.mean(axis=0)
        _, lengths, directions = np.linalg.svd(values - mean, full_matrices=False)
        variances = np.asarray(lengths**2 / m, dtype=np.float64)
        # The mean is rounded at the size of the postures, not of their offsets.
        noise = max(m, n) * np.finfo(float).eps * np.linalg.norm(values)
        rank = int(np.sum(lengths > noise))
        if not 1 <= count <= rank:
            remedy = f"1 to {rank} can" if rank else "record others"
            raise WbcError(
                f"{m} postures differ in {rank} directions: {count} synergies cannot be found "
                f"({remedy})"
            )
        basis = directions[:count].T
        unknown = np.full(n, np.inf)
        return cls(
            joints=names,
            mean=mean,
            basis=basis * _signs(basis),
            variances=variances[:count],
            total_variance=float(variances.sum()),
            lower=-unknown if lower is None else lower,
            upper=unknown if upper is None else upper,
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write a JSON file from which `load` gives the same numbers to the last bit.

        Raises:
            WbcError: the file cannot be written.
        """
        return write_fields(path, vars(self))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Synergies:
        """Read a file that `save` or a person wrote; its key ``unit`` may be ``"deg"``.

        Raises:
            WbcError: one line: the file, the key, what is wrong and what to write.
        """
        fields = read_fields(path)
        try:
            return cls(**fields)
        except WbcError as error:
            raise WbcError(f"{os.fspath(path)}: {error}") from None

    @property
    def count(self) -> int:
        """How many synergies there are, k."""
        return int(self.basis.shape[1])

    @property
    def explained(self) -> Array:
        """(k,) σ_j of (53): share of the variance that the first j synergies explain."""
        share: Array = np.cumsum(self.variances) / self.total_variance
        return share

    @property
    def inverse(self) -> Array:
        """(k, n) Ê†, the pseudo-inverse of (56)."""
        return np.asarray(np.linalg.pinv(self.basis), dtype=np.float64)

    def project(self, postures: Array) -> Array:
        """Weights of postures (56): (n,) → (k,), or (m, n) → (m, k), [rad].

        Raises:
            WbcError: another number of joints, or a value that is not finite.
        """
        values = self._checked(postures, len(self.joints), "joint")
        weights: Array = (values - self.mean) @ self.inverse.T
        return weights

    def posture(self, weights: Array) -> Array:
        """Postures of weights (55): (k,) → (n,), or (m, k) → (m, n), [rad]; may leave the ranges.

        Raises:
            WbcError: another number of weights, or a value that is not finite.
        """
        values = self._checked(weights, self.count, "synergy")
        postures: Array = self.mean + values @ self.basis.T
        return postures

    def command(self, weights: Array) -> Array:
        """What a hand can be told: `posture`, each joint clipped to its range, [rad]."""
        clipped: Array = np.clip(self.posture(weights), self.lower, self.upper)
        return clipped

    def excess(self, postures: Array) -> Array:
        """How far each joint of postures (…, n) is above (> 0) or below (< 0) its range, [rad]."""
        values = self._checked(postures, len(self.joints), "joint")
        beyond: Array = values - np.clip(values, self.lower, self.upper)
        return beyond

    def ranges(self) -> Array:
        """(k, 2) least and largest weight of each synergy alone, every joint kept in its range.

        [rad]; infinite where no joint's range bounds it; NaN where c̄ itself is out of range.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (
                np.stack((self.lower - self.mean, self.upper - self.mean))[..., None] / self.basis
            )
        ends[:, self.basis == 0.0] = np.array([-np.inf, np.inf])[:, None]
        out: Array = np.stack((ends.min(axis=0).max(axis=0), ends.max(axis=0).min(axis=0)), axis=1)
        if (self.excess(self.mean) != 0.0).any():
            out[:] = np.nan
        return out

    def _checked(self, values: Array, size: int, what: str) -> Array:
        array = np.asarray(values, dtype=np.float64)
        if array.ndim not in (1, 2) or array.shape[-1] != size:
            raise WbcError(f"one number for each {what} is needed, {size}; got shape {array.shape}")
        if not np.isfinite(array).all():
            place = int(np.argwhere(~np.isfinite(array))[0][-1]) + 1
            raise WbcError(f"the number of {what} {place} is not finite")
        return array


def _first_bad(values: Array) -> int:
    """The first row with an entry that is no angle, counted from 1."""
    return int(np.argwhere(~(np.abs(values) <= _LARGEST))[0][0]) + 1


def _signs(basis: Array) -> Array:
    """(k,) ±1 for the columns; where the cubes cancel, the first large entry decides."""
    cubes = (basis**3).sum(axis=0)
    large = np.abs(basis) > 0.5 * np.abs(basis).max(axis=0)
    first = basis[large.argmax(axis=0), np.arange(basis.shape[1])]
    signs: Array = np.where(np.where(np.abs(cubes) > 1e-6, cubes, first) < 0.0, -1.0, 1.0)
    return signs
