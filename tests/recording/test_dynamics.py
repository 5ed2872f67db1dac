"""Runs under torques: what is recorded, read back, and what the summary makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from tests.recording.runs import FORCE_META, META, planned, record, recorded, with_forces
from wbc.arrays import Array
from wbc.control.force_control import TorqueStatus
from wbc.control.state import DynamicsRecord, Status
from wbc.errors import WbcError
from wbc.recording import Log, Outcome, Recorder, summarize
from wbc.recording.dynamic_facts import object_error_true
from wbc.recording.dynamic_plots import force_errors, torques
from wbc.recording.log import DYNAMICS
from wbc.recording.plots import object_error, plot
from wbc.rotations import exp_so3

LIMITED = replace(META, tau_min=(-0.5, -0.5, -np.inf), tau_max=(0.5, 0.5, np.inf))


def moved(k: int, **changes: object) -> DynamicsRecord:
    """Tick k of a run under torques: finger 1 presses with 4 N, the object goes 2 mm off."""
    off = float(k > 0)
    made = DynamicsRecord(
        tau=np.array([0.1, -0.2, 3.0]),
        force=np.array([[0.0, -4.1, 0.0], [0.0, 0.0, 0.0]]),
        plan=np.array([[0.0, -4.0, 0.0], [0.0, 0.0, 0.0]]),
        object_position=record(k).reference_position + off * np.array([0.0, 2e-3, 0.0]),
        object_rotation=exp_so3(off * np.array([0.0, 1e-3, 0.0])),
        slip=np.array([1e-5 * k, 0.0]),
        q=record(k).q + 1e-3,
        v=record(k).v,
        status=0,
    )
    return made._replace(**changes)


def run(ticks: int = 60, **changes: dict[str, object]) -> Log:
    """A run under torques; `k12={...}` changes what was measured in tick 12."""
    given = {
        k: {"dynamics": moved(k, **changes.get(f"k{k}", {})), "mode": np.array([1, 0])}
        for k in range(ticks)
    }
    return recorded(ticks, given, LIMITED)


def test_everything_measured_is_recorded_and_read_back(tmp_path: Path) -> None:
    log = run()
    assert log.dynamic and not log.plans_forces
    assert log.tau[7] == pytest.approx([0.1, -0.2, 3.0])
    assert log.contact_force_meas[7, 0] == pytest.approx([0.0, -4.1, 0.0])
    assert log.contact_force_plan[7, 0] == pytest.approx([0.0, -4.0, 0.0])
    assert log.object_pose_true[7, 1] == 2e-3
    assert log.slip[7] == pytest.approx([7e-5, 0.0])
    assert log.q_meas[7] == pytest.approx(record(7).q + 1e-3)
    log.save(tmp_path / "log.npz")
    back = Log.load(tmp_path / "log.npz")
    for name in (*DYNAMICS, "contact_force_plan", "phi"):
        np.testing.assert_array_equal(getattr(back, name), getattr(log, name))


def test_planned_forces_and_torques_go_together() -> None:
    given = {k: {"dynamics": moved(k), "forces": planned(k)} for k in range(60)}
    log = recorded(60, given, FORCE_META)
    assert log.dynamic and log.plans_forces
    assert log.tau_plan[7] == pytest.approx(planned(7).torque)
    assert log.tau[7] == pytest.approx(moved(7).tau)
    assert log.contact_force_plan[7] == pytest.approx(moved(7).plan)  # what was followed


def test_a_log_of_the_ideal_robot_has_none_of_it(tmp_path: Path) -> None:
    log = recorded(60)
    assert not log.dynamic and log.tau.shape == (0, 3) and log.object_pose_true.shape == (0, 7)
    assert "dropped" not in summarize(log)
    log.save(tmp_path / "log.npz")
    with np.load(tmp_path / "log.npz") as data:  # as before there were any
        arrays = {name: data[name] for name in data.files if name not in DYNAMICS}
    np.savez(tmp_path / "old.npz", **(arrays | {"format": np.array(2)}))
    assert not Log.load(tmp_path / "old.npz").dynamic


def test_torques_of_some_ticks_only_are_refused(tmp_path: Path) -> None:
    recorder = Recorder(LIMITED)
    recorder.append(record(0, dynamics=moved(0)))
    with pytest.raises(ValueError, match=r"record\.dynamics must be there in every tick"):
        recorder.append(record(1))
    with pytest.raises(ValueError, match=r"record\.dynamics\.tau has shape \(2,\), expected"):
        Recorder(LIMITED).append(record(0, dynamics=moved(0, tau=np.zeros(2))))
    run().save(tmp_path / "log.npz")
    with np.load(tmp_path / "log.npz") as data:
        arrays = dict(data)
    arrays.update({name: arrays[name][:30] for name in DYNAMICS})
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(WbcError, match="it has 30 ticks of torques, 60 of forces, and 60 ticks"):
        Log.load(tmp_path / "bad.npz")


def test_the_summary_tells_what_happened() -> None:
    facts = summarize(run(k50={"status": int(TorqueStatus.SATURATED)}))
    assert facts["dropped"] is False
    assert facts["object_error_max_m"] == pytest.approx(2e-3)
    assert facts["object_error_max_rad"] == pytest.approx(1e-3, rel=1e-9)
    assert facts["force_error_max_n"]["f1"] == pytest.approx(0.1)
    assert facts["contact_lost_s"] == 0.0
    assert facts["slip_max_m"] == pytest.approx(59e-5)
    assert facts["tau_max_ratio"] == pytest.approx(0.4)  # the third has no limit
    assert facts["torque_status"]["SATURATED"] == 1


def test_a_finger_that_lets_go_is_seen_for_as_long_as_it_does() -> None:
    off = {"force": np.zeros((2, 3))}
    facts = summarize(run(k20=off, k40=off, k41=off, k42=off))
    assert facts["contact_lost_s"] == pytest.approx(0.03)


@pytest.mark.parametrize(
    "change",
    [
        {"object_position": np.array([0.0, 0.051, 0.0])},
        {"object_rotation": exp_so3(np.array([0.0, 0.0, 0.61]))},
        {"object_position": np.full(3, np.nan)},
    ],
)
def test_a_dropped_object_is_no_success(change: dict[str, object]) -> None:
    facts = summarize(run(k55=change))
    assert facts["dropped"] is True
    assert "the object was dropped at 0.55 s" in facts["violations"]


def put(k: int, position: Array, turn: Array, off: Array) -> dict[str, object]:
    """Tick k with a reference at a pose, and the true object displaced from it in its axes."""
    rotation = exp_so3(turn)
    return {
        "reference_position": position, "reference_rotation": rotation, "mode": np.array([1, 0]),
        "dynamics": moved(
            k, object_position=position + rotation @ off[:3],
            object_rotation=rotation @ exp_so3(off[3:]),
        ),
    }  # fmt: skip


def test_what_was_believed_wrongly_at_the_start_is_no_error_later() -> None:
    """The object is carried along its reference, displaced in its own axes by 5 mm and 2 deg."""
    off = np.array([3e-3, -4e-3, 0.0, 0.0, 0.03, -0.015])
    worse = off + np.array([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0])
    given = {
        k: put(k, np.array([0.01 * k, 0.2, 0.0]), np.array([0.02, 0.3, -0.04]) * k,
               worse if k == 40 else off)
        for k in range(60)
    }  # fmt: skip
    log = recorded(60, given, LIMITED)
    way, angle = object_error_true(log)
    assert np.delete(way, 40).max() < 1e-12 and angle.max() < 1e-8
    assert way[40] == pytest.approx(1e-3)
    assert np.linalg.norm(log.object_pose_true[40, :3] - log.object_pose_ref[40, :3]) > 5e-3
    assert summarize(log)["object_error_max_m"] == pytest.approx(1e-3)


def test_the_hand_over_is_when_the_first_hand_leaves() -> None:
    both, second = np.array([1, 1]), np.array([0, 1])
    given = {k: {"dynamics": moved(k), "mode": both if k < 40 else second} for k in range(60)}
    given[40]["dynamics"] = moved(
        40, object_position=record(40).reference_position + np.array([0.0, 0.0, 3e-3])
    )
    facts = summarize(recorded(60, given, LIMITED))
    assert facts["object_error_handover_m"] == pytest.approx(3e-3)
    assert facts["object_error_handover_rad"] == pytest.approx(1e-3, rel=1e-6)
    assert summarize(run())["object_error_handover_m"] is None  # nobody leaves


def test_creep_is_measured_where_the_reference_rests() -> None:
    """It moves on for a second, rests for 5.5 s, and moves on."""

    def tick(k: int) -> dict[str, object]:
        rest = np.clip(k, 100, 650)
        position = np.array([1e-2 * (k - rest), 0.0, 0.0])
        crept = 1e-5 * (k - 100) * 0.01 if k >= 100 else 2e-3
        off = np.array([0.0, crept, 0.0, 0.0, 0.0, 2e-4 * 0.01 * k])
        return put(k, position, np.zeros(3), off)

    facts = summarize(recorded(700, {k: tick(k) for k in range(700)}, LIMITED))
    assert facts["creep_m_per_s"] == pytest.approx(1e-5, rel=1e-6)
    assert facts["creep_rad_per_s"] == pytest.approx(2e-4, rel=1e-6)
    assert summarize(run())["creep_m_per_s"] is None  # it never rests
    short = recorded(600, {k: tick(k) for k in range(600)}, LIMITED)
    assert summarize(short)["creep_m_per_s"] is None
    taken = {k: {**tick(k), "mode": np.array([1, k > 400])} for k in range(700)}
    assert summarize(recorded(700, taken, LIMITED))["creep_m_per_s"] is None


DONE = Outcome((), True)


@pytest.mark.parametrize(
    ("changes", "outcome", "expected"),
    [
        ({}, DONE, (None, None, None)),
        ({5: {"status": Status.BAD_MEASUREMENT}, 7: {"min_distance": -1e-3}}, DONE,
         ("bad_measurement", 0.05, "reach")),
        ({5: {"q": np.array([3.0, 0.0, 0.0])}, 7: {"min_distance": -1e-3}}, DONE,
         ("limits", 0.05, "reach")),
        ({5: {"status": Status.BAD_COMMAND}, 3: {"min_distance": 0.0}}, DONE,
         ("collision", 0.03, "reach")),
        ({50: {"status": Status.PHASE_TIMEOUT}}, Outcome((), True, ("reach",)),
         ("phase_timeout", 0.49, "reach")),
        ({}, Outcome((), False), ("not_finished", 0.59, "slide")),
        ({}, Outcome((), False, interrupted=True), ("interrupted", 0.59, "slide")),
        ({55: {"dynamics": moved(55, object_position=np.full(3, 1.0))}}, DONE,
         ("dropped", 0.55, "slide")),
        ({55: {"dynamics": moved(55, q=np.full(3, np.nan))},
          56: {"dynamics": moved(56, object_position=np.full(3, np.nan))}}, DONE,
         ("diverged", 0.55, "slide")),
        ({k: {"dynamics": moved(k, force=np.zeros((2, 3)))} for k in range(10, 40)}, DONE,
         (None, None, None)),
        ({**{k: {"dynamics": moved(k, force=np.zeros((2, 3)))} for k in range(10, 40)},
          45: {"dynamics": moved(45, object_position=np.full(3, 1.0))}}, DONE,
         ("contact_lost", 0.3, "reach")),
        ({**{k: {"dynamics": moved(k, force=np.zeros((2, 3)))} for k in range(26, 46)},
          45: {"dynamics": moved(45, object_position=np.full(3, 1.0))}}, DONE,
         ("dropped", 0.45, "reach")),
    ],
)  # fmt: skip
def test_what_failed_first_has_a_name_and_a_time(
    changes: dict[int, dict[str, object]],
    outcome: Outcome,
    expected: tuple[str | None, float | None, str | None],
) -> None:
    given = {k: {"dynamics": moved(k), "mode": np.array([1, 0])} for k in range(60)}
    log = recorded(60, {k: {**given[k], **changes.get(k, {})} for k in given}, LIMITED)
    facts = summarize(log, outcome)
    what, t, where = expected
    assert facts["success"] is (what is None)
    assert (facts["failure"], facts["failure_phase"]) == (what, where)
    assert facts["failure_t"] == (None if t is None else pytest.approx(t))


def test_a_run_without_a_tick_failed_of_that() -> None:
    facts = summarize(recorded(0))
    assert (facts["failure"], facts["failure_t"], facts["failure_phase"]) == ("no_tick", None, None)


def test_forces_that_could_not_be_planned_are_what_failed() -> None:
    facts = summarize(with_forces(), DONE)
    assert (facts["failure"], facts["failure_t"]) == ("no_forces", pytest.approx(0.9))


def test_a_run_under_torques_has_a_picture_of_them(tmp_path: Path) -> None:
    files = plot(run(), tmp_path)
    assert {"torques.png", "force_errors.png"} <= {file.name for file in files}
    assert "torques.png" not in {file.name for file in plot(recorded(60), tmp_path / "ideal")}
    load, behind, slip = (values(axes)[0] for axes in torques(run()).axes)
    assert (load[5], behind[5], slip[5]) == pytest.approx((0.4, 1.0, 0.05))


def values(axes: Axes) -> list[Array]:
    """The curves of a panel, beside lines at the phases."""
    return [line.get_ydata() for line in axes.lines if len(line.get_ydata()) == 60]


def test_force_errors_are_measured_less_planned_of_those_that_touch() -> None:
    error, press = (values(axes) for axes in force_errors(run()).axes)
    assert error[0] == pytest.approx(np.full(60, 0.1))
    assert np.isnan(error[1]).all(), "finger 2 is free"
    assert press[0] == pytest.approx(np.full(60, 4.1))
    assert press[1] == pytest.approx(np.full(60, 4.0))


def test_the_true_error_of_the_object_is_beside_that_of_the_fingers() -> None:
    log = run()
    left, right = object_error(log).axes
    for axes, part in ((left, 0), (right, 1)):
        *fingers, true = values(axes)
        assert fingers[0] == pytest.approx(log.object_error[:, 0, part])
        assert true[1:] == pytest.approx(object_error_true(log)[part][1:])
    assert all(len(values(axes)) == 2 for axes in object_error(recorded(60)).axes)


def test_large_angles_are_told_as_small_ones_are() -> None:
    for angle in (1e-9, 1e-3, 1.0, 2.0, 3.0):
        log = run(k5={"object_rotation": exp_so3(np.array([0.0, angle, 0.0]))})
        assert object_error_true(log)[1][5] == pytest.approx(angle, rel=1e-6)
