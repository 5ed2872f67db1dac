"""What the grasping-force optimization is asked: contacts, limits and the wrench to supply."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, cast, final

import numpy as np

from wbc.archive import read_arrays, write_arrays
from wbc.arrays import Array, IntArray, read_only
from wbc.errors import WbcError

POINT: Final = "point"
"""Point contact with friction (2): force only, c_i = (x, y, z)."""
SOFT_FINGER: Final = "soft_finger"
"""Soft-finger contact (3): also a moment about the normal, c_i = (x, y, z, t)."""

W_P: Final = 1.0
"""Weight of the normal forces in (15), [1]."""
W_BF: Final = 1e-2
"""Weight of the friction barrier (16), [N²]."""
W_BT: Final = 1e-3
"""Weight of the torque barrier (16), [N]."""

_WIDEST = 1e100  # squares and ratios of limits must stay numbers
_ARRAYS = ("G", "J", "tau_e", "tau_min", "tau_max", "mu", "h_e")
_OPTIONAL = ("mu_t", "model", "w_p", "w_bF", "w_bT")


@final
@dataclass(frozen=True, eq=False)
class GraspForceProblem:
    """Find contact forces c with G c = h_e (1), in the friction cones (2)-(3), with joint torques
    τ = Jᵀ c + τ_e (4) inside their limits (5), pressing as little as the cost (15) allows.

    The components of contact i in c are (x, y, z), and t for a soft finger; z along the inward
    normal, so that c_z > 0 presses; forces in [N], the moment t in [Nm]. M is the number of all
    components, n of contacts, l of joints.

    Attributes:
        G: (6, M) grasp matrix: force [N] and moment [Nm] that the contacts exert on the object.
        J: (M, l) hand Jacobian, rows in the order of c; a joint that moves several fingers (an arm)
            has entries in the rows of all of them.
        tau_e: (l,) joint torques that are needed without contact forces (weight, motion), [Nm].
        tau_min, tau_max: (l,) limits of τ, both finite or both infinite for each joint, [Nm].
        mu: (n,) tangential friction coefficients.
        h_e: (6,) wrench that the contacts must supply, force then moment, as the rows of G.
        mu_t: (n,) torsional friction, moment per normal force, of soft fingers, [m]; not used
            for point contacts.
        model: (n,) ``"point"`` or ``"soft_finger"``; one name stands for all contacts.
        w_p: weight of the normal forces, [1].
        w_bF: weight of the friction barrier, [N²].
        w_bT: weight of the torque barrier, [N].

    Raises:
        WbcError: on a wrong shape, a value that is not finite, a friction coefficient that is not
            positive, τ_min ≥ τ_max, a weight that is not positive, an unknown contact model.
    """

    G: Array
    J: Array
    tau_e: Array
    tau_min: Array
    tau_max: Array
    mu: Array
    h_e: Array
    mu_t: Array | None = None
    model: str | Sequence[str] = POINT
    w_p: float = W_P
    w_bF: float = W_BF
    w_bT: float = W_BT

    def __post_init__(self) -> None:
        n = _values(self, "mu", (None,))
        if n == 0:
            raise WbcError("mu is empty: a grasp needs contacts")
        try:
            models = (
                (self.model,) * n if isinstance(self.model, str) else tuple(map(str, self.model))
            )
        except TypeError:
            raise WbcError("model is neither a name nor a list of names") from None
        _set(self, "model", models)
        for name in models:
            if name not in (POINT, SOFT_FINGER):
                raise WbcError(f"model is '{name}': it is '{POINT}' or '{SOFT_FINGER}'")
        if len(models) != n:
            raise WbcError(f"model names {len(models)} contacts, mu has {n}")
        if self.mu_t is None:
            _set(self, "mu_t", np.ones(n))
            if SOFT_FINGER in models:
                raise WbcError("mu_t is missing: soft fingers need it")
        else:  # of point contacts: any value
            _values(self, "mu_t", (n,), finite=None)
            soft = np.array([m == SOFT_FINGER for m in models])
            _set(self, "mu_t", np.where(soft, self.mu_t, 1.0))
        _values(self, "mu_t", (n,))
        l_joints = _values(self, "tau_e", (None,))
        for name, shape in (
            ("G", (6, self.size)), ("J", (self.size, l_joints)), ("h_e", (6,)),
        ):  # fmt: skip
            _values(self, name, shape)
        for name in ("tau_min", "tau_max"):
            _values(self, name, (l_joints,), finite=False)
        self._check_signs()

    def _check_signs(self) -> None:
        for name in ("mu", "mu_t"):
            for i in np.flatnonzero(~(getattr(self, name) > 0.0)):
                raise WbcError(f"{name}[{i}] is {getattr(self, name)[i]:g}: it must be positive")
        for name in ("w_p", "w_bF", "w_bT"):
            try:
                value = float(getattr(self, name))
            except (TypeError, ValueError, OverflowError):
                raise WbcError(f"{name} is not a number") from None
            _set(self, name, value)
            if not (value > 0.0 and np.isfinite(value)):
                raise WbcError(f"{name} is {value:g}: it must be positive")
        for j in np.flatnonzero(~(self.tau_min < self.tau_max)):
            low, high = self.tau_min[j], self.tau_max[j]
            raise WbcError(f"tau_min[{j}] is {low:g}, not below tau_max[{j}], {high:g}")
        for j in np.flatnonzero(np.isfinite(self.tau_min) != np.isfinite(self.tau_max)):
            raise WbcError(f"joint {j} has one infinite torque limit: give both finite, or none")
        widest = np.maximum(np.abs(self.tau_min), np.abs(self.tau_max))
        for j in np.flatnonzero(np.isfinite(widest) & (widest > _WIDEST)):
            raise WbcError(f"joint {j} has torque limits beyond {_WIDEST:g}: give none")

    @property
    def contacts(self) -> int:
        """Number of contacts, n."""
        return len(self.mu)

    @property
    def joints(self) -> int:
        """Number of joints, l."""
        return len(self.tau_e)

    @cached_property
    def size(self) -> int:
        """Number of components of c, M."""
        return int(self.dims.sum())

    @cached_property
    def dims(self) -> IntArray:
        """(n,) components of each contact: 3, or 4 for a soft finger."""
        return np.array([4 if m == SOFT_FINGER else 3 for m in self.model], dtype=np.int64)

    @cached_property
    def first(self) -> IntArray:
        """(n,) where each contact's components begin in c."""
        starts: IntArray = np.cumsum(self.dims) - self.dims
        return starts

    @cached_property
    def normal(self) -> IntArray:
        """(n,) where each contact's normal component is in c."""
        return self.first + 2

    @cached_property
    def scale(self) -> Array:
        """(M,) what divides c to give (x/μ, y/μ, z, t/μ_t): there every cone is z ≥ |s|."""
        scale = np.ones(self.size)
        scale[self.first] = scale[self.first + 1] = self.mu
        soft = self.dims == 4
        scale[self.first[soft] + 3] = cast(Array, self.mu_t)[soft]
        return read_only(scale)

    @cached_property
    def limited(self) -> IntArray:
        """Joints that have torque limits."""
        return np.flatnonzero(np.isfinite(self.tau_min))

    def with_(self, **changes: Any) -> GraspForceProblem:
        """The same problem with other values, e.g. ``with_(h_e=wrench)``."""
        return replace(self, **changes)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the problem as one ``.npz``.

        Raises:
            WbcError: the file cannot be written.
        """
        names = (*_ARRAYS, *_OPTIONAL)
        return write_arrays(path, {name: np.asarray(getattr(self, name)) for name in names})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> GraspForceProblem:
        """Read a problem; see the attributes for the names in the file.

        Raises:
            WbcError: one line that names the file: it cannot be read, or what the class refuses.
        """
        arrays = read_arrays(path, _ARRAYS, optional=_OPTIONAL, what="a grasp force problem")
        values: dict[str, Any] = dict(arrays)
        if "model" in values:
            model = values["model"]
            if model.dtype.kind != "U":
                raise WbcError(f"'{os.fspath(path)}': model is not text")
            values["model"] = str(model) if model.ndim == 0 else [str(m) for m in model.ravel()]
        for name in ("w_p", "w_bF", "w_bT"):
            if name in values:
                if values[name].size != 1 or values[name].dtype.kind not in "fiu":
                    raise WbcError(f"'{os.fspath(path)}': {name} is not one number")
                values[name] = float(values[name].ravel()[0])
        try:
            return cls(**values)
        except WbcError as error:
            raise WbcError(f"'{os.fspath(path)}': {error}") from None


def _set(problem: GraspForceProblem, name: str, value: Any) -> None:
    object.__setattr__(problem, name, value)


def _values(
    problem: GraspForceProblem,
    name: str,
    shape: tuple[int | None, ...],
    *,
    finite: bool | None = True,
) -> int:
    """Keep a field as read-only doubles of `shape` (None: any length); its first length.

    finite: False: infinite values may be, NaN may not; None: both.
    """
    try:
        given = np.asarray(getattr(problem, name))
        if given.dtype.kind not in "fiub":
            raise ValueError
        array = read_only(given)
    except (TypeError, ValueError):
        raise WbcError(f"{name} is not an array of numbers") from None
    if array.ndim != len(shape) or any(
        want is not None and want != got for want, got in zip(shape, array.shape, strict=True)
    ):
        want_text = ", ".join("any" if k is None else str(k) for k in shape)
        want_text += "," * (len(shape) == 1)
        raise WbcError(f"{name} has shape {array.shape}, expected ({want_text})")
    bad = ~np.isfinite(array) if finite else np.isnan(array)
    if finite is not None and bad.any():
        where = tuple(int(k) for k in np.argwhere(bad)[0])
        what = array[where]
        index = ", ".join(map(str, where))
        raise WbcError(
            f"{name}[{index}] is {what:g}: it must be {'finite' if finite else 'a number'}"
        )
    _set(problem, name, array)
    return len(array)
