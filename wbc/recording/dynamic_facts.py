"""What a run under torques comes to: where the object went, who let go, how large torques were."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray
from wbc.control.force_control import TorqueStatus
from wbc.control.state import PRESSING, Status
from wbc.recording.log import Log
from wbc.rotations import log_so3

DROP: Final = (0.05, 0.6)
"""An object further from its reference than this, [m] and [rad], has been dropped."""

_CAUSES: Final = (
    TorqueStatus.BLIND
    | TorqueStatus.FROZEN
    | TorqueStatus.LATE
    | TorqueStatus.STALE
    | TorqueStatus.TRACKING
    | TorqueStatus.CONTACT_LOST
)

_REST = (5.0, 10.0)
"""Shortest rest in which creep is measured, and how much of its end is looked at, [s]."""


def object_error_true(log: Log) -> tuple[Array, Array]:
    """(T,) distance [m] and angle [rad] of the true object from where it should be.

    Where it should be is its reference, displaced by D(0) = T_ref(0)⁻¹ T_true(0): nobody sees the
    object, and what its place was believed wrongly by at the start is carried along, in its axes.
    """
    return displaced_error(log.object_pose_ref, log.object_pose_true)


def displaced_error(reference: Array, true: Array) -> tuple[Array, Array]:
    """`object_error_true` of (T, 7) poses x y z qx qy qz qw, the first of them at the start."""
    wanted = _displaced(reference, true)
    way = np.linalg.norm(true[:, :3] - wanted[:, :3], axis=1)
    cosine = np.abs(np.sum(true[:, 3:] * wanted[:, 3:], axis=1))
    chord = np.minimum(
        np.linalg.norm(true[:, 3:] - wanted[:, 3:], axis=1),
        np.linalg.norm(true[:, 3:] + wanted[:, 3:], axis=1),
    )  # the arc cosine has no digits left near 1
    small: Array = 4.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))
    return way, np.where(cosine > 0.5, small, 2.0 * np.arccos(np.clip(cosine, 0.0, 1.0)))


def _displaced(reference: Array, true: Array) -> Array:
    """(T, 7) the reference, displaced in its own axes by what the true pose is off at the start."""
    if not len(reference) or np.array_equal(reference[0], true[0]):
        return reference
    where, turn = reference[:, :3], reference[:, 3:]
    back = turn[0] * (-1.0, -1.0, -1.0, 1.0)
    shift = _turned(back, true[0, :3] - where[0])
    return np.hstack((where + _turned(turn, shift), _product(turn, _product(back, true[0, 3:]))))


def _product(a: Array, b: Array) -> Array:
    """(..., 4) product of two rotations, x y z w."""
    u, v, r, s = a[..., :3], b[..., :3], a[..., 3:], b[..., 3:]
    along = np.sum(u * v, axis=-1, keepdims=True)
    return np.concatenate((r * v + s * u + np.cross(u, v), r * s - along), axis=-1)


def _turned(a: Array, x: Array) -> Array:
    """(..., 3) vectors x turned by the rotations a (..., 4)."""
    across = 2.0 * np.cross(a[..., :3], x)
    out: Array = x + a[..., 3:] * across + np.cross(a[..., :3], across)
    return out


def normal_forces(log: Log) -> tuple[Array, Array]:
    """(T, N) planned and measured normal forces, positive where a finger presses, [N]."""
    inward = -log.contact_normals
    planned: Array = np.einsum("tir,tir->ti", inward, log.contact_force_plan)
    measured: Array = np.einsum("tir,tir->ti", inward, log.contact_force_meas)
    return planned, measured


def dropped(log: Log) -> float | None:
    """When the object was dropped, [s]; None if it never was, or if nothing saw where it is."""
    if not np.isfinite(log.object_pose_true).any():
        return None
    way, angle = object_error_true(log)
    lost = np.flatnonzero(~((way <= DROP[0]) & (angle <= DROP[1])))  # what is no number, too
    return float(log.t[lost[0]]) if len(lost) else None


def fingers_off(log: Log) -> BoolArray:
    """(T, N) fingers that are to press and do not."""
    planned, measured = normal_forces(log)
    off: BoolArray = (planned >= PRESSING) & ~(measured > 0.0)
    return off


def hand_over(log: Log) -> int | None:
    """The first tick in which fingers that held are free and others hold; None without one.

    Until then both hands hold the object, and from then on what the second one has made of it.
    """
    held = log.in_contact
    leaves = (held[:-1] & ~held[1:]).any(axis=1) & held[1:].any(axis=1)
    return int(np.argmax(leaves)) + 1 if leaves.any() else None


def creep(log: Log) -> tuple[float, float] | None:
    """How fast the true object creeps where it should rest, [m/s], [rad/s]; None without a rest.

    It is the slope of the straight lines that fit its position and its rotation vector best, over
    the end of the run's last rest of the reference, 10 s at most: noise of 0.2 mrad in the joints
    looks like 0.3 mm/s in one second and like 0.01 mm/s in ten. A rest of less than 5 s tells
    nothing, and where contacts change it is over.
    """
    still = np.all(np.diff(log.object_pose_ref, axis=0) == 0.0, axis=1)
    still &= np.all(np.diff(log.contact_mode, axis=0) == 0, axis=1)
    moves = np.flatnonzero(~still)
    ends = np.append(moves, len(still)) if len(still) else np.zeros(0, dtype=np.int64)
    begins = np.concatenate(([0], moves + 1))[: len(ends)]
    long = np.flatnonzero(ends - begins >= _REST[0] / log.meta.dt - 1e-9)
    if not len(long):
        return None
    end = int(ends[long[-1]])
    begin = max(int(begins[long[-1]]), end - round(_REST[1] / log.meta.dt))
    rest = log.object_pose_true[begin : end + 1]
    if not np.isfinite(rest).all():
        return None
    turns = [pin.Quaternion(pose[3:]).normalized().toRotationMatrix() for pose in rest]
    vectors = np.array([log_so3(turn @ turns[0].T) for turn in turns])
    slope = np.polyfit(log.t[begin : end + 1], np.hstack((rest[:, :3], vectors)), 1)[0]
    return float(np.linalg.norm(slope[:3])), float(np.linalg.norm(slope[3:]))


def dynamic_facts(log: Log, settled: float) -> dict[str, Any]:
    """The summary's entries of a run under torques.

    Args:
        settled: time after which errors are judged, [s].
    """
    way, angle = object_error_true(log)
    late, handed, crept = log.t > settled, hand_over(log), creep(log)
    planned, measured = normal_forces(log)
    error = np.abs(np.where(log.in_contact, measured - planned, 0.0))[late]
    limits = np.maximum(np.abs(np.array(log.meta.tau_min)), np.abs(np.array(log.meta.tau_max)))
    ratio = np.abs(log.tau) / limits if len(limits) else np.full(log.tau.shape, np.nan)
    return {
        "dropped": dropped(log) is not None,
        "object_error_max_m": way[late].max(initial=0.0),
        "object_error_max_rad": angle[late].max(initial=0.0),
        "object_error_handover_m": math.nan if handed is None else way[handed],
        "object_error_handover_rad": math.nan if handed is None else angle[handed],
        "creep_m_per_s": math.nan if crept is None else crept[0],
        "creep_rad_per_s": math.nan if crept is None else crept[1],
        "contact_lost_s": log.meta.dt * int(off_for(fingers_off(log)).max(initial=0)),
        "force_error_max_n": dict(
            zip(log.contact_names, error.max(axis=0, initial=0.0), strict=True)
        ),
        "slip_max_m": log.slip.max(initial=0.0),
        "tau_max_ratio": ratio.max(initial=0.0),
        "torque_status": {
            flag.name: int(np.count_nonzero(log.torque_status & flag))
            for flag in TorqueStatus
            if flag.value
        },
    }


def off_for(off: BoolArray) -> IntArray:
    """(T,) ticks in a row for which some finger, always the same one, has been off. off: (T, N)."""
    found = np.zeros(len(off), dtype=np.int64)
    run = np.zeros(off.shape[1], dtype=np.int64)
    for k, row in enumerate(off):
        run = np.where(row, run + 1, 0)
        found[k] = run.max(initial=0)
    return found


def held_to_the_end(log: Log) -> tuple[int, str] | None:
    """The tick from which on a run stood still to its end, and what it waited for; else None."""
    if log.dynamic and (first := _since((log.torque_status & TorqueStatus.HELD) != 0)) is not None:
        bits = TorqueStatus(int(log.torque_status[-1])) & _CAUSES
        why = [str(flag.name).lower().replace("_", " ") for flag in TorqueStatus if flag & bits]
        return first, ", ".join(why) or "held"
    first = _since((log.status & Status.UNSUPPORTED) != 0)
    return None if first is None else (first, "unsupported")


def _since(so: BoolArray) -> int | None:
    """The tick from which on something is so to the end, (T,); None if it is not so there."""
    if not so[-1:].any():
        return None
    return len(so) - int(np.argmin(so[::-1])) if not so.all() else 0
