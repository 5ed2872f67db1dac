"""How a run ended, and the one sentence that says why it did not succeed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.control.phases import ExitCondition, Phase, PhaseSequence
from wbc.control.state import PhaseState, Status
from wbc.forces import ForceStatus
from wbc.recording.dynamic_facts import dropped, held_to_the_end
from wbc.recording.log import Log

_TOLERANCE = 1e-9  # a limit kept to rounding is kept
_WHY = {
    ForceStatus.INFEASIBLE_TORQUE_LIMITS: "joints too weak",
    ForceStatus.INFEASIBLE_FRICTION: "beyond friction",
    ForceStatus.RANK_DEFICIENT: "too few contacts",
    ForceStatus.NOT_BALANCED: "solver stopped early",
    ForceStatus.INVALID_INPUT: "numbers not finite",
}


@dataclass(frozen=True)
class Outcome:
    """What the log alone does not tell.

    Attributes:
        phases: what was asked of each phase; empty where it is not known (a log found on disk).
        done: the last phase met its exit condition.
        timeouts: names of the phases that timed out.
        interrupted: stopped from outside, e.g. by Ctrl-C.
    """

    phases: tuple[Phase, ...]
    done: bool
    timeouts: tuple[str, ...] = ()
    interrupted: bool = False

    @classmethod
    def of(cls, phases: PhaseSequence, state: PhaseState, *, interrupted: bool = False) -> Outcome:
        """The outcome of a run whose controller's last state held `state`."""
        return cls(phases.phases, state.done, state.timeouts, interrupted)

    @classmethod
    def from_log(cls, log: Log) -> Outcome:
        """As far as the log tells it: without the exit conditions."""
        done = bool(log.ticks and log.status[-1] & Status.DONE)
        late = np.flatnonzero(log.status & Status.PHASE_TIMEOUT)
        names: tuple[str, ...] = ()
        if len(late):
            names = (log.phase_names[log.phase[max(late[0] - 1, 0)]],)
        return cls((), done, names, not log.complete)


def _excesses(log: Log) -> Iterator[tuple[str, str, Array]]:
    """What is limited, its unit's end, and (T, n) how far each joint is beyond its limit."""
    meta = log.meta
    if log.ticks and meta.q_lower and meta.q_upper:
        lower, upper = np.array(meta.q_lower), np.array(meta.q_upper)
        yield "position", "", _known(np.maximum(log.q - upper, lower - log.q))
    if log.ticks and meta.v_limit:
        yield "velocity", "/s", _known(np.abs(log.v) - np.array(meta.v_limit))


def _known(excess: Array) -> Array:
    return np.where(np.isnan(excess), np.inf, excess)


def beyond_limits(log: Log) -> BoolArray:
    """(T,) whether a joint is beyond its position or velocity limit."""
    beyond = np.zeros(log.ticks, dtype=np.bool_)
    for _, _, excess in _excesses(log):
        beyond |= (excess > _TOLERANCE).any(axis=1)
    return beyond


def violations(log: Log) -> list[str]:
    """Hard limits that were not kept, one sentence each: joints, collision, commands."""
    dt = log.meta.dt
    found = [text for kind in _excesses(log) for text in _worst(log, *kind)]
    touching = np.flatnonzero(log.min_distance <= 0.0)
    if len(touching):
        k = int(touching[np.argmin(log.min_distance[touching])])
        found.append(f"parts collided at {log.t[k]:.4g} s ({log.min_distance[k]:.3g} m)")
    if log.dynamic and (fell := dropped(log)) is not None:
        found.append(f"the object was dropped at {fell:.4g} s")
    for flag, what in (
        (Status.BAD_MEASUREMENT, "the measurement was not usable"),
        (Status.BAD_COMMAND, "the control law gave no finite velocity"),
    ):
        ticks = np.flatnonzero(log.status & flag)
        if len(ticks):
            found.append(f"{what} from {log.t[ticks[0]]:.4g} s on, {len(ticks) * dt:.4g} s in all")
    return found


def _worst(log: Log, what: str, per: str, excess: Array) -> list[str]:
    """The largest excess (T, n) over a limit, unless it is rounding."""
    k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
    if excess[k, j] <= _TOLERANCE:
        return []
    return [
        f"joint '{log.joint_names[j]}' was {excess[k, j]:.3g} rad{per} (or m{per}) beyond its "
        f"{what} limit at {log.t[k]:.4g} s"
    ]


def unplanned(log: Log) -> IntArray:
    """The ticks whose contact forces could not be planned: those before were held."""
    unusable = [k for k, status in enumerate(ForceStatus) if not status.usable]
    return np.flatnonzero(np.isin(log.force_status, unusable))


