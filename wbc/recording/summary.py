"""A run in numbers: what `summary.json` holds."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.control.state import Status
from wbc.files import write_whole
from wbc.forces import ForceStatus
from wbc.recording.dynamic_facts import dynamic_facts
from wbc.recording.failure import first_failure
from wbc.recording.log import Log
from wbc.recording.outcome import Outcome, reason, unplanned, violations

CONVERGED = 1e-6
"""ε_f and ε_m below this count as a force closure reached."""
SETTLED = 0.3
"""Time after which the object's error is judged, [s]: the start's error has faded by then."""

_AFTER = 3  # steps looked at from a switch on: into its tick and the two that follow


def summarize(log: Log, outcome: Outcome | None = None) -> dict[str, Any]:
    """The facts of `log` reduced to numbers, names and null, ready for strict JSON.

    Args:
        outcome: how the run ended; by default as far as the log tells.
    """
    outcome = Outcome.from_log(log) if outcome is None else outcome
    meta, why = log.meta, reason(log, outcome)
    failed = first_failure(log, outcome) if why else None
    facts = {
        "scenario": meta.scenario,
        "scenario_sha256": meta.scenario_hash,
        "source": meta.source,
        "seed": meta.seed,
        "versions": dict(sorted(meta.versions.items())),
        "success": not why,
        "reason": why,
        "failure": failed and failed.what,
        "failure_t": failed and failed.t,
        "failure_phase": failed and failed.phase,
        "complete": log.complete,
        "interrupted": outcome.interrupted,
        "dt": meta.dt,
        "ticks": log.ticks,
        "duration": log.t[-1] + meta.dt - log.t[0] if log.ticks else 0.0,
        "phases": _phases(log, outcome),
        "timeouts": list(outcome.timeouts),
        "violations": violations(log),
        "force_closure": _force_closure(log),
        "object_error": _object_error(log),
        "motion": _motion(log),
        "velocity_steps": _velocity_steps(log),
        "distance": _extreme(log, -log.min_distance, "min", -1.0),
        "cost": _extreme(log, log.cost, "max"),
        "stack": _stack(log),
        "status": {
            flag.name: int(np.count_nonzero(log.status & flag)) for flag in Status if flag.value
        },
        "limits": _limits(log),
        "independence": _extreme(log, -log.independence, "min", -1.0),
        "final_task_error": dict(zip(log.task_names, log.task_error[-1], strict=True))
        if log.ticks
        else {},
        **(_forces(log) if log.plans_forces else {}),
        **(dynamic_facts(log, SETTLED) if log.dynamic else {}),
    }
    plain: dict[str, Any] = _plain(facts)
    return plain


def write(summary: dict[str, Any], path: str | os.PathLike[str]) -> Path:
    """Write a summary as strict JSON, whole or not at all.

    Raises:
        WbcError: the file cannot be written.
    """
    text = json.dumps(_plain(summary), indent=2, allow_nan=False) + "\n"
    return write_whole(path, lambda file: file.write(text.encode("ascii")))


def _plain(value: Any) -> Any:
    """`value` in Python's own types; what is not a number is None."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def phase_starts(log: Log) -> IntArray:
    """Ticks at which a phase begins, the first one included."""
    if not log.ticks:
        return np.zeros(0, dtype=np.int64)
    return np.concatenate(([0], np.flatnonzero(np.diff(log.phase)) + 1)).astype(np.int64)


def velocity_steps(log: Log) -> Array:
    """(T,) largest change of a joint's velocity into each tick from the one before; first: 0."""
    steps = np.zeros(log.ticks)
    if log.ticks > 1 and log.v.shape[1]:
        steps[1:] = np.abs(np.diff(log.v, axis=0)).max(axis=1)
    return steps


def _extreme(log: Log, values: Array, name: str, sign: float = 1.0) -> dict[str, Any]:
    """The largest of `values` (T,), back in the units and sign of the log, and when."""
    known = np.flatnonzero(~np.isnan(values))
    if not len(known):
        return {name: None, "t": None}
    k = known[np.argmax(values[known])]
    return {name: sign * values[k], "t": log.t[k] if np.isfinite(values[k]) else None}


def _phases(log: Log, outcome: Outcome) -> list[dict[str, Any]]:
    starts = phase_starts(log)
    ends = [*starts[1:], log.ticks] if log.ticks else []
    entries = []
    for k, (start, end) in enumerate(zip(starts, ends, strict=True)):
        name = log.phase_names[log.phase[start]]
        last = k == len(starts) - 1
        entries.append(
            {
                "name": name,
                "entered": log.t[start],
                "left": None if last else log.t[end],
                "completed": name not in outcome.timeouts and (outcome.done or not last),
            }
        )
    return entries


def _force_closure(log: Log) -> dict[str, Any]:
    above = np.flatnonzero(~((log.eps_f < CONVERGED) & (log.eps_m < CONVERGED)))
    first = int(above[-1]) + 1 if len(above) else 0
    return {
        "eps_f": log.eps_f[-1] if log.ticks else None,
        "eps_m": log.eps_m[-1] if log.ticks else None,
        "threshold": CONVERGED,
        "below_since": log.t[first] if first < log.ticks else None,
    }


