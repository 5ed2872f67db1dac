"""The log: what goes in comes out, the same bytes for the same run, whole files only."""

from __future__ import annotations

import io
import json
import os
import resource
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wbc.errors import WbcError
from wbc.recording import Log, Recorder, RunMeta, installed_versions
from wbc.recording.log import DYNAMICS, FORCES, LAYOUT
from wbc.rotations import rotation_from_quaternion
from wbc.stack.limits import Limited

from .runs import (
    DT,
    FORCE_META,
    META,
    planned,
    record,
    recorded,
    removed_and_back,
    with_forces,
)


def assert_same(one: Log, two: Log) -> None:
    for name, (kind, _) in LAYOUT.items():
        a, b = getattr(one, name), getattr(two, name)
        if kind is np.str_:
            assert a == b, name
        else:
            assert a.dtype == b.dtype and a.shape == b.shape, name
            np.testing.assert_array_equal(a, b, err_msg=name)
    assert one.meta == two.meta and one.complete == two.complete


def test_every_field_of_a_record_is_in_the_log() -> None:
    limited = Limited(0.5, 0.25, 0.75, True, 2)
    log = recorded(70, {**removed_and_back(), 3: {"limited": limited}})
    r = record(55)
    assert log.ticks == 70 and log.t[55] == r.t
    for name in ("q", "v", "object_error", "contact_points", "contact_normals", "freedom"):
        np.testing.assert_array_equal(getattr(log, name)[55], getattr(r, name))
    assert (log.eps_f[55], log.eps_m[55]) == r.residuals
    assert (log.cost[55], log.min_distance[55]) == (r.cost, r.min_distance)
    assert (log.phase[55], log.status[55], log.independence[55]) == (1, 0, 0.5)
    assert log.in_contact[[49, 50]].tolist() == [[True, False], [True, True]]
    assert log.contact_mode[55].tolist() == [1, 2]
    stages = (log.limit_secondary, log.limit_main, log.limit_change, log.limit_clipped)
    assert (*(x[3] for x in stages), log.limit_joint[3]) == tuple(limited)
    assert log.limit_joint[4] == -1


def test_planned_forces_are_in_the_log(tmp_path: Path) -> None:
    log, f = with_forces(70), planned(55)
    assert log.plans_forces and log.contact_force_plan.shape == (70, 2, 3)
    for name, want in (
        ("contact_force_plan", f.force), ("contact_spin_plan", f.spin), ("tau_plan", f.torque),
        ("cone_margin", f.cone_margin), ("torque_margin", f.torque_margin),
        ("wrench_plan", f.wrench), ("object_mass", f.mass), ("object_com", f.com),
        ("force_status", f.status), ("force_iterations", f.iterations), ("phi", f.phi),
        ("sum_normal", f.sum_normal),
    ):  # fmt: skip
        np.testing.assert_array_equal(getattr(log, name)[55], want, err_msg=name)
    assert np.isnan(log.cone_margin[49, 1]) and log.torque_margin[0, 2] == np.inf
    for name in ("a.npz", "b.npz"):
        with_forces(70).save(tmp_path / name)
    assert_same(Log.load(tmp_path / "a.npz"), log)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert RunMeta.from_json(FORCE_META.to_json()) == FORCE_META


def test_without_planned_forces_their_arrays_have_no_row() -> None:
    log = recorded(5)
    assert not log.plans_forces
    assert (log.contact_force_plan.shape, log.tau_plan.shape) == ((0, 2, 3), (0, 3))


def test_forces_are_planned_in_every_tick_or_in_none() -> None:
    recorder = Recorder(FORCE_META)
    recorder.append(record(0, forces=planned(0)))
    with pytest.raises(ValueError, match="in every tick of a run, or in none"):
        recorder.append(record(1))
    with pytest.raises(ValueError, match="meta names no contact models"):
        Recorder(META).append(record(0, forces=planned(0)))
    with pytest.raises(ValueError, match=r"record\.forces\.spin has shape \(3,\), expected \(2,\)"):
        Recorder(FORCE_META).append(record(0, forces=planned(0)._replace(spin=np.zeros(3))))


def test_a_log_from_before_forces_could_be_planned_is_read(tmp_path: Path) -> None:
    log = recorded(60, removed_and_back())
    log.save(tmp_path / "log.npz")
    with np.load(tmp_path / "log.npz") as data:
        later = (*FORCES, *DYNAMICS)
        arrays = {name: data[name] for name in data.files if name not in later}
    meta = json.loads(META.to_json())
    for name in ("tau_min", "tau_max", "mu", "mu_t", "contact_models"):
        del meta[name]
    arrays.update(format=np.array(1), meta=np.array(json.dumps(meta)))
    np.savez(tmp_path / "old.npz", **arrays)
    assert_same(Log.load(tmp_path / "old.npz"), log)


