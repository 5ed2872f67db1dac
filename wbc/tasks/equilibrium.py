"""Frictionless equilibrium: where the fingers should slide so that their normals balance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactMode
from wbc.rotations import cross
from wbc.tasks.base import Task, TaskRows

# Below this norm the direction of the residual is taken from its Jacobian instead: at the goal the
# residual is zero, but the direction in which it can vary is not.
_DIRECTION_FLOOR = 1e-9

# Share of freedom from which a row is fulfilled exactly. In the plane two sliding fingers have two
# degrees of freedom: on its way to the goal the moment's row can become parallel to the force's,
# and through such a place it waits. In space a row is long by what the arm could do to it, and
# short is what the object and the other contacts leave of that, the motion of the fingers.
_EXACT_PLANE = 0.3
_EXACT_SPACE = 1e-3
_SLIDING = int(ContactMode.SLIDING)


@kernel
def _direction(f: Array, jacobian: Array) -> Array:
    """Unit vector along f, and where f vanishes the one along which the Jacobian moves f most."""
    size = np.sqrt(np.sum(f * f))
    if size > _DIRECTION_FLOOR:
        unit: Array = f / size
        return unit
    gram = jacobian @ jacobian.T
    best = np.zeros(3)
    column = np.argmax(np.diag(gram))
    best[:] = gram[:, column]
    for _ in range(30):  # power iteration on a 3x3 matrix
        size = np.sqrt(np.sum(best * best))
        if size < 1e-300:
            return np.zeros(3)
        best = gram @ (best / size)
    size = np.sqrt(np.sum(best * best))
    return best / size if size > 1e-300 else np.zeros(3)


@kernel
def _residual_rows(
    residual: Array, derivative: Array, squared: bool, nv: int, error: Array, jacobian: Array
) -> None:
    """Three rows of a residual (3,), or one: half its square or its length."""
    if error.shape[0] == 3:
        error[:] = -residual
        jacobian[:, nv:] = derivative
    elif squared:
        error[0] = -0.5 * np.sum(residual * residual)
        jacobian[0, nv:] = residual @ derivative
    else:
        error[0] = -np.sqrt(np.sum(residual * residual))
        jacobian[0, nv:] = _direction(residual, derivative) @ derivative


@kernel
def _force_row(
    charts: Array,
    frame: Array,
    normal_xi: Array,
    share: Array,
    squared: bool,
    nv: int,
    error: Array,
    jacobian: Array,
) -> None:
    f = np.zeros(3)
    n = charts.shape[0]
    df = np.zeros((3, 2 * n))
    for i in range(n):
        f += share[i] * frame[i, :, 2]
        df[:, 2 * i : 2 * i + 2] = share[i] * normal_xi[i]
    _residual_rows(f, df, squared, nv, error, jacobian)


@kernel
def _center_weights(mode: IntArray, share: Array, weight: Array) -> None:
    """Weights of the contact points in the centre of those that slide, by their shares."""
    total = 0.0
    for i in range(mode.shape[0]):
        weight[i] = share[i] if mode[i] == _SLIDING else 0.0
        total += weight[i]
    if total > 0.0:
        weight /= total


@kernel
def _moment_row(
    charts: Array, frame: Array, normal_xi: Array, share: Array, mode: IntArray,
    about_contacts: bool, squared: bool, planar: bool, nv: int, error: Array, jacobian: Array,
) -> None:  # fmt: skip
    m, f, center = np.zeros(3), np.zeros(3), np.zeros(3)
    n = charts.shape[0]
    weight = np.zeros(n)
    if about_contacts:
        _center_weights(mode, share, weight)
    dm = np.zeros((3, 2 * n))
    for i in range(n):
        f += share[i] * frame[i, :, 2]
        center += weight[i] * charts[i, 0]
    for i in range(n):
        arm = charts[i, 0] - center
        m += share[i] * cross(arm, frame[i, :, 2])
        for k in range(2):
            along = charts[i, 1 + k]
            turning = cross(arm, normal_xi[i, :, k])
            dm[:, 2 * i + k] = share[i] * (cross(along, frame[i, :, 2]) + turning)
            dm[:, 2 * i + k] -= weight[i] * cross(along, f)
    if planar and not squared and error.shape[0] == 1:
        error[0] = -m[2]
        jacobian[0, nv:] = dm[2]
    else:
        _residual_rows(m, dm, squared, nv, error, jacobian)


@final
@dataclass(frozen=True)
class EquilibriumForce(Task):
    """σ = |f|, f = Σ s_i n̂_i over all fingers of the grasp (44); one row, no unit.

    The shares s_i are 1 in the chapter. A thumb that opposes two fingers has 2.

    ε_f = ½ fᵀf itself (`squared`) is the published task: its Jacobian vanishes with it, so any
    damping stalls it. In the plane the vector f is no task either: at the goal its rank drops and
    away from it it takes all the freedom that the moment needs. In space, where the normals of
    three fingers are not all parallel, it is the better one (`vector`): the row of |f| turns with
    f, the faster the less a direction of f can be moved.

    Attributes:
        vector: the three rows of f instead of its length.
        planar: the grasp is; it decides from which share of freedom on the gain is exact.
    """

    squared: bool = False
    vector: bool = False
    planar: bool = True

    @property
    def rows(self) -> int:
        return 3 if self.vector else 1

    @property
    def exact_share(self) -> float:
        return _EXACT_PLANE if self.planar else _EXACT_SPACE

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        _force_row(
            kin.charts, kin.frame, kin.normal_xi, kin.grasp.share, self.squared, kin.robot.model.nv,
            out.error, out.jacobian,
        )  # fmt: skip


@final
@dataclass(frozen=True)
class EquilibriumMoment(Task):
    """σ = m, m = Σ c_i × s_i n̂_i (45): signed in the plane, |m| in space; one row, [m].

    `squared` gives the published ε_m = ½ mᵀm, [m²].

    About the object's origin, as printed, sliding contacts far from it move m by what they do to f,
    and the row is almost the force's. About the centre of the sliding contacts (`about_contacts`)
    it is what is left of m when the forces balance: both vanish together, and the rows differ.
    `vector`: the three rows of m instead of its length, as of the force.
    """

    squared: bool = False
    vector: bool = False
    planar: bool = True
    about_contacts: bool = False

    @property
    def rows(self) -> int:
        return 3 if self.vector else 1

    @property
    def exact_share(self) -> float:
        return _EXACT_PLANE if self.planar else _EXACT_SPACE

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        _moment_row(
            kin.charts, kin.frame, kin.normal_xi, kin.grasp.share, kin.state.mode,
            self.about_contacts, self.squared, kin.grasp.planar, kin.robot.model.nv,
            out.error, out.jacobian,
        )  # fmt: skip
