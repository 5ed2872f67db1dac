"""Runs under torques: what is recorded, read back, and what the summary makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.recording.runs import FORCE_META, META, planned, record, recorded
from wbc.control.force_control import TorqueStatus
from wbc.control.state import DynamicsRecord
from wbc.errors import WbcError
from wbc.recording import Log, Recorder, summarize
from wbc.recording.dynamic_facts import object_error_true
from wbc.recording.dynamic_plots import torques
from wbc.recording.log import DYNAMICS
from wbc.recording.plots import plot
from wbc.rotations import exp_so3

LIMITED = replace(META, tau_min=(-0.5, -0.5, -np.inf), tau_max=(0.5, 0.5, np.inf))


def moved(k: int, **changes: object) -> DynamicsRecord:
    """Tick k of a run under torques: finger 1 presses with 4 N, the object 2 mm off."""
    made = DynamicsRecord(
        tau=np.array([0.1, -0.2, 3.0]),
        force=np.array([[0.0, -4.1, 0.0], [0.0, 0.0, 0.0]]),
        plan=np.array([[0.0, -4.0, 0.0], [0.0, 0.0, 0.0]]),
        object_position=record(k).reference_position + np.array([0.0, 2e-3, 0.0]),
        object_rotation=exp_so3(np.array([0.0, 1e-3, 0.0])),
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


def test_a_run_under_torques_has_a_picture_of_them(tmp_path: Path) -> None:
    files = plot(run(), tmp_path)
    assert "torques.png" in {file.name for file in files}
    assert "torques.png" not in {file.name for file in plot(recorded(60), tmp_path / "ideal")}
    curves = [
        [line.get_ydata()[5] for line in axes.lines if len(line.get_ydata()) == 60]
        for axes in torques(run()).axes
    ]  # beside lines at the phases
    assert [curve[0] for curve in curves] == pytest.approx([2.0, 1.0, 4.1, 0.1, 0.4])
    assert curves[2][1] == pytest.approx(4.0)


def test_large_angles_are_told_as_small_ones_are() -> None:
    for angle in (1e-9, 1e-3, 1.0, 2.0, 3.0):
        log = run(k5={"object_rotation": exp_so3(np.array([0.0, angle, 0.0]))})
        assert object_error_true(log)[1][5] == pytest.approx(angle, rel=1e-6)