def test_the_main_task_comes_first_and_tips_stand_apart() -> None:
    log = recorded(70)
    assert log.task_names == ("object", "force", "posture")
    assert log.in_stack[:, 0].all() and (log.activation[:, 0] == 1.0).all()
    assert log.task_error[10, 0] == record(10).object_error[0, 0]  # finger 2 is free: not NaN
    assert log.task_error[60, 0] == 2e-3  # the worst of two
    np.testing.assert_array_equal(log.task_error[60, 1:], record(60).task_error[:2])
    np.testing.assert_array_equal(log.in_stack[60, 1:], [True, True])
    assert log.tip_task_names == ("tip_f1", "tip_f2")
    np.testing.assert_array_equal(log.tip_task_error[60], [0.01, 0.02])
    np.testing.assert_array_equal(log.tip_in_stack[[0, 60]], [[False, True], [False, False]])


def test_without_a_main_task_nothing_stands_before_the_others() -> None:
    log = recorded(40, removed_and_back(), replace(META, main_task=None, task_units=()))
    assert log.task_names == ("force", "posture") and log.task_error.shape == (40, 2)
    assert log.event_task.tolist() == [0]


def test_no_finger_in_contact_leaves_the_main_error_open() -> None:
    log = recorded(2, {1: {"object_error": np.full((2, 2), np.nan)}})
    assert np.isnan(log.task_error[1, 0]) and np.isfinite(log.task_error[0, 0])


def test_events_name_tasks_of_the_log() -> None:
    log = recorded(70, removed_and_back())
    assert log.event_t.tolist() == [30 * DT, 60 * DT]
    assert [log.all_task_names[k] for k in log.event_task] == ["force", "force"]
    assert log.event_inserted.tolist() == [False, True]
    assert log.event_cost.tolist() == [0.06, 0.01]


def test_poses_turn_without_a_jump_of_sign() -> None:
    log = recorded(100)
    for k in (0, 42, 99):
        got = rotation_from_quaternion(log.object_pose[k, 3:])
        np.testing.assert_allclose(got, record(k).object_rotation, atol=1e-14)
        np.testing.assert_array_equal(log.object_pose[k, :3], record(k).object_position)
    assert np.abs(np.diff(log.object_pose[:, 3:], axis=0)).max() < 0.1
    np.testing.assert_allclose(log.object_pose_ref[5], [0.005, 0, 0, 0, 0, 0, 1], atol=1e-15)


def test_a_record_may_be_reused_after_it_was_appended() -> None:
    recorder, r = Recorder(META), record(0)
    recorder.append(r)
    r.q[:] = 99.0
    assert recorder.finish().q[0, 0] == 0.0


def test_a_record_of_another_robot_is_refused() -> None:
    with pytest.raises(ValueError, match=r"record\.q has shape \(2,\), expected \(3,\)"):
        Recorder(META).append(record(0, q=np.zeros(2)))
    recorder = Recorder(META)
    recorder.append(record(0))
    with pytest.raises(ValueError):
        recorder.append(record(1, q=np.zeros(2)))
    assert len(recorder) == 1


def test_a_log_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        recorded(3).q[0, 0] = 1.0


@pytest.mark.parametrize("ticks", [0, 1, 70])
def test_saved_and_loaded_is_the_same(tmp_path: Path, ticks: int) -> None:
    log = recorded(ticks, removed_and_back(), complete=False)
    assert log.save(tmp_path / "new" / "log.npz") == tmp_path / "new" / "log.npz"
    assert_same(Log.load(tmp_path / "new" / "log.npz"), log)
    assert os.listdir(tmp_path / "new") == ["log.npz"]