def _object_error(log: Log) -> dict[str, Any]:
    """Per finger, position [m] and orientation [rad]: the worst overall and once settled."""
    settled = log.t > SETTLED

    def worst(errors: Array) -> float | None:
        known = errors[~np.isnan(errors)]
        return float(known.max()) if known.size else None

    def both(rows: Array) -> dict[str, Any]:
        return {"position": worst(rows[..., 0]), "orientation": worst(rows[..., 1])}

    return {
        "settled_after": SETTLED,
        "settled": both(log.object_error[settled]),
        "overall": both(log.object_error),
        "fingers": {
            name: {
                "settled": both(log.object_error[settled, i]),
                "overall": both(log.object_error[:, i]),
            }
            for i, name in enumerate(log.contact_names)
        },
    }


def _motion(log: Log) -> dict[str, Any]:
    """Largest position and velocity of a joint: value, whose, when."""

    def largest(values: Array) -> tuple[float | None, str | None, float | None]:
        if not np.isfinite(values).any():
            return None, None, None
        size = np.where(np.isfinite(values), np.abs(values), -1.0)
        k, j = np.unravel_index(int(np.argmax(size)), size.shape)
        return float(size[k, j]), log.joint_names[j], float(log.t[k])

    q, q_joint, q_time = largest(log.q)
    v, v_joint, v_time = largest(log.v)
    return {
        "max_q": q,
        "max_q_deg": None if q is None else math.degrees(q),
        "max_q_joint": q_joint,
        "max_q_t": q_time,
        "max_v": v,
        "max_v_joint": v_joint,
        "max_v_t": v_time,
    }


def _velocity_steps(log: Log) -> dict[str, Any]:
    """Largest change of a joint's velocity in one tick: overall, at stack events, at phases."""
    steps = velocity_steps(log)
    overall = _extreme(log, steps, "max")
    joint = None
    if overall["t"] is not None and log.ticks > 1:
        k = int(np.nanargmax(steps))
        joint = log.joint_names[int(np.argmax(np.abs(log.v[k] - log.v[k - 1])))] if k else None
    events = [step_after(log, steps, t) for t in log.event_t]
    changes = [step_after(log, steps, log.t[k]) for k in phase_starts(log)[1:]]
    return {
        **overall,
        "joint": joint,
        "at_stack_events": max(events, default=None),
        "at_phase_changes": max(changes, default=None),
    }


def step_after(log: Log, steps: Array, t: float) -> float:
    """Largest of `steps` from a switch at time t on: into its tick and the two ticks after it."""
    k = int(np.searchsorted(log.t, t))
    return float(steps[k : k + _AFTER].max(initial=0.0))


def _stack(log: Log) -> dict[str, Any]:
    steps = velocity_steps(log)
    events = [
        {
            "t": t,
            "task": log.all_task_names[task],
            "event": "inserted" if inserted else "removed",
            "predicted_cost": cost,
            "velocity_step": step_after(log, steps, t),
        }
        for t, task, inserted, cost in zip(
            log.event_t, log.event_task, log.event_inserted, log.event_cost, strict=True
        )
    ]
    return {"events": len(events), "removals": int((~log.event_inserted).sum()), "list": events}


def _limits(log: Log) -> dict[str, Any]:
    """How much the limit filter did: ticks and the smallest share left by each of its stages."""
    acted = log.limit_joint >= 0
    counts = np.bincount(log.limit_joint[acted], minlength=len(log.joint_names))
    stages = {"secondary": log.limit_secondary, "main": log.limit_main, "change": log.limit_change}
    return {
        **{
            name: {
                "ticks": int((share < 1.0).sum()),
                "smallest_share": float(share.min(initial=1.0)),
            }
            for name, share in stages.items()
        },
        "clipped": int(log.limit_clipped.sum()),
        "most_limited_joint": log.joint_names[int(np.argmax(counts))] if acted.any() else None,
    }


def _forces(log: Log) -> dict[str, Any]:
    """Margins, effort and verdicts of the planned contact forces.

    The sums of the normal forces are of ticks in which a finger touches.
    """
    occurred = {}
    for index, status in enumerate(ForceStatus):
        ticks = np.flatnonzero(log.force_status == index)
        if len(ticks):
            occurred[status.value] = {"first_t": log.t[ticks[0]], "ticks": len(ticks)}
    press = np.where(log.in_contact.any(axis=1), log.sum_normal, np.nan)
    return {
        "force_min_cone_margin_n": _extreme(log, -_least(log.cone_margin), "min", -1.0)["min"],
        "force_min_torque_margin_nm": np.min(log.torque_margin, initial=np.inf),
        "force_iterations_mean": log.force_iterations.mean(),
        "force_infeasible_ticks": len(unplanned(log)),
        "force_sum_normal_min_n": _extreme(log, -press, "min", -1.0)["min"],
        "force_sum_normal_max_n": _extreme(log, press, "max")["max"],
        "force_statuses": occurred,
    }


def _least(margins: Array) -> Array:
    """(T,) smallest entry of each row, those that are NaN left out; NaN where all are."""
    least = np.min(margins, axis=1, initial=np.inf, where=~np.isnan(margins))
    return np.where(np.isinf(least), np.nan, least)
