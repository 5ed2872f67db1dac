"""What a run under torques comes to: where the object went, who let go, how large torques were."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.control.force_control import TorqueStatus
from wbc.recording.log import Log

DROP: Final = (0.05, 0.6)
"""An object further from its reference than this, [m] and [rad], has been dropped."""

_PRESSING = 0.1
"""Planned normal force from which on a finger is to touch, [N]: below, a touch only begins."""


def object_error_true(log: Log) -> tuple[Array, Array]:
    """(T,) distance [m] and angle [rad] of the true object from its reference."""
    true, wanted = log.object_pose_true, log.object_pose_ref
    way = np.linalg.norm(true[:, :3] - wanted[:, :3], axis=1)
    cosine = np.abs(np.sum(true[:, 3:] * wanted[:, 3:], axis=1))
    chord = np.minimum(
        np.linalg.norm(true[:, 3:] - wanted[:, 3:], axis=1),
        np.linalg.norm(true[:, 3:] + wanted[:, 3:], axis=1),
    )  # the arc cosine has no digits left near 1
    small: Array = 4.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))
    return way, np.where(cosine > 0.5, small, 2.0 * np.arccos(np.clip(cosine, 0.0, 1.0)))


def normal_forces(log: Log) -> tuple[Array, Array]:
    """(T, N) planned and measured normal forces, positive where a finger presses, [N]."""
    inward = -log.contact_normals
    planned: Array = np.einsum("tir,tir->ti", inward, log.contact_force_plan)
    measured: Array = np.einsum("tir,tir->ti", inward, log.contact_force_meas)
    return planned, measured


def dropped(log: Log) -> float | None:
    """When the object was dropped, [s]; None if it never was."""
    way, angle = object_error_true(log)
    lost = np.flatnonzero(~((way <= DROP[0]) & (angle <= DROP[1])))  # what is no number, too
    return float(log.t[lost[0]]) if len(lost) else None


def dynamic_facts(log: Log, settled: float) -> dict[str, Any]:
    """The summary's entries of a run under torques.

    Args:
        settled: time after which errors are judged, [s].
    """
    way, angle = object_error_true(log)
    late = log.t > settled
    planned, measured = normal_forces(log)
    off = (planned >= _PRESSING) & ~(measured > 0.0)
    error = np.abs(np.where(log.in_contact, measured - planned, 0.0))[late]
    limits = np.maximum(np.abs(np.array(log.meta.tau_min)), np.abs(np.array(log.meta.tau_max)))
    ratio = np.abs(log.tau) / limits if len(limits) else np.full(log.tau.shape, np.nan)
    return {
        "dropped": dropped(log) is not None,
        "object_error_max_m": way[late].max(initial=0.0),
        "object_error_max_rad": angle[late].max(initial=0.0),
        "contact_lost_s": log.meta.dt * _longest(off),
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


def _longest(off: BoolArray) -> int:
    """The most ticks in a row for which some finger, always the same one, is off. off: (T, N)."""
    most, run = 0, np.zeros(off.shape[1], dtype=np.int64)
    for row in off:
        run = np.where(row, run + 1, 0)
        most = max(most, int(run.max(initial=0)))
    return most
