"""The closing report of ``wbc run``: the lines about forces and force closure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from recording.runs import FORCE_META, PHASES, planned, recorded, with_forces

from wbc.cli.report import report_lines
from wbc.recording import Outcome, summarize

DONE = Outcome(PHASES, done=True)


def said(lines: list[str], name: str) -> str | None:
    found = [line[17:] for line in lines if line[2:17].strip() == name]
    return found[0] if found else None


def test_forces_of_every_tick() -> None:
    lines = report_lines(summarize(with_forces(90), DONE), 1.0)
    assert lines[0] == "two fingers: success"
    assert said(lines, "forces") == (
        "planned in every tick; normal forces sum to 3.51 to 5.25 N; least margins 1.6 N to a "
        "cone, 0.13 Nm to a torque limit; 1.07 solver steps per tick"
    )


def test_forces_that_could_not_be_planned() -> None:
    lines = report_lines(summarize(with_forces(100), DONE), 1.0)
    assert lines[0].startswith("two fingers: no success: no contact forces could be planned in 10")
    text = said(lines, "forces")
    assert text is not None
    assert text.startswith(
        "planned in 90 of 100 ticks; infeasible friction in 10 ticks from 0.90 s"
    )


def test_forces_without_any_limit_or_contact() -> None:
    none = planned(0)._replace(
        force=np.zeros((2, 3)), cone_margin=np.full(2, np.nan), sum_normal=0.0,
        torque_margin=np.full(3, np.inf), status=0,
    )  # fmt: skip
    meta = replace(FORCE_META, tau_min=(-np.inf,) * 3, tau_max=(np.inf,) * 3)
    changes = {k: {"forces": none, "mode": np.zeros(2, dtype=int)} for k in range(3)}
    lines = report_lines(summarize(recorded(3, changes, meta), DONE), 1.0)
    assert said(lines, "forces") == "planned in every tick; 7.00 solver steps per tick"


def test_runs_that_plan_none_say_nothing_of_forces() -> None:
    assert said(report_lines(summarize(recorded(9), DONE), 1.0), "forces") is None


def test_force_closure_that_nobody_asks_for_is_named_only_where_it_is_reached() -> None:
    open_, closed = (summarize(recorded(n), DONE) for n in (100, 160))
    assert "not reached" in (said(report_lines(open_, 1.0), "force closure") or "")
    assert said(report_lines(open_, 1.0, balances=False), "force closure") is None
    assert said(report_lines(closed, 1.0, balances=False), "force closure") is not None
