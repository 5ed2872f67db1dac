"""What failed first in a run that is no success: one word, when, and in which phase."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from wbc.control.state import Status
from wbc.recording.dynamic_facts import dropped, fingers_off, held_to_the_end, off_for
from wbc.recording.log import Log
from wbc.recording.outcome import Outcome, beyond_limits, unplanned

LOST: Final = 0.2
"""A finger that does not press for this long where it should has lost its contact, [s]."""

_FLAGS: Final = (Status.BAD_MEASUREMENT, Status.BAD_COMMAND)


class Failure(NamedTuple):
    """What failed first.

    Attributes:
        what: ``limits``, ``collision``, ``bad_measurement``, ``bad_command``, ``phase_timeout``,
            ``no_forces``, ``diverged``, ``dropped``, ``held``, ``contact_lost``, ``interrupted``,
            ``not_finished`` or ``no_tick``.
        t: when, [s]; None without a tick.
        phase: the phase it befell; None likewise.
    """

    what: str
    t: float | None
    phase: str | None


def first_failure(log: Log, outcome: Outcome) -> Failure:
    """What failed first in a run that is no success, for which `outcome.reason` has a sentence.

    Of what comes in the same tick, the first in the order of `Failure` counts. A contact lost is no
    failure by itself, yet what a run that failed may have failed of.
    """
    if not log.ticks:
        return Failure("no_tick", None, None)
    found = min(_failures(log, outcome), key=lambda one: one[0])
    return Failure(found[1], float(log.t[found[0]]), log.phase_names[log.phase[found[0]]])


def _failures(log: Log, outcome: Outcome) -> Iterator[tuple[int, str]]:
    """Tick and name of each thing that failed."""
    for what, ticks in (
        ("limits", beyond_limits(log)),
        ("collision", log.min_distance <= 0.0),
        *((str(flag.name).lower(), (log.status & flag) != 0) for flag in _FLAGS),
    ):
        if ticks.any():
            yield int(np.argmax(ticks)), what
    late = np.flatnonzero(log.status & Status.PHASE_TIMEOUT)
    if len(late):  # the tick before is still of the phase that took too long
        yield max(int(late[0]) - 1, 0), "phase_timeout"
    without = unplanned(log)
    if len(without):
        yield int(without[0]), "no_forces"
    if log.dynamic:
        yield from _of_physics(log)
    yield log.ticks - 1, "interrupted" if outcome.interrupted else "not_finished"


def _of_physics(log: Log) -> Iterator[tuple[int, str]]:
    gone = ~(np.isfinite(log.q_meas).all(axis=1) & np.isfinite(log.object_pose_true).all(axis=1))
    if gone.any():
        yield int(np.argmax(gone)), "diverged"
    fell = dropped(log)
    if fell is not None:
        yield int(np.searchsorted(log.t, fell)), "dropped"
    if (held := held_to_the_end(log)) is not None:
        yield held[0], "held"
    lost = off_for(fingers_off(log)) > round(LOST / log.meta.dt)
    if lost.any():
        yield int(np.argmax(lost)), "contact_lost"
