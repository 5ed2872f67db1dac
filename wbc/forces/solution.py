"""What the grasping-force optimization answers: forces, margins, and a verdict."""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from wbc.archive import read_arrays, write_arrays
from wbc.arrays import Array
from wbc.errors import WbcError

_ARRAYS = (
    "c", "tau", "phi", "sum_normal", "cone_margin", "torque_margin", "balance", "iterations",
    "status", "gap", "load_factor",
)  # fmt: skip


class ForceStatus(str, Enum):
    """The verdict on a problem."""

    SOLVED = "solved"
    """Optimal to the stated accuracy; balance and every limit hold."""
    LOW_MARGIN = "low_margin"
    """Balance and every limit hold, but some limit by less than the margin asked for."""
    INFEASIBLE_TORQUE_LIMITS = "infeasible_torque_limits"
    """Friction could balance the wrench; the joints are too weak for it."""
    INFEASIBLE_FRICTION = "infeasible_friction"
    """No forces in the friction cones balance the wrench, however strong the joints."""
    RANK_DEFICIENT = "rank_deficient"
    """rank G < 6: some wrench on the object cannot be answered at all."""
    NOT_BALANCED = "not_balanced"
    """The method stopped before the balance (1) held, or before it was optimal."""
    STALE_START = "stale_start"
    """The start given is outside the cones or limits and the method cannot begin anew."""
    INVALID_INPUT = "invalid_input"
    """A number of the problem is not finite."""

    @property
    def usable(self) -> bool:
        """Whether the forces may be applied: they balance and keep every limit."""
        return self in (ForceStatus.SOLVED, ForceStatus.LOW_MARGIN)


@final
@dataclass(frozen=True, eq=False)
class GraspForceSolution:
    """Contact forces, joint torques and how far they are from every limit.

    Where the status is not usable, c is the point that the method reached: it says how far off the
    problem is (a margin below zero is a broken limit), and must not be applied.

    Attributes:
        status: the verdict.
        c: (M,) contact forces in the problem's order, [N], [Nm].
        tau: (l,) joint torques Jᵀ c + τ_e, [Nm].
        phi: the cost (15), [N]; inf outside its domain.
        sum_normal: Σ c_z, [N].
        cone_margin: (n,) c_z − |(x/μ, y/μ, t/μ_t)|, the smaller eigenvalue of F_i (7)-(8), [N].
        torque_margin: (l,) distance of τ to the nearer limit, [Nm]; inf without limits.
        balance: |G c − h_e| over the largest of |h_e| and |G_i c_i|, in the scaled units of G.
        iterations: Newton steps, or steps of the method named.
        gap: certified bound on how far Σ c_z is above its optimum, relative to it, or to
            a millionth of √(w_bF μ/w_p) where it is less; NaN where there is none.
        load_factor: largest λ with G c = λ h_e inside all limits; NaN where not asked for.
    """

    status: ForceStatus
    c: Array
    tau: Array
    phi: float
    sum_normal: float
    cone_margin: Array
    torque_margin: Array
    balance: float
    iterations: int
    gap: float = np.nan
    load_factor: float = np.nan

    @property
    def min_cone_margin(self) -> float:
        """Smallest margin of a friction cone, [N]."""
        return float(self.cone_margin.min())

    @property
    def min_torque_margin(self) -> float:
        """Smallest distance of a joint torque to its limit, [Nm]; inf without limits."""
        return float(self.torque_margin.min(initial=np.inf))

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the solution as one ``.npz``, the smallest margins beside the fields.

        Raises:
            WbcError: the file cannot be written.
        """
        arrays = {name: np.asarray(getattr(self, name)) for name in _ARRAYS}
        arrays["status"] = np.array(self.status.value)
        arrays["min_cone_margin"] = np.array(self.min_cone_margin)
        arrays["min_torque_margin"] = np.array(self.min_torque_margin)
        return write_arrays(path, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> GraspForceSolution:
        """Read a solution.

        Raises:
            WbcError: one line that names the file.
        """
        arrays = read_arrays(path, _ARRAYS, what="a grasp force solution")
        _check_shapes(path, arrays)
        try:
            status = ForceStatus(str(arrays["status"]))
            scalar = {
                name: float(arrays[name])
                for name in ("phi", "sum_normal", "balance", "gap", "load_factor")
            }
            return cls(
                status=status, c=arrays["c"], tau=arrays["tau"], cone_margin=arrays["cone_margin"],
                torque_margin=arrays["torque_margin"], iterations=int(arrays["iterations"]),
                **scalar,
            )  # fmt: skip
        except (TypeError, ValueError, OverflowError) as error:
            text = " ".join(str(error).split())
            raise WbcError(f"'{os.fspath(path)}' is not a grasp force solution: {text}") from None


def _check_shapes(path: str | os.PathLike[str], arrays: dict[str, NDArray[Any]]) -> None:
    """Refuse a file whose arrays are not numbers of fitting shapes."""
    joints, contacts = arrays["tau"].shape, arrays["cone_margin"].shape
    fits = len(contacts) == 1 and contacts[0] > 0 and len(joints) == 1
    for name, array in arrays.items():
        shape: tuple[int, ...] = {
            "c": arrays["c"].shape[:1], "tau": joints, "torque_margin": joints,
            "cone_margin": contacts,
        }.get(name, ())  # fmt: skip
        fits &= array.shape == shape and (name == "status") == (array.dtype.kind == "U")
    fits &= 3 * sum(contacts) <= arrays["c"].size <= 4 * sum(contacts)
    if not fits:
        raise WbcError(f"'{os.fspath(path)}' is not a grasp force solution: its arrays do not fit")
