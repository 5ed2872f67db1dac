"""The log of a run: one array per quantity, its first axis the ticks."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from wbc.archive import read_arrays, write_arrays
from wbc.arrays import Array, BoolArray, IntArray
from wbc.errors import WbcError
from wbc.forces import ForceStatus
from wbc.recording.meta import RunMeta

FORMAT = 3
# Older formats, still read: their scenarios could not plan forces, or not run under torques.
_WITHOUT_FORCES, _WITHOUT_DYNAMICS = 1, 2

# Kind of the array and its axes: T ticks, n joints, N fingers, m tasks (main first), K tip tasks,
# P phases, L levels of the stack, E stack events; digits are themselves.
LAYOUT: dict[str, tuple[type, str]] = {
    "t": (np.float64, "T"),
    "q": (np.float64, "Tn"),
    "v": (np.float64, "Tn"),
    "joint_names": (np.str_, "n"),
    "object_pose": (np.float64, "T7"),
    "object_pose_ref": (np.float64, "T7"),
    "object_error": (np.float64, "TN2"),
    "contact_names": (np.str_, "N"),
    "in_contact": (np.bool_, "TN"),
    "contact_mode": (np.int64, "TN"),
    "contact_points": (np.float64, "TN3"),
    "contact_normals": (np.float64, "TN3"),
    "task_names": (np.str_, "m"),
    "in_stack": (np.bool_, "Tm"),
    "activation": (np.float64, "Tm"),
    "task_error": (np.float64, "Tm"),
    "tip_task_names": (np.str_, "K"),
    "tip_in_stack": (np.bool_, "TK"),
    "tip_activation": (np.float64, "TK"),
    "tip_task_error": (np.float64, "TK"),
    "eps_f": (np.float64, "T"),
    "eps_m": (np.float64, "T"),
    "cost": (np.float64, "T"),
    "min_distance": (np.float64, "T"),
    "phase": (np.int64, "T"),
    "phase_names": (np.str_, "P"),
    "status": (np.int64, "T"),
    "limit_secondary": (np.float64, "T"),
    "limit_main": (np.float64, "T"),
    "limit_change": (np.float64, "T"),
    "limit_clipped": (np.bool_, "T"),
    "limit_joint": (np.int64, "T"),
    "independence": (np.float64, "T"),
    "freedom": (np.float64, "TL"),
    "event_t": (np.float64, "E"),
    "event_task": (np.int64, "E"),
    "event_inserted": (np.bool_, "E"),
    "event_cost": (np.float64, "E"),
}

# D is T where an engine other than the ideal robot ran, else 0. F is T where the scenario plans
# contact forces by an optimizer, else 0; G where either did.
DYNAMICS: dict[str, tuple[type, str]] = {
    "tau": (np.float64, "Dn"),
    "contact_force_meas": (np.float64, "DN3"),
    "object_pose_true": (np.float64, "D7"),
    "slip": (np.float64, "DN"),
    "q_meas": (np.float64, "Dn"),
    "v_meas": (np.float64, "Dn"),
    "torque_status": (np.int64, "D"),
}
FORCES: dict[str, tuple[type, str]] = {
    "contact_force_plan": (np.float64, "GN3"),
    "contact_spin_plan": (np.float64, "FN"),
    "tau_plan": (np.float64, "Fn"),
    "cone_margin": (np.float64, "FN"),
    "torque_margin": (np.float64, "Fn"),
    "wrench_plan": (np.float64, "F6"),
    "object_mass": (np.float64, "F"),
    "object_com": (np.float64, "F3"),
    "force_status": (np.int64, "F"),
    "force_iterations": (np.int64, "F"),
    "phi": (np.float64, "F"),
    "sum_normal": (np.float64, "F"),
}
LAYOUT.update(FORCES)
LAYOUT.update(DYNAMICS)


@final
@dataclass(frozen=True, eq=False)
class Log:
    """A run as arrays; poses, points and normals in the world's axes.

    Attributes:
        meta: what was run.
        complete: the run was recorded to its end, not cut short or saved on the way.
        t: (T,) start of each tick, [s]; increasing.
        q: (T, n) positions of the active joints at t, [rad] or [m].
        v: (T, n) velocities commanded for [t, t + dt].
        joint_names: n names.
        object_pose, object_pose_ref: (T, 7) x y z qx qy qz qw, [m].
        object_error: (T, N, 2) per finger position [m] and orientation [rad]; NaN where free.
        contact_names: N names.
        in_contact: (T, N); `contact_mode` (T, N) says how: 0 free, 1 fixed, 2 sliding.
        contact_points: (T, N, 3) [m]; of a free finger the planned or the last one.
        contact_normals: (T, N, 3) outward.
        task_names: m names, the main task first.
        in_stack: (T, m); the main task always is.
        activation: (T, m) gains ρ; 1 for the main task.
        task_error: (T, m) norms; for the main task the largest position error [m] of a finger.
        tip_task_names, tip_in_stack, tip_activation, tip_task_error: the same for the tips of free
            fingers: K names, (T, K).
        eps_f, eps_m: (T,) residuals (44)-(45) of the co-grasp, [1], [m²].
        cost: (T,) C_Σ.
        min_distance: (T,) over the pairs of the collision cost, [m]; inf without any.
        phase: (T,) index into `phase_names`.
        status: (T,) bits of `wbc.control.state.Status`.
        limit_secondary, limit_main, limit_change: (T,) shares the limit filter left, 1 = all.
        limit_clipped: (T,) joints were clipped one by one.
        limit_joint: (T,) the joint that bound most, -1 for none.
        independence: (T,) smallest independent share of the main task's rows.
        freedom: (T, L) share of freedom each level of the stack found.
        event_t, event_task, event_inserted, event_cost: (E,) the supervisor's decisions: time [s],
            index into `task_names` followed by `tip_task_names`, in or out, predicted cost.
        contact_force_plan: (G, N, 3) planned force of each contact on the object, [N]. G is T where
            forces are planned or torques move the robot, else 0.
        contact_spin_plan: (F, N) planned moment about the inward normal, [Nm]. F is T, or 0 where
            no optimizer plans forces: so for all that follow up to `sum_normal`.
        tau_plan: (F, n) joint torques that go with them (4), [Nm].
        cone_margin: (F, N) distance to the friction cone's side, [N]; NaN where free.
        torque_margin: (F, n) distance of a torque to its nearer limit, [Nm]; inf without one.
        wrench_plan: (F, 6) force [N] and moment [Nm] about the object's origin that the contacts
            supply.
        object_mass, object_com: (F,) [kg], (F, 3) [m], of the object with its contents.
        force_status: (F,) index into the members of `wbc.forces.ForceStatus`.
        force_iterations: (F,) Newton steps.
        phi, sum_normal: (F,) the cost (15) and Σ c_z, [N].
        tau: (D, n) torques held over [t, t + dt], [Nm]. D is T, or 0 where the ideal robot ran: so
            for all that follow.
        contact_force_meas: (D, N, 3) measured force of each contact on the object, [N].
        object_pose_true: (D, 7) where the object is, as `object_pose`, which is where the first
            stage has it.
        slip: (D, N) way each contact has slid while it was to hold, [m].
        q_meas, v_meas: (D, n) where the joints are, and their velocities; `q`, `v` are commanded.
        torque_status: (D,) bits of `wbc.control.force_control.TorqueStatus`.
    """

    meta: RunMeta
    complete: bool
    t: Array
    q: Array
    v: Array
    joint_names: tuple[str, ...]
    object_pose: Array
    object_pose_ref: Array
    object_error: Array
    contact_names: tuple[str, ...]
    in_contact: BoolArray
    contact_mode: IntArray
    contact_points: Array
    contact_normals: Array
    task_names: tuple[str, ...]
    in_stack: BoolArray
    activation: Array
    task_error: Array
    tip_task_names: tuple[str, ...]
    tip_in_stack: BoolArray
    tip_activation: Array
    tip_task_error: Array
    eps_f: Array
    eps_m: Array
    cost: Array
    min_distance: Array
    phase: IntArray
    phase_names: tuple[str, ...]
    status: IntArray
    limit_secondary: Array
    limit_main: Array
    limit_change: Array
    limit_clipped: BoolArray
    limit_joint: IntArray
    independence: Array
    freedom: Array
    event_t: Array
    event_task: IntArray
    event_inserted: BoolArray
    event_cost: Array
    contact_force_plan: Array
    contact_spin_plan: Array
    tau_plan: Array
    cone_margin: Array
    torque_margin: Array
    wrench_plan: Array
    object_mass: Array
    object_com: Array
    force_status: IntArray
    force_iterations: IntArray
    phi: Array
    sum_normal: Array
    tau: Array
    contact_force_meas: Array
    object_pose_true: Array
    slip: Array
    q_meas: Array
    v_meas: Array
    torque_status: IntArray

    @property
    def ticks(self) -> int:
        """Number of ticks, T."""
        return len(self.t)

    @property
    def plans_forces(self) -> bool:
        """Whether contact forces were planned and recorded."""
        return len(self.phi) > 0

    @property
    def dynamic(self) -> bool:
        """Whether torques moved the robot, so that what was measured is recorded, too."""
        return len(self.tau) > 0

    @property
    def all_task_names(self) -> tuple[str, ...]:
        """What `event_task` counts: tasks, then tips."""
        return self.task_names + self.tip_task_names

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the log as ``.npz``: whole or not at all, the same bytes for the same run.

        Raises:
            WbcError: the file cannot be written.
        """
        arrays: dict[str, NDArray[Any]] = {
            "format": np.array(FORMAT, dtype=np.int64),
            "meta": np.array(self.meta.to_json(), dtype=np.str_),
            "complete": np.array(self.complete),
        }
        for name, (kind, _) in LAYOUT.items():
            # a string array needs a width, also when it is empty
            dtype = np.dtype("<U1") if kind is np.str_ else np.dtype(kind).newbyteorder("<")
            values = getattr(self, name)
            if kind is np.str_ and values:
                arrays[name] = np.array(values, dtype=np.str_)
            else:
                arrays[name] = np.array(values, dtype=dtype)
        return write_arrays(path, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Log:
        """Read a log back; nothing in the file is trusted.

        Raises:
            WbcError: one line: what the file is or lacks, or which array is wrong.
        """
        what = "a log of wbc"
        later = (*FORCES, *DYNAMICS)
        always = [name for name in LAYOUT if name not in later]
        found = read_arrays(
            path, ("format", "meta", "complete", *always), what=what, optional=later
        )
        try:
            return cls(**_checked(found))
        except (WbcError, ValueError) as error:
            raise WbcError(f"'{os.fspath(path)}' is not {what}: {error}") from error


def _checked(found: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Constructor arguments of a log out of the arrays of a file."""
    version = found["format"]
    known = (_WITHOUT_FORCES, _WITHOUT_DYNAMICS, FORMAT)
    if version.shape != () or version.dtype.kind != "i" or int(version) not in known:
        raise WbcError(f"its format is not {FORMAT}")
    for name, letter in (("meta", "U"), ("complete", "b")):
        if found[name].shape != () or found[name].dtype.kind != letter:
            raise WbcError(f"its '{name}' is not a single value of the right type")
    meta = RunMeta.from_json(str(found["meta"]))
    sizes: dict[str, int] = {}
    values: dict[str, Any] = {"meta": meta, "complete": bool(found["complete"])}
    for name, (kind, axes) in LAYOUT.items():
        old = _WITHOUT_FORCES if name in FORCES else _WITHOUT_DYNAMICS
        if (name in FORCES or name in DYNAMICS) and int(version) <= old:
            shape = [0 if a in "FGD" else int(a) if a.isdigit() else sizes[a] for a in axes]
            values[name] = np.zeros(shape, dtype=kind)
        elif name not in found:
            raise WbcError(f"it has no array '{name}'")
        else:
            values[name] = _fitted(name, found[name], kind, axes, sizes)
    _check_ranges(values, sizes)
    return values


def _check_ranges(values: dict[str, Any], sizes: dict[str, int]) -> None:
    """Names, times and indices mean what `meta` says."""
    meta: RunMeta = values["meta"]
    for name, expected in (
        ("joint_names", meta.joint_names),
        ("contact_names", meta.contact_names),
        ("task_names", meta.log_task_names),
        ("tip_task_names", meta.tip_task_names),
        ("phase_names", meta.phase_names),
    ):
        if values[name] != expected:
            raise WbcError(f"its '{name}' are not those of its meta")
    t, phase, task = values["t"], values["phase"], values["event_task"]
    if not np.isfinite(t).all() or (np.diff(t) <= 0.0).any():
        raise WbcError("its 't' does not increase")
    _in_range("phase", phase, 0, sizes.get("P", 0))
    _in_range("event_task", task, 0, sizes.get("m", 0) + sizes.get("K", 0))
    _in_range("limit_joint", values["limit_joint"], -1, sizes.get("n", 0))
    _in_range("contact_mode", values["contact_mode"], 0, 3)
    _in_range("force_status", values["force_status"], 0, len(ForceStatus))
    planned, ticks = len(values["phi"]), len(values["t"])
    if planned not in ((0, ticks) if meta.contact_models else (0,)):
        raise WbcError(f"it has {planned} ticks of forces, and {ticks} ticks")
    driven, both = len(values["tau"]), len(values["contact_force_plan"])
    if driven not in (0, ticks) or both != max(planned, driven):
        raise WbcError(f"it has {driven} ticks of torques, {both} of forces, and {ticks} ticks")


def _fitted(
    name: str, array: NDArray[Any], kind: type, axes: str, sizes: dict[str, int]
) -> NDArray[Any] | tuple[str, ...]:
    """`array` in the machine's byte order, its axes agreeing with those of the arrays before it."""
    if array.ndim != len(axes):
        raise WbcError(f"its '{name}' has {array.ndim} axes, expected {len(axes)}")
    for axis, size in zip(axes, array.shape, strict=True):
        expected = int(axis) if axis.isdigit() else sizes.setdefault(axis, size)
        if size != expected:
            raise WbcError(f"its '{name}' has shape {array.shape}, expected {expected} for {axis}")
    if kind is np.str_:
        if array.dtype.kind != "U":
            raise WbcError(f"its '{name}' are not text")
        return tuple(str(x) for x in array.tolist())
    if array.dtype.newbyteorder("=") != np.dtype(kind):
        raise WbcError(f"its '{name}' is of type {array.dtype}, expected {np.dtype(kind)}")
    array = array.astype(kind)
    array.setflags(write=False)
    return array


def _in_range(name: str, values: IntArray, first: int, end: int) -> None:
    if ((values < first) | (values >= end)).any():
        raise WbcError(f"its '{name}' goes outside {first} to {end - 1}")