def _without_forces(log: Log) -> list[str]:
    """How many ticks had no usable plan, from when on, and each verdict with its ticks."""
    ticks = unplanned(log)
    if not len(ticks):
        return []
    verdicts, counts = np.unique(log.force_status[ticks], return_counts=True)
    why = ", ".join(
        f"{_WHY.get(status := tuple(ForceStatus)[v], status.value)} in {count}"
        for v, count in zip(verdicts, counts, strict=True)
    )
    phase = log.phase_names[log.phase[ticks[0]]]
    return [
        f"no contact forces could be planned in {len(ticks)} of {log.ticks} ticks, from "
        f"{log.t[ticks[0]]:.4g} s in phase '{phase}' on ({why})"
    ]


def reason(log: Log, outcome: Outcome) -> str:
    """Why the run is no success, in one sentence; empty if it is one.

    A success has ended every phase in its time, kept the joints' position and velocity limits,
    never let two watched parts touch, never dropped the object under torques, never braked for want
    of a usable measurement or command, and found contact forces in every tick if they were to be
    planned. The costs' soft thresholds, joints clipped to their limits, and forces of a low margin
    do not decide it.
    """
    if not log.ticks:
        return "no tick was recorded"
    parts = []
    if outcome.timeouts:
        parts.append(_timeout(log, outcome))
    elif not outcome.done:
        name = log.phase_names[log.phase[-1]]
        how = "was interrupted" if outcome.interrupted else "ended"
        parts.append(
            f"the run {how} at {log.t[-1] + log.meta.dt:.4g} s in phase '{name}'"
            + _missing(log, outcome, name, log.ticks - 1)
        )
        if (held := held_to_the_end(log)) is not None:
            parts.append(f"it stood still from {log.t[held[0]]:.4g} s on ({held[1]})")
    return "; ".join(parts + violations(log) + _without_forces(log))


def _timeout(log: Log, outcome: Outcome) -> str:
    name = outcome.timeouts[0]
    timeout = next((p.timeout for p in outcome.phases if p.name == name), math.nan)
    within = np.flatnonzero(log.phase == log.phase_names.index(name))
    text = f"phase '{name}' timed out"
    if not len(within):
        return text
    if not math.isfinite(timeout):
        return text + _missing(log, outcome, name, int(within[-1]))
    # what it had reached when its time was up, not what it reached while being held after that
    due = log.t[within] <= log.t[within[0]] + timeout + 1e-9
    return f"{text} after {timeout:.4g} s" + _missing(log, outcome, name, int(within[due][-1]))


def _missing(log: Log, outcome: Outcome, name: str, tick: int) -> str:
    """What the exit condition of phase `name` still lacked at `tick`; empty if nothing is known."""
    phase = next((p for p in outcome.phases if p.name == name), None)
    if phase is None:
        return ""
    lacking = _residuals(log, phase.until, tick) + _tips(log, phase, tick)
    return ": " + ", ".join(lacking) if lacking else ""


def _residuals(log: Log, until: ExitCondition, k: int) -> list[str]:
    """Task errors, force closure and object error above what was asked."""
    first = int(log.meta.main_task is not None)
    found = []
    for task, limit in until.residuals:
        found += _above(f"error of '{log.task_names[first + task]}'",
                        log.task_error[k, first + task], limit)  # fmt: skip
    if until.force_closure is not None:
        found += _above("eps_f", log.eps_f[k], until.force_closure)
        found += _above("eps_m", log.eps_m[k], until.force_closure)
    if until.object_error is not None:
        errors = log.object_error[k, :, 0]
        held = errors[~np.isnan(errors)]
        found += _above("object error [m]", float(held.max(initial=0.0)), until.object_error)
    return found


def _tips(log: Log, phase: Phase, k: int) -> list[str]:
    """What the tips of free fingers lacked."""
    if phase.until.tip_error is None and phase.until.distance is None:
        return []
    reaching = np.flatnonzero(np.isfinite(phase.reach))
    worst, free = _worst_tip(log, reaching, k)
    found = []
    if phase.until.tip_error is not None and free:
        found += _above(f"tip error of '{free}' [m]", worst, phase.until.tip_error)
    if phase.until.distance is not None and free and not found:
        found.append(
            f"tips asked to be {phase.until.distance:.3g} m outside the object "
            f"(the one of '{free}' is {worst:.3g} m from where it should be)"
        )
    return found


def _worst_tip(log: Log, reaching: IntArray, k: int) -> tuple[float, str]:
    """The largest tip error among the fingers that reach, and whose it is; tips follow fingers."""
    usable: BoolArray = reaching < len(log.tip_task_names)
    reaching = reaching[usable]
    if not len(reaching):
        return math.nan, ""
    worst = int(reaching[np.argmax(log.tip_task_error[k, reaching])])
    return float(log.tip_task_error[k, worst]), log.contact_names[worst]


def _above(what: str, reached: float, needed: float) -> list[str]:
    return [] if reached <= needed else [f"{what} {reached:.3g}, needed {needed:.3g}"]
