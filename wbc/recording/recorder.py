"""Collecting the ticks of a run while it goes on."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any, final

import numpy as np

from wbc.arrays import Array
from wbc.control.state import DynamicsRecord, ForceRecord, TickRecord
from wbc.recording.log import FORCES, LAYOUT, Log
from wbc.recording.meta import RunMeta
from wbc.rotations import quaternion

# The first columns of a row, in the order in which `append` gives them.
_SINGLE = (
    "t", "cost", "min_distance", "phase", "status", "independence", "eps_f", "eps_m",
    "limit_secondary", "limit_main", "limit_change", "limit_clipped", "limit_joint",
    "event_task", "event_inserted", "event_cost",
)  # fmt: skip
_NO_EVENT = (-1, False, 0.0)
_VECTORS = (
    "q", "v", "object_position", "object_rotation", "reference_position", "reference_rotation",
    "object_error", "mode", "contact_points", "contact_normals", "task_error", "within",
    "activation", "freedom",
)  # fmt: skip
# Arrays of planned forces in the log, in the order of `ForceRecord`, which is that of a row's end.
_FORCES = dict(zip(
    ForceRecord._fields,
    (
        "contact_force_plan", "contact_spin_plan", "tau_plan", "cone_margin", "torque_margin",
        "wrench_plan", "object_mass", "object_com", "force_status", "force_iterations", "phi",
        "sum_normal",
    ),
    strict=True,
))  # fmt: skip


@final
class Recorder:
    """Takes a run's records, one row of doubles per tick, and makes a `Log` of them.

    An append copies everything, so a record's arrays may be reused by whoever made it. A row counts
    only once it is whole: an interrupt at any instant leaves the ticks before it readable.
    """

    def __init__(self, meta: RunMeta, capacity_hint: int = 4096) -> None:
        """
        Args:
            meta: what is run; its names give the sizes.
            capacity_hint: expected number of ticks; more may come.
        """
        self.meta = meta
        self._capacity = max(int(capacity_hint), 16)
        self._block = np.empty((0, 0))
        self._count = 0
        self._freedom = 0
        self._forces = self._dynamics = False

    def __len__(self) -> int:
        return self._count

    def append(self, record: TickRecord) -> None:
        """Store one tick.

        Raises:
            ValueError: the record's arrays are not of the sizes that `meta` names.
        """
        if self._count == len(self._block):
            self._grow(record)
        limited, event, forces = record.limited, record.event, record.forces
        dynamics = record.dynamics
        if (forces is not None) != self._forces:
            raise ValueError("record.forces must be planned in every tick of a run, or in none")
        if (dynamics is not None) != self._dynamics:
            raise ValueError("record.dynamics must be there in every tick of a run, or in none")
        single = (
            record.t, record.cost, record.min_distance, record.phase, int(record.status),
            record.independence, record.residuals[0], record.residuals[1], limited.secondary,
            limited.main, limited.change, limited.clipped, limited.joint,
            *(_NO_EVENT if event is None else (event.task, event.inserted, event.cost)),
        )  # fmt: skip
        np.concatenate(
            (
                single, record.q, record.v, record.object_position, record.object_rotation.ravel(),
                record.reference_position, record.reference_rotation.ravel(),
                record.object_error.ravel(), record.mode, record.contact_points.ravel(),
                record.contact_normals.ravel(), record.task_error, record.within,
                record.activation, record.freedom,
                *(() if dynamics is None else [np.ravel(part) for part in dynamics]),
                *(() if forces is None else [np.ravel(part) for part in forces]),
            ),
            out=self._block[self._count],
        )  # fmt: skip
        self._count += 1

    def finish(self, *, complete: bool = True) -> Log:
        """The log of the ticks so far; the recorder may go on.

        Args:
            complete: False for a run that was cut short.
        """
        sizes = self._sizes()
        rows = self._block[: self._count] if self._count else np.empty((0, self._width()))
        single = {name: rows[:, k] for k, name in enumerate(_SINGLE)}
        vector, start = {}, len(_SINGLE)
        for name, shape in sizes.items():
            width = int(np.prod(shape))
            vector[name] = rows[:, start : start + width].reshape(len(rows), *shape)
            start += width
        planned = self._planned(rows)
        values: dict[str, Any] = {
            **single,
            **{name: vector[name] for name in ("q", "v", "object_error", "freedom")},
            "contact_points": vector["contact_points"],
            "contact_normals": vector["contact_normals"],
            "contact_mode": vector["mode"],
            "in_contact": vector["mode"] != 0,
            "object_pose": _poses(vector["object_position"], vector["object_rotation"]),
            "object_pose_ref": _poses(vector["reference_position"], vector["reference_rotation"]),
            **self._tasks(vector),
            **self._events(single),
            **planned,
            **self._measured(rows[:, start:], planned["contact_force_plan"]),
        }
        return self._log(values, complete)

    def save_partial(self, path: str | os.PathLike[str]) -> Path:
        """Save what there is, marked as not complete; an older file stays until this one is whole.

        Raises:
            WbcError: the file cannot be written.
        """
        return self.finish(complete=False).save(path)

    def _sizes(self) -> dict[str, tuple[int, ...]]:
        """Shape of each array of a record, in the order of a row."""
        meta = self.meta
        n, fingers = len(meta.joint_names), len(meta.contact_names)
        tasks = len(meta.task_names) + len(meta.tip_task_names)
        shapes = (
            (n,), (n,), (3,), (3, 3), (3,), (3, 3), (fingers, 2), (fingers,), (fingers, 3),
            (fingers, 3), (tasks,), (tasks,), (tasks,), (self._freedom,),
        )  # fmt: skip
        return dict(zip(_VECTORS, shapes, strict=True))

    def _width(self) -> int:
        """Doubles in a row."""
        width = len(_SINGLE) + sum(int(np.prod(shape)) for shape in self._sizes().values())
        forces = self._force_sizes().values() if self._forces else ()
        dynamics = self._dynamics_sizes().values() if self._dynamics else ()
        return width + sum(int(np.prod(shape)) for shape in (*dynamics, *forces))

    def _force_sizes(self) -> dict[str, tuple[int, ...]]:
        """Shape of each field of a `ForceRecord`."""
        sizes = {"n": len(self.meta.joint_names), "N": len(self.meta.contact_names)}
        return {
            field: tuple(sizes[a] if a in sizes else int(a) for a in FORCES[name][1][1:])
            for field, name in _FORCES.items()
        }

    def _dynamics_sizes(self) -> dict[str, tuple[int, ...]]:
        """Shape of each field of a `DynamicsRecord`."""
        n, fingers = (len(self.meta.joint_names),), (len(self.meta.contact_names),)
        shapes = (n, (*fingers, 3), (*fingers, 3), (3,), (3, 3), fingers, n, n, ())
        return dict(zip(DynamicsRecord._fields, shapes, strict=True))

    def _measured(self, rest: Array, plan: Array) -> dict[str, Array]:
        """Arrays of what torques did, without a row on the ideal robot.

        Args:
            rest: what of the rows is after the arrays of every run.
            plan: forces planned by an optimizer, if any were.
        """
        if not self._dynamics:
            rest = np.empty((0, sum(int(np.prod(s)) for s in self._dynamics_sizes().values())))
        part, start = {}, 0
        for name, shape in self._dynamics_sizes().items():
            width = int(np.prod(shape))
            part[name] = rest[:, start : start + width].reshape(len(rest), *shape)
            start += width
        return {
            "tau": part["tau"],
            "contact_force_meas": part["force"],
            "contact_force_plan": part["plan"] if self._dynamics else plan,
            "object_pose_true": _poses(part["object_position"], part["object_rotation"]),
            "slip": part["slip"],
            "q_meas": part["q"],
            "v_meas": part["v"],
            "torque_status": part["status"],
        }

    def _planned(self, rows: Array) -> dict[str, Array]:
        """Arrays of the planned forces; without a row where none are planned."""
        sizes = self._force_sizes()
        widths = [int(np.prod(shape)) for shape in sizes.values()]
        ends = rows[:, -sum(widths) :] if self._forces else np.empty((0, sum(widths)))
        parts = np.split(ends, np.cumsum(widths)[:-1], axis=1)
        return {
            _FORCES[field]: part.reshape(len(ends), *shape)
            for (field, shape), part in zip(sizes.items(), parts, strict=True)
        }

    def _grow(self, record: TickRecord) -> None:
        if self._count == 0:  # the names tell neither the number of levels nor of forces
            self._freedom = len(record.freedom)
            self._forces = record.forces is not None
            self._dynamics = record.dynamics is not None
            if self._forces and not self.meta.contact_models:
                raise ValueError("record.forces is planned, and meta names no contact models")
            _check(record, self._sizes())
            if record.forces is not None:
                _check(record.forces, self._force_sizes())
            if record.dynamics is not None:
                _check(record.dynamics, self._dynamics_sizes())
        block = np.empty((max(self._capacity, 2 * self._count), self._width()))
        block[: self._count] = self._block[: self._count] if self._count else 0.0
        self._block = block

    def _tasks(self, vector: dict[str, Array]) -> dict[str, Array]:
        """Columns of tasks, the main one in front, and of tips."""
        cut = len(self.meta.task_names)
        error, within, activation = (vector[k] for k in ("task_error", "within", "activation"))
        values = {
            "tip_task_error": error[:, cut:],
            "tip_in_stack": within[:, cut:],
            "tip_activation": activation[:, cut:],
        }
        error, within, activation = error[:, :cut], within[:, :cut], activation[:, :cut]
        if self.meta.main_task is not None:
            one = np.ones((len(error), 1))
            with warnings.catch_warnings():  # no finger in contact: the error is NaN, as it should
                warnings.simplefilter("ignore", RuntimeWarning)
                worst = np.nanmax(vector["object_error"][:, :, 0], axis=1, initial=-np.inf)
            worst = np.where(np.isneginf(worst), np.nan, worst)
            error = np.hstack((worst[:, None], error))
            within, activation = np.hstack((one, within)), np.hstack((one, activation))
        return {**values, "task_error": error, "in_stack": within, "activation": activation}

    def _events(self, single: dict[str, Array]) -> dict[str, Array]:
        happened = single["event_task"] >= 0.0
        return {
            "event_t": single["t"][happened],
            # the main task stands before the tasks that the record counts
            "event_task": single["event_task"][happened] + (self.meta.main_task is not None),
            "event_inserted": single["event_inserted"][happened],
            "event_cost": single["event_cost"][happened],
        }

    def _log(self, values: dict[str, Any], complete: bool) -> Log:
        meta = self.meta
        names: dict[str, Any] = {
            "joint_names": meta.joint_names,
            "contact_names": meta.contact_names,
            "task_names": meta.log_task_names,
            "tip_task_names": meta.tip_task_names,
            "phase_names": meta.phase_names,
        }
        arrays: dict[str, Any] = {}
        for name, (kind, _) in LAYOUT.items():
            if kind is not np.str_:
                arrays[name] = np.array(values[name], dtype=kind, order="C")
                arrays[name].setflags(write=False)
        return Log(meta=meta, complete=complete, **names, **arrays)


_CALLED = {ForceRecord: "record.forces", DynamicsRecord: "record.dynamics"}


def _check(
    record: TickRecord | ForceRecord | DynamicsRecord, sizes: dict[str, tuple[int, ...]]
) -> None:
    """Raise `ValueError` where an array of `record` has another shape."""
    of = _CALLED.get(type(record), "record")
    for name, shape in sizes.items():
        got = np.shape(getattr(record, name))
        if got != shape:
            raise ValueError(f"{of}.{name} has shape {got}, expected {shape}")


def _poses(position: Array, rotation: Array) -> Array:
    """(T, 7) x y z qx qy qz qw; of a quaternion's two signs the one nearer to the row before."""
    poses = np.empty((len(position), 7))
    poses[:, :3] = position
    for k, r in enumerate(rotation):
        still = k > 0 and np.array_equal(r, rotation[k - 1])
        poses[k, 3:] = poses[k - 1, 3:] if still else quaternion(np.ascontiguousarray(r))
    agree = np.sum(poses[1:, 3:] * poses[:-1, 3:], axis=1)
    poses[1:, 3:] *= np.cumprod(np.where(agree < 0.0, -1.0, 1.0))[:, None]
    return poses
