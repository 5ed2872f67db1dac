"""One trial of a campaign, as a function of what it is given; importable by any worker."""

from __future__ import annotations

import io
import json
import time
from typing import Any

from wbc.campaign.trial import CRASHED, Done, Trial
from wbc.cli.interrupt import Interrupts
from wbc.cli.progress import Progress, SlowNotice
from wbc.cli.run import Session, check_rehearsal, write_run
from wbc.errors import WbcError
from wbc.scenario import Loaded
from wbc.scenario.build import Assembly, build
from wbc.scenario.build_disturbance import build_disturbance
from wbc.scenario.load import load_bytes

_ELSEWHERE = ("scenario_sha256", "source", "seed", "versions", "disturbance")
"""Keys of a summary that are the campaign's, the machine's, or beside it in the line."""


def run_trial(trial: Trial) -> Done:
    """Run a trial, keep its log if that is asked for, and never raise.

    A scenario that cannot be started and a fault of wbc are failures with a reason.
    """
    began = time.perf_counter()
    try:
        summary = _simulated(trial)
    except WbcError as error:
        summary = _failed("refused: " + "; ".join(str(error).splitlines()))
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        summary = _failed(f"internal error: {what}")
    return Done(_line(trial, summary), time.perf_counter() - began)


def crashed_line(trial: Trial) -> str:
    """The line of a trial that took its process with it."""
    return _line(trial, _failed(CRASHED))


def first_tick(assembly: Assembly) -> None:
    """Run one tick for nothing, so that the kernels are compiled before several processes do."""
    interrupts = Interrupts(owns_process=False)
    interrupts.received = 1
    _session(assembly).go(interrupts, SlowNotice(_silent))


def load_trial(trial: Trial) -> Loaded:
    """The scenario of a trial. Raises ScenarioError."""
    return load_bytes(trial.text, trial.path, trial.shown, trial.overrides)


def _simulated(trial: Trial) -> dict[str, Any]:
    assembly = build(load_trial(trial))
    if assembly.loaded.scenario.simulation.rehearse:
        check_rehearsal(assembly)
    session = _session(assembly)
    session.go(Interrupts(owns_process=False), SlowNotice(_silent))
    log, summary = session.finish(interrupted=False)
    if trial.keep == "all" or (trial.keep == "failed" and not summary["success"]):
        write_run(trial.folder, log, summary, assembly)
    return summary


def _session(assembly: Assembly) -> Session:
    phases = tuple(phase.name for phase in assembly.controller.phases.phases)
    progress = Progress(phases, assembly.loaded.scenario.simulation.duration, io.StringIO())
    return Session.of(assembly, progress)


def _silent(_: str) -> None:
    pass


def _failed(reason: str) -> dict[str, Any]:
    return {"success": False, "reason": reason}


def _line(trial: Trial, summary: dict[str, Any]) -> str:
    facts = {
        "trial": trial.number,
        "seed": trial.seed,
        "disturbance": _drawn(trial),
        "summary": {key: value for key, value in summary.items() if key not in _ELSEWHERE},
    }
    return json.dumps(facts, allow_nan=False)


def _drawn(trial: Trial) -> dict[str, Any]:
    """What was drawn for it, also where it did not come to run."""
    try:
        disturbance = build_disturbance(load_trial(trial).scenario)
    except WbcError:
        disturbance = None
    return {**(disturbance.as_record() if disturbance else {}), **trial.varied}