def test_numpy_alone_reads_every_array_without_pickle(tmp_path: Path) -> None:
    log = recorded(60, removed_and_back())
    log.save(tmp_path / "log.npz")
    with np.load(tmp_path / "log.npz", allow_pickle=False) as data:
        assert set(data.files) == {"format", "meta", "complete", *LAYOUT}
        for name in data.files:
            assert data[name].dtype.kind in "fibU"
        np.testing.assert_array_equal(data["q"], log.q)
        assert data["task_names"].tolist() == ["object", "force", "posture"]
        assert RunMeta.from_json(str(data["meta"])) == META


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        recorded(60, removed_and_back()).save(tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {e.date_time for e in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_another_process_on_another_day_gives_the_same_bytes(tmp_path: Path) -> None:
    recorded(60, removed_and_back()).save(tmp_path / "here.npz")
    code = (
        "import sys, time; time.time = lambda: 2e9\n"
        "from tests.recording.runs import recorded, removed_and_back\n"
        "recorded(60, removed_and_back()).save(sys.argv[1])\n"
    )
    env = {**os.environ, "TZ": "Pacific/Kiritimati", "PYTHONHASHSEED": "5"}
    subprocess.run([sys.executable, "-c", code, tmp_path / "there.npz"], check=True, env=env)
    assert (tmp_path / "here.npz").read_bytes() == (tmp_path / "there.npz").read_bytes()


def test_the_hash_is_that_of_the_text() -> None:
    assert len(META.scenario_hash) == 64
    assert replace(META, scenario_text="x").scenario_hash != META.scenario_hash
    assert replace(META, seed=8).scenario_hash == META.scenario_hash
    assert {"python", "numpy", "wbc"} <= set(installed_versions())


def test_infinite_limits_survive_strict_json() -> None:
    assert "Infinity" not in META.to_json()
    assert RunMeta.from_json(META.to_json()) == META


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf])
def test_a_tick_of_no_length_is_refused(dt: float) -> None:
    with pytest.raises(WbcError, match="dt must be positive"):
        replace(META, dt=dt)


def test_limits_of_another_robot_are_refused() -> None:
    with pytest.raises(WbcError, match="q_lower has 1 entries, expected 3"):
        replace(META, q_lower=(0.0,))


def test_partial_saves_replace_one_another(tmp_path: Path) -> None:
    path, recorder = tmp_path / "log.npz", Recorder(META)
    for k in range(40):
        recorder.append(record(k))
        if k % 10 == 9:
            recorder.save_partial(path)
            assert Log.load(path).ticks == k + 1 and not Log.load(path).complete
    assert os.listdir(tmp_path) == ["log.npz"]


def test_a_device_is_neither_written_nor_replaced() -> None:
    before = os.stat("/dev/full")
    with pytest.raises(WbcError, match="cannot write '/dev/full': it is not a regular file"):
        recorded(3).save("/dev/full")
    after = os.stat("/dev/full")
    assert (before.st_ino, before.st_mode) == (after.st_ino, after.st_mode)


@pytest.mark.parametrize("bad", ["in_the_way/log.npz", "folder", "nul\0.npz", "x" * 300, "loop/l"])
def test_places_that_cannot_be_written_are_one_line(tmp_path: Path, bad: str) -> None:
    (tmp_path / "in_the_way").write_text("a file")
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(WbcError, match=r"\Acannot write '.*': .+\Z"):
        recorded(3).save(os.path.join(tmp_path, bad))
    assert sorted(os.listdir(tmp_path)) == ["folder", "in_the_way", "loop"]


@pytest.mark.skipif(os.geteuid() == 0, reason="permissions do not stop root")
def test_a_folder_without_permission_is_one_line(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(WbcError, match=r"\Acannot write '.*': Permission denied\Z"):
        recorded(3).save(tmp_path / "log.npz")


def test_a_link_keeps_pointing(tmp_path: Path) -> None:
    (tmp_path / "real.npz").write_bytes(b"old")
    (tmp_path / "link.npz").symlink_to(tmp_path / "real.npz")
    recorded(3).save(tmp_path / "link.npz")
    assert (tmp_path / "link.npz").is_symlink() and Log.load(tmp_path / "real.npz").ticks == 3


def test_no_space_leaves_the_old_log_and_no_debris(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.npz"
    recorded(5).save(path)
    long = recorded(2000)
    # the size limit of a process: writes fail in the middle of the file, as on a full disk
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(WbcError, match=r"\Acannot write '.*log\.npz': File too large\Z"):
            long.save(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert Log.load(path).ticks == 5
    assert os.listdir(tmp_path) == ["log.npz"]
    assert capfd.readouterr().err == ""


def test_no_space_found_only_on_the_way_to_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WbcError, match=r"\Acannot write '.*': No space left on device\Z"):
        recorded(5).save(tmp_path / "log.npz")
    assert os.listdir(tmp_path) == []


def test_a_log_needs_no_more_than_its_arrays(tmp_path: Path) -> None:
    """Rewritten by NumPy, packed, with an array of somebody else's in it: still a log."""
    log = recorded(60)
    log.save(tmp_path / "log.npz")
    with np.load(tmp_path / "log.npz") as data:
        arrays = {name: data[name] for name in data.files}
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays, note=np.array("mine"))
    (tmp_path / "packed.npz").write_bytes(packed.getvalue())
    assert_same(Log.load(tmp_path / "packed.npz"), log)
