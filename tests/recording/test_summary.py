"""The summary: every number against one worked out by hand, and the sentence about a failure."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wbc.control.phases import ExitCondition, PhaseSequence
from wbc.control.references import Motion
from wbc.control.state import PhaseState, Status
from wbc.errors import WbcError
from wbc.recording import Outcome, summarize, write
from wbc.recording.summary import phase_starts, velocity_steps
from wbc.stack.limits import Limited

from .runs import (
    DT,
    FORCE_META,
    META,
    PHASES,
    phase,
    planned,
    record,
    recorded,
    removed_and_back,
    with_forces,
    without_limits,
)

DONE = Outcome(PHASES, done=True)
OPEN = Outcome(PHASES, done=False)
LATE = Outcome(PHASES, done=False, timeouts=("slide",))


def test_origin_and_length() -> None:
    s = summarize(recorded(100), DONE)
    assert (s["scenario"], s["seed"], s["source"]) == ("two fingers", 7, "two_fingers.yaml")
    assert s["scenario_sha256"] == META.scenario_hash
    assert s["versions"] == {"python": "3", "wbc": "0"}
    assert (s["ticks"], s["dt"]) == (100, DT) and s["duration"] == pytest.approx(1.0)
    assert s["success"] is True and s["reason"] == "" and s["complete"] is True


def test_phases_and_when_they_began() -> None:
    log = recorded(100)
    assert phase_starts(log).tolist() == [0, 50]
    assert summarize(log, DONE)["phases"] == [
        {"name": "reach", "entered": 0.0, "left": 0.5, "completed": True},
        {"name": "slide", "entered": 0.5, "left": None, "completed": True},
    ]
    assert [p["completed"] for p in summarize(log, OPEN)["phases"]] == [True, False]
    late = summarize(log, LATE)
    assert [p["completed"] for p in late["phases"]] == [True, False]
    assert late["timeouts"] == ["slide"]


def test_force_closure_counts_from_the_last_time_above() -> None:
    # 0.9^k < 1e-6 from k = 132 on
    log = recorded(160, {150: {"residuals": (1e-7, 2e-6)}})
    closure = summarize(log, DONE)["force_closure"]
    assert closure["eps_f"] == 0.9**159 and closure["eps_m"] == 0.1 * 0.9**159
    assert closure["below_since"] == 151 * DT
    assert summarize(recorded(160), DONE)["force_closure"]["below_since"] == 132 * DT
    assert summarize(recorded(100), DONE)["force_closure"]["below_since"] is None
    nan = recorded(160, {159: {"residuals": (np.nan, 0.0)}})
    assert summarize(nan, DONE)["force_closure"]["below_since"] is None
    assert summarize(nan, DONE)["force_closure"]["eps_f"] is None


def test_object_error_overall_and_settled() -> None:
    error = summarize(recorded(100), DONE)["object_error"]
    assert error["fingers"]["f1"]["overall"] == {"position": 1e-4, "orientation": 1e-5}
    assert error["fingers"]["f1"]["settled"]["position"] == pytest.approx(1e-4 * 0.9**31)
    assert error["fingers"]["f2"]["overall"] == {"position": 2e-3, "orientation": 0.0}
    assert error["settled"]["position"] == error["overall"]["position"] == 2e-3
    early = summarize(recorded(20), OPEN)["object_error"]
    assert early["settled"] == {"position": None, "orientation": None}
    assert early["fingers"]["f2"]["overall"] == {"position": None, "orientation": None}


def test_extremes_with_whose_and_when() -> None:
    far = {40: {"q": np.array([0.1, -1.9, 0.0]), "v": np.array([0.0, 0.0, -2.5])}}
    s = summarize(recorded(100, far), DONE)
    assert s["motion"]["max_q"] == 1.9 and s["motion"]["max_q_joint"] == "elbow"
    assert s["motion"]["max_q_deg"] == pytest.approx(np.rad2deg(1.9))
    assert s["motion"]["max_q_t"] == s["motion"]["max_v_t"] == 0.4
    assert (s["motion"]["max_v"], s["motion"]["max_v_joint"]) == (2.5, "wrist")
    assert s["distance"] == {"min": pytest.approx(0.301), "t": pytest.approx(0.99)}
    assert s["cost"] == {"max": pytest.approx(0.099), "t": pytest.approx(0.99)}
    assert s["independence"]["min"] == 0.5
    assert s["final_task_error"] == pytest.approx(
        {"object": 2e-3, "force": 0.5 * 0.9**99, "posture": 0.3}
    )


def test_velocity_steps_at_switches() -> None:
    log = recorded(100, removed_and_back())
    steps = velocity_steps(log)
    assert steps[0] == 0.0 and steps[30] == pytest.approx(0.02, abs=0.004)
    s = summarize(log, DONE)
    largest = s["velocity_steps"]
    # the step into tick 30, or back in tick 31; cos falls, so back is the larger
    assert largest["max"] == steps[31] == max(steps)
    assert (largest["t"], largest["joint"]) == (0.31, "shoulder")
    assert largest["at_stack_events"] == steps[31]
    assert largest["at_phase_changes"] == max(steps[50:53])
    events = s["stack"]["list"]
    assert [(e["t"], e["task"], e["event"]) for e in events] == [
        (0.3, "force", "removed"),
        (0.6, "force", "inserted"),
    ]
    assert events[0]["velocity_step"] == steps[31] and events[0]["predicted_cost"] == 0.06
    assert (s["stack"]["events"], s["stack"]["removals"]) == (2, 1)


def test_flags_and_limit_filter() -> None:
    slowed = {"limited": Limited(0.5, 1.0, 1.0, False, 1), "status": Status.SCALED}
    clipped = {"limited": Limited(0.0, 0.25, 1.0, True, 2), "status": Status.CLIPPED}
    s = summarize(recorded(60, {4: slowed, 5: slowed, 9: clipped}), DONE)
    assert s["status"]["SCALED"] == 2 and s["status"]["CLIPPED"] == 1 and s["status"]["DONE"] == 0
    assert s["limits"]["secondary"] == {"ticks": 3, "smallest_share": 0.0}
    assert s["limits"]["main"] == {"ticks": 1, "smallest_share": 0.25}
    assert s["limits"]["change"] == {"ticks": 0, "smallest_share": 1.0}
    assert (s["limits"]["clipped"], s["limits"]["most_limited_joint"]) == (1, "elbow")
    assert s["success"] is True  # clipping keeps a limit; it does not break one


def test_a_timeout_names_what_was_lacking_when_time_was_up() -> None:
    # slide begins at tick 50 and may last 0.2 s: at tick 70, not at the end, the residual counts
    s = summarize(recorded(100), LATE)
    reached = 0.5 * 0.9**70
    assert s["success"] is False
    assert s["reason"] == (
        f"phase 'slide' timed out after 0.2 s: error of 'force' {reached:.3g}, needed 1e-06, "
        f"eps_f {0.9**70:.3g}, needed 1e-06, eps_m {0.1 * 0.9**70:.3g}, needed 1e-06"
    )


def test_the_tips_of_a_phase_that_reaches() -> None:
    log = recorded(40)
    outcome = Outcome(PHASES, done=False)
    assert summarize(log, outcome)["reason"] == (
        "the run ended at 0.4 s in phase 'reach': tip error of 'f2' [m] 0.02, needed 1e-07"
    )
    away = (phase("reach", ExitCondition(distance=0.1), 1.0, (np.nan, 0.2)), PHASES[1])
    assert (
        "tips asked to be 0.1 m outside the object (the one of 'f2' is 0.02 m from"
        in (summarize(log, Outcome(away, done=False))["reason"])
    )


def test_the_object_error_of_an_exit_condition_ignores_free_fingers() -> None:
    held = (phase("reach", ExitCondition(object_error=1e-9), 1.0, (np.nan, np.nan)), PHASES[1])
    reason = summarize(recorded(20), Outcome(held, done=False))["reason"]
    assert f"object error [m] {1e-4 * 0.9**19:.3g}, needed 1e-09" in reason


def test_ctrl_c_is_told_from_an_end() -> None:
    log = recorded(60, complete=False)
    s = summarize(log, replace(OPEN, interrupted=True))
    assert s["reason"].startswith("the run was interrupted at 0.6 s in phase 'slide': ")
    assert s["interrupted"] is True and s["complete"] is False
    assert summarize(log, replace(DONE, interrupted=True))["success"] is True


VIOLATIONS = {
    "joint 'elbow' was 0.5 rad (or m) beyond its position limit at 0.12 s": {
        "q": np.array([0.0, -2.5, 0.0])
    },
    "joint 'shoulder' was 1 rad/s (or m/s) beyond its velocity limit at 0.12 s": {
        "v": np.array([-4.0, 0.0, 0.0])
    },
    "parts collided at 0.12 s (-0.001 m)": {"min_distance": -0.001},
    "the measurement was not usable from 0.12 s on, 0.01 s in all": {
        "status": Status.BAD_MEASUREMENT
    },
    "the control law gave no finite velocity from 0.12 s on, 0.01 s in all": {
        "status": Status.BAD_COMMAND
    },
}


@pytest.mark.parametrize("reason", VIOLATIONS)
def test_a_hard_limit_that_was_not_kept_is_no_success(reason: str) -> None:
    s = summarize(recorded(100, {12: VIOLATIONS[reason]}), DONE)
    assert s["success"] is False and s["reason"] == reason and s["violations"] == [reason]


def test_limits_kept_to_rounding_are_kept() -> None:
    edge = {12: {"q": np.array([2.0 + 1e-12, -2.0, 1e9]), "v": np.array([3.0, -3.0, 1e9])}}
    assert summarize(recorded(100, edge), DONE)["success"] is True
    beyond = {12: {"q": np.array([np.nan, 0.0, 0.0])}}
    assert summarize(recorded(100, beyond), DONE)["success"] is False
    assert summarize(recorded(100, beyond, without_limits()), DONE)["success"] is True


def test_a_log_alone_tells_what_it_can() -> None:
    done = recorded(100, {99: {"status": Status.DONE}})
    assert summarize(done)["success"] is True
    late = {k: {"status": Status.PHASE_TIMEOUT} for k in range(70, 100)}
    s = summarize(recorded(100, late))
    assert s["reason"] == "phase 'slide' timed out" and s["timeouts"] == ["slide"]
    # the timeout that leads to the next phase falls in that phase's first tick
    gone_on = {k: {"status": Status.PHASE_TIMEOUT} for k in range(50, 100)}
    assert summarize(recorded(100, gone_on))["timeouts"] == ["reach"]
    cut = summarize(recorded(100, complete=False))
    assert cut["reason"] == "the run was interrupted at 1 s in phase 'slide'"


def test_outcome_of_a_controllers_last_state() -> None:
    zero = np.zeros(3)
    motion = Motion(0.0, 1.0, zero, np.eye(3), zero, zero, zero)
    state = PhaseState(1, 0.5, motion, False, True, ("slide",))
    assert Outcome.of(PhaseSequence(PHASES), state) == LATE


@pytest.mark.parametrize("ticks", [0, 1, 2])
def test_short_logs_have_a_summary_too(tmp_path: Path, ticks: int) -> None:
    s = summarize(recorded(ticks), OPEN)
    assert s["ticks"] == ticks and s["success"] is False
    assert s["duration"] == pytest.approx(ticks * DT)
    if not ticks:
        assert s["reason"] == "no tick was recorded"
    write(s, tmp_path / "summary.json")


def test_the_file_is_strict_json(tmp_path: Path) -> None:
    bad = {
        3: {"min_distance": np.nan, "cost": np.inf, "residuals": (np.nan, np.inf)},
        4: {"v": np.full(3, np.nan), "object_error": np.full((2, 2), np.inf)},
        5: {"min_distance": np.inf, "independence": np.nan},
    }
    s = summarize(recorded(60, bad), DONE)
    write(s, tmp_path / "summary.json")

    def never(text: str) -> None:
        raise AssertionError(text)

    text = (tmp_path / "summary.json").read_text(encoding="ascii")
    assert json.loads(text, parse_constant=never) == s
    assert s["cost"]["max"] is None
    assert write(s, tmp_path / "again.json").read_text() == text


def test_planned_forces() -> None:
    s = summarize(with_forces(100), DONE)
    # press = 4 − 0.01 k: finger 1 keeps press − 0.9, finger 2 half of press from tick 50 on
    assert s["force_min_cone_margin_n"] == pytest.approx(0.5 * (4.0 - 0.99))
    assert s["force_min_torque_margin_nm"] == pytest.approx(0.4 - 0.003 * 99)
    assert s["force_iterations_mean"] == pytest.approx(1.06)
    assert s["force_infeasible_ticks"] == 10
    assert s["force_sum_normal_max_n"] == pytest.approx(1.5 * 3.5)
    assert s["force_statuses"] == {
        "solved": {"first_t": 0.0, "ticks": 90},
        "infeasible_friction": {"first_t": pytest.approx(0.9), "ticks": 10},
    }


def test_without_planned_forces_nothing_is_said_of_them() -> None:
    assert not [key for key in summarize(recorded(5), DONE) if key.startswith("force_m")]


def test_a_run_without_pairs_has_no_distance() -> None:
    log = recorded(5, {k: {"min_distance": np.inf} for k in range(5)})
    assert summarize(log, DONE)["distance"] == {"min": None, "t": None}


def test_a_summary_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(WbcError, match=r"\Acannot write '.*': it is not a regular file\Z"):
        write(summarize(recorded(5), DONE), tmp_path)


def test_recording_is_cheap() -> None:
    """An append costs microseconds; the bound leaves room for a machine that is busy."""
    import time

    from wbc.recording import Recorder

    recorder, r = Recorder(META, capacity_hint=20_000), record(3)
    best = np.inf
    for _ in range(20):
        start = time.perf_counter()
        for _ in range(500):
            recorder.append(r)
        best = min(best, (time.perf_counter() - start) / 500)
    assert best < 30e-6


def test_a_run_without_forces_in_some_ticks_is_no_success_and_says_why() -> None:
    s = summarize(with_forces(100), DONE)
    assert s["success"] is False
    assert s["reason"] == (
        "no contact forces could be planned in 10 of 100 ticks, from 0.9 s in phase 'slide' on "
        "(beyond friction in 10)"
    )
    assert s["violations"] == []
    good = summarize(with_forces(90), DONE)
    assert good["success"] is True and good["force_infeasible_ticks"] == 0


def test_the_least_sum_of_normal_forces_is_one_of_fingers_that_touch() -> None:
    free = {"mode": np.array([0, 0]), "forces": planned(0)._replace(sum_normal=0.0)}
    changes = {k: {"forces": planned(k)} for k in range(60)}
    s = summarize(recorded(60, {**changes, 0: free}, FORCE_META), DONE)
    assert s["force_sum_normal_min_n"] == pytest.approx(4.0 - 0.49)
