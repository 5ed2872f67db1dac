"""The extended finger (24)-(34): active joints, then the contact as passive virtual joints.

The chain of finger i runs over its joints to the tip frame F, turns by the ball and socket R_FC,
goes back along the object's outward normal by l − Δl to the contact frame C, and through the
inverse of the chart T_OC(ξ) to the object. Each finger in contact thus has its own idea of where
the object is.

The tick does not stack J̃ of (34). θ̇ enters only the angular rows of (33), through an invertible
matrix, so those rows give θ̇ and drop out; ξ̇ moves the tip only within the tangent plane, so of a
sliding tip's three linear rows the normal one remains and the others give ξ̇. What is left is one
row for a sliding tip, three (two in the plane) for a fixed one, on the active joints alone: exactly
(33) solved with a metric that charges the passive joints nothing. `extended_jacobian` builds J̃
itself, for the printed law, the classification and the tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.grasp import ContactMode, ContactState, Grasp, ObjectReference
from wbc.contact.surfaces.gauss import gauss_frames
from wbc.errors import SetupError
from wbc.robot.kinematics import Kinematics
from wbc.rotations import (
    cross,
    exp_so3,
    log_so3,
    multiply,
    multiply_transposed,
    rotate,
    skew,
)

_FIXED = int(ContactMode.FIXED)
_SLIDING = int(ContactMode.SLIDING)


@kernel
def _object_poses(
    mode: IntArray, charts: Array, frame: Array, pivot: Array, reach: Array,
    tip: Array, tip_rotation: Array, position: Array, rotation: Array, arm: Array,
    estimate_p: Array, estimate_r: Array,
) -> int:  # fmt: skip
    """Pose of the object by every finger in contact, and their mean; how many there are.

    From (27) and (30): o_f = o_o + R_o (c + (l − Δl) n̂), R_o = R_F R_FC R_OCᵀ; arm is o_f − o_o.
    """
    holding = 0
    turn = np.empty((3, 3))
    for i in range(mode.shape[0]):
        if mode[i] == 0:
            continue
        multiply(tip_rotation[i], pivot[i], turn)
        multiply_transposed(turn, frame[i], rotation[i])
        rotate(rotation[i], charts[i, 0] + reach[i] * frame[i, :, 2], arm[i])
        position[i] = tip[i] - arm[i]
        if holding == 0:
            estimate_p[:] = 0.0
            estimate_r[:] = rotation[i]
        estimate_p += position[i]
        holding += 1
    if holding > 0:
        estimate_p /= holding
    if holding > 1:
        # mean rotation: one step in the tangent space at the first, they differ by errors only
        mean = np.zeros(3)
        for i in range(mode.shape[0]):
            if mode[i] != 0:
                multiply_transposed(rotation[i], estimate_r, turn)
                mean += log_so3(turn)
        multiply(exp_so3(mean / holding), estimate_r.copy(), estimate_r)
    return holding


@kernel
def _contact_rows(
    mode: IntArray, planar: bool, gain: float, charts: Array, frame: Array, normal_xi: Array,
    reach: Array, reach_rate: Array, linear: Array, position: Array, rotation: Array, arm: Array,
    reference_p: Array, reference_r: Array, twist: Array, error: Array, twist_cmd: Array,
    rows: Array, rhs: Array, xi_jacobian: Array, xi_drift: Array,
) -> int:  # fmt: skip
    """Rows of (33) left on the active joints, and the sliding rates that go with them.

    Returns the number of rows r; rows[:r] q̇ = rhs[:r] is the main task (35), and
    ξ̇_i = xi_jacobian_i q̇ + xi_drift_i.
    """
    r = 0
    n_xi = 1 if planar else 2
    turn = np.empty((3, 3))
    normal = np.empty(3)
    tangent = np.empty((n_xi, 3))
    inverse = np.empty((n_xi, 3))
    for i in range(mode.shape[0]):
        xi_jacobian[i] = 0.0
        xi_drift[i] = 0.0
        if mode[i] == 0:
            continue
        multiply_transposed(reference_r, rotation[i], turn)
        error[i, :3] = reference_p - position[i]
        error[i, 3:] = log_so3(turn)
        twist_cmd[i] = twist + gain * error[i]
        rotate(rotation[i], frame[i, :, 2], normal)
        tip_velocity = twist_cmd[i, :3] + cross(twist_cmd[i, 3:], arm[i]) + reach_rate[i] * normal
        if mode[i] == 1:
            k = 2 if planar else 3
            rows[r : r + k] = linear[i, :k]
            rhs[r : r + k] = tip_velocity[:k]
            r += k
            continue
        rows[r] = normal[0] * linear[i, 0] + normal[1] * linear[i, 1] + normal[2] * linear[i, 2]
        rhs[r] = np.sum(normal * tip_velocity)
        r += 1
        for k in range(n_xi):
            # tangent vectors of the surface that the tip slides on, l − Δl outside the object's
            rotate(rotation[i], charts[i, 1 + k] + reach[i] * normal_xi[i, :, k], tangent[k])
        _left_inverse(tangent, inverse)
        for k in range(n_xi):
            a, b, c = inverse[k, 0], inverse[k, 1], inverse[k, 2]
            xi_jacobian[i, k] = a * linear[i, 0] + b * linear[i, 1] + c * linear[i, 2]
            xi_drift[i, k] = -np.sum(inverse[k] * tip_velocity)
    return r


@kernel
def _left_inverse(t: Array, out: Array) -> None:
    """(TᵀT)⁻¹Tᵀ for one or two tangent vectors, the rows of t; zero where they vanish (a pole)."""
    out[:] = 0.0
    a = np.sum(t[0] * t[0])
    if t.shape[0] == 1:
        if a > 1e-16:
            out[0] = t[0] / a
        return
    b, c = np.sum(t[0] * t[1]), np.sum(t[1] * t[1])
    det = a * c - b * b
    if det > 1e-16 * (a * c):
        out[0] = (c * t[0] - b * t[1]) / det
        out[1] = (a * t[1] - b * t[0]) / det


@kernel
def _extend(
    mode: IntArray, tip_rotation: Array, pivot: Array, spin: Array, angular: Array,
    xi_jacobian: Array, xi_drift: Array, twist_cmd: Array, main: Array, rest: Array,
    out_main: Array, out_total: Array,
) -> None:  # fmt: skip
    """Both velocities of q̃: `main` moves the object as commanded, `rest` leaves it where it is."""
    rates = np.empty(rest.shape[0] + 5 * mode.shape[0])
    for moves in (True, False):
        v = main if moves else rest
        out = out_main if moves else rates
        _passive_rates(
            mode, tip_rotation, pivot, spin, angular, xi_jacobian, xi_drift, twist_cmd, v, moves,
            out,
        )  # fmt: skip
    out_total[:] = out_main + rates


@kernel
def _passive_rates(
    mode: IntArray, tip_rotation: Array, pivot: Array, spin: Array, angular: Array,
    xi_jacobian: Array, xi_drift: Array, twist_cmd: Array, v: Array, with_object: bool, out: Array,
) -> None:  # fmt: skip
    """q̇, then ξ̇ and θ̇ (turning rate of C in F, in F's axes) by (29), the angular rows of (33)."""
    n, nv = mode.shape[0], v.shape[0]
    out[:nv] = v
    out[nv:] = 0.0
    w, turn = np.empty(3), np.empty(3)
    for i in range(n):
        if mode[i] == 0:
            continue
        xi = out[nv + 2 * i : nv + 2 * i + 2]
        for k in range(2):
            for j in range(nv):
                xi[k] += xi_jacobian[i, k, j] * v[j]
            if with_object:
                xi[k] += xi_drift[i, k]
        for r in range(3):
            turn[r] = spin[i, r, 0] * xi[0] + spin[i, r, 1] * xi[1]
        rotate(pivot[i], turn, w)
        rotate(tip_rotation[i], w, turn)
        for r in range(3):
            for j in range(nv):
                turn[r] -= angular[i, r, j] * v[j]
            if with_object:
                turn[r] += twist_cmd[i, 3 + r]
        rotate(tip_rotation[i].T, turn, out[nv + 2 * n + 3 * i : nv + 2 * n + 3 * i + 3])


@kernel
def _contacts(
    mode: IntArray, planar: bool, gain: float, charts: Array, pivot: Array, shift: Array,
    reach: Array, reach_rate: Array, tip: Array, tip_rotation: Array, linear: Array,
    reference_p: Array, reference_r: Array, twist: Array, frame: Array, normal_xi: Array,
    spin: Array, position: Array, rotation: Array, estimate_p: Array, estimate_r: Array,
    error: Array, twist_cmd: Array, rows: Array, rhs: Array, xi_jacobian: Array, xi_drift: Array,
) -> tuple[int, int]:  # fmt: skip
    """All of the contacts in one call: frames, object poses, rows. Returns fingers and rows."""
    gauss_frames(charts, frame, normal_xi, spin)
    charts[:, 0] += shift
    estimate_p[:] = reference_p
    estimate_r[:] = reference_r
    arm = np.zeros(tip.shape)
    holding = _object_poses(
        mode, charts, frame, pivot, reach, tip, tip_rotation, position, rotation, arm,
        estimate_p, estimate_r,
    )  # fmt: skip
    count = _contact_rows(
        mode, planar, gain, charts, frame, normal_xi, reach, reach_rate, linear, position,
        rotation, arm, reference_p, reference_r, twist, error, twist_cmd, rows, rhs,
        xi_jacobian, xi_drift,
    )  # fmt: skip
    return holding, count


class HeldEdge(NamedTuple):
    """A sliding contact that is not to go over the edge of its face.

    Attributes:
        finger: index in the grasp.
        direction: (2,) unit vector of ξ across the edge.
        rate: of ξ along it, in the unit of ξ per second; 0 at the edge.
    """

    finger: int
    direction: Array
    rate: float


@final
class ExtendedKinematics:
    """Everything of one tick: the robot's kinematics and the contacts'. A token, like `Kinematics`.

    Attributes:
        grasp: the object and its fingers (None: no object in this scenario).
        robot: the robot's kinematics; tracked frame i is finger i's tip.
        state: the contact variables it was computed from.
        start: where the object is put before the first tick; set once, when the scene is built.
        reference: where the object should be.
        charts: (N, 6, 3) c, c_u, c_v, c_uu, c_uv, c_vv in the object frame, c with the shift.
        frame: (N, 3, 3) Gauss frames R_OC, columns x, y and the outward normal.
        normal_xi: (N, 3, 2) ∂n̂/∂ξ in the object frame.
        spin: (N, 3, 2) angular velocity of C in O per ξ̇, in C's axes.
        position, rotation: (N, 3), (N, 3, 3) pose of the object by each finger in contact.
        error: (N, 6) e_o of (35): position [m], then rotation vector [rad], world's axes.
        twist_cmd: (N, 6) v_od + K_o e_o, the object twist each finger is asked for.
        object_position, object_rotation: mean of the fingers in contact; where there is none, the
            reference.
        rows, rhs: (R, nv), (R,) main task on the active joints; `row_count` of them are in use.
        xi_jacobian, xi_drift: (N, 2, nv), (N, 2) with ξ̇ = xi_jacobian q̇ + xi_drift.
    """

    def __init__(self, robot: Kinematics, grasp: Grasp, gain: float) -> None:
        n, nv = grasp.count, robot.model.nv
        self.robot = robot
        self.grasp = grasp
        self.gain = gain
        self.state = ContactState.planned(grasp, np.zeros(n, dtype=np.int64))
        self.reference = self.start = ObjectReference(
            np.zeros(3), np.eye(3), np.zeros(6), np.array(grasp.rest_length), np.zeros(n)
        )
        self.charts: Array = np.zeros((n, 6, 3))
        self.frame: Array = np.zeros((n, 3, 3))
        self.normal_xi: Array = np.zeros((n, 3, 2))
        self.spin: Array = np.zeros((n, 3, 2))
        self.position: Array = np.full((n, 3), np.nan)
        self.rotation: Array = np.full((n, 3, 3), np.nan)
        self.error: Array = np.full((n, 6), np.nan)
        self.twist_cmd: Array = np.zeros((n, 6))
        self.object_position: Array = np.zeros(3)
        self.object_rotation: Array = np.eye(3)
        self.rows: Array = np.zeros((3 * n, nv))
        self.rhs: Array = np.zeros(3 * n)
        self.row_count = self._contact_rows = 0
        self.holding = 0
        self.xi_jacobian: Array = np.zeros((n, 2, nv))
        self.xi_drift: Array = np.zeros((n, 2))
        self._tip = robot.position[:n]
        self._tip_rotation = robot.rotation[:n]
        self._linear = robot.linear[:n]
        self._angular = robot.angular[:n]

    def update(
        self, q: Array, state: ContactState, reference: ObjectReference
    ) -> ExtendedKinematics:
        """Bring everything to the configuration (q, η) and the object's reference.

        Raises:
            SetupError: the state or the reference is of another number of fingers.
        """
        n = len(self.charts)
        if not (
            len(state.mode) == len(state.xi) == len(state.pivot) == len(state.face) == n
            and len(state.shift) == len(reference.reach) == len(reference.reach_rate) == n
        ):  # compiled kernels would read beyond the end
            raise SetupError(f"contacts and reference must be of {n} fingers")
        self.state, self.reference = state, reference
        self.robot.update(q)
        self.grasp.surface.evaluate(state.xi, state.face, self.charts)
        self.holding, self._contact_rows = _contacts(
            state.mode, self.grasp.planar, self.gain, self.charts, state.pivot, state.shift,
            reference.reach, reference.reach_rate, self._tip, self._tip_rotation, self._linear,
            reference.position, reference.rotation, reference.twist, self.frame, self.normal_xi,
            self.spin, self.position, self.rotation, self.object_position, self.object_rotation,
            self.error, self.twist_cmd, self.rows, self.rhs, self.xi_jacobian, self.xi_drift,
        )  # fmt: skip
        self.row_count = self._contact_rows
        return self

    def hold(self, edges: Sequence[HeldEdge]) -> None:
        """Make ξ̇ across these edges part of the main task, and across no other.

        With ξ̇ = X q̇ + x: d·X q̇ = rate − d·x. A finger held in both directions has the three rows of
        a fixed one.
        """
        row = self._contact_rows
        for finger, direction, rate in edges:
            self.rows[row] = direction @ self.xi_jacobian[finger]
            self.rhs[row] = rate - direction @ self.xi_drift[finger]
            row += 1
        self.row_count = row

    def extend(self, main: Array, rest: Array) -> tuple[Array, Array]:
        """Velocities of q̃ that go with joint velocities: (nv + 5N,) q̇, ξ̇ (N, 2), θ̇ (N, 3).

        θ̇ is the turning rate of the contact frame in the fingertip's axes.

        Args:
            main: (nv,) the main task's, which moves the object as commanded.
            rest: (nv,) in the null space of the main task: the object stands still.

        Returns:
            Of main alone, and of main and rest together.
        """
        size = len(main) + 5 * self.grasp.count
        out_main, out_total = np.empty(size), np.empty(size)
        _extend(
            self.state.mode, self._tip_rotation, self.state.pivot, self.spin, self._angular,
            self.xi_jacobian, self.xi_drift, self.twist_cmd, main, rest, out_main, out_total,
        )  # fmt: skip
        return out_main, out_total

    def touch(self, finger: int) -> Array:
        """R_FC (3, 3) with which a finger that touches now sees the object where it is."""
        rotation: Array = self._tip_rotation[finger].T @ self.object_rotation @ self.frame[finger]
        return rotation


def finger_jacobians(kin: ExtendedKinematics, i: int) -> tuple[Array, Array, Array, Array, Array]:
    """The matrices of one finger's (32), in the world's axes: J_F q̇ + J_η η̇ + J_Δl Δl̇ = Gᵀ v_o.

    Returns:
        J_F (6, nv), J_ξ + J'_ξ (6, 2) with the sign they have in J_η (minus), J_θ (6, 3) per
        turning rate of C in F in F's axes, J_Δl (6, 1), Gᵀ (6, 6). The printed lower-left block of
        G_Δl has the wrong sign after (31); here Gᵀ = [[I, −S(R_o(c + (l−Δl) n̂))], [0, I]].
    """
    reach = float(kin.reference.reach[i])
    r = kin.rotation[i]
    r_c = r @ kin.frame[i]
    normal = r @ kin.frame[i, :, 2]
    j_f = np.vstack([kin.robot.linear[i], kin.robot.angular[i]])
    j_xi = -np.vstack([r @ (kin.charts[i, 1:3].T + reach * kin.normal_xi[i]), r_c @ kin.spin[i]])
    j_theta = np.vstack([np.zeros((3, 3)), kin.robot.rotation[i]])
    j_dl = np.concatenate([normal, np.zeros(3)])[:, None]
    g_t = np.eye(6)
    g_t[:3, 3:] = -skew(r @ (kin.charts[i, 0] + reach * kin.frame[i, :, 2]))
    return j_f, j_xi, j_theta, j_dl, g_t


def extended_jacobian(kin: ExtendedKinematics) -> tuple[Array, Array]:
    """J̃ = [J J_η] of (33)-(34) and the right-hand side Gᵀ(ṽ_od + K_o ẽ_o) − J_Δl Δl̇ of (35).

    Columns: the nv joints, then per finger its chart coordinates (1 or 2) and pivot rates (1 or 3).
    Columns of variables that the contact's type holds, and of fingers not in contact, are zero.
    Rows: 6 per finger in contact (3 in the plane: x, y, ω_z).
    """
    grasp, nv = kin.grasp, kin.robot.model.nv
    pick = [0, 1, 5] if grasp.planar else [0, 1, 2, 3, 4, 5]
    axes = [2] if grasp.planar else [0, 1, 2]
    width = grasp.n_xi + len(axes)
    touching = [i for i in range(grasp.count) if kin.state.mode[i] != ContactMode.FREE]
    j = np.zeros((len(pick) * len(touching), nv + width * grasp.count))
    b = np.zeros(j.shape[0])
    for k, i in enumerate(touching):
        j_f, j_xi, j_theta, j_dl, g_t = finger_jacobians(kin, i)
        rows, start = slice(k * len(pick), (k + 1) * len(pick)), nv + width * i
        j[rows, :nv] = j_f[pick]
        if kin.state.mode[i] == ContactMode.SLIDING:
            j[rows, start : start + grasp.n_xi] = j_xi[pick][:, : grasp.n_xi]
        j[rows, start + grasp.n_xi : start + width] = j_theta[pick][:, axes]
        rate = -float(kin.reference.reach_rate[i])
        b[rows] = (g_t @ kin.twist_cmd[i] - j_dl[:, 0] * rate)[pick]
    return j, b
