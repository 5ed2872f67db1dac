"""``wbc run``: what it writes, says and returns."""

from __future__ import annotations

import json
import os
import pty
import subprocess

import numpy as np
import pytest

from .shell import CARRY, COMMAND, PATIENCE, PHASES, POSTURE, SHORT, arrays, environment, wbc

FIXED = {
    "t": "T", "q": "Tn", "v": "Tn", "joint_names": "n", "object_pose": "T7",
    "object_pose_ref": "T7", "object_error": "TN2", "contact_names": "N", "in_contact": "TN",
    "contact_points": "TN3", "contact_normals": "TN3", "task_names": "m", "in_stack": "Tm",
    "activation": "Tm", "task_error": "Tm", "eps_f": "T", "eps_m": "T", "cost": "T",
    "min_distance": "T", "phase": "T", "phase_names": "p", "status": "T",
}  # fmt: skip
"""Names and axes on which others build."""
SIZES = {"T": 100, "n": 14, "N": 4, "m": 5, "p": len(PHASES), "2": 2, "3": 3, "7": 7}


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A run of 100 ticks, in its default folder."""
    folder = tmp_path_factory.mktemp("short")
    return folder, wbc("run", "planar_exchange", *SHORT, cwd=folder)


def test_the_exchange_succeeds(tmp_path):
    done = wbc("run", "planar_exchange", "--out", "out/deep", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("planar_exchange: success\n")
    assert "written to out/deep: log.npz, summary.json" in done.stdout
    summary = json.loads((tmp_path / "out/deep/summary.json").read_text())
    assert summary["success"] is True and summary["reason"] == ""
    assert summary["complete"] is True and summary["seed"] == 0
    assert {"wbc", "pin", "numpy", "python"} <= set(summary["versions"])


def test_the_log_has_every_fixed_name_in_its_shape(short):
    log = arrays(short[0] / "runs/planar_exchange/log.npz")
    for name, axes in FIXED.items():
        assert log[name].shape == tuple(SIZES[a] for a in axes), name
    for name in ("in_contact", "in_stack"):
        assert log[name].dtype == np.bool_
    np.testing.assert_allclose(log["t"], 0.002 * np.arange(100), atol=1e-12)
    assert list(log["task_names"]) == ["object", "force", "moment", "dexterity", "palm"]


def test_a_run_cut_short_is_an_honest_failure(short):
    folder, done = short
    assert done.returncode == 1
    assert "no success: the run ended at 0.2 s in phase 'approach'" in done.stdout
    summary = json.loads((folder / "runs/planar_exchange/summary.json").read_text())
    assert summary["success"] is False
    assert "ended at 0.2 s" in summary["reason"]
    assert summary["ticks"] == 100


@pytest.mark.parametrize("stiff", ["pad_damping=1e9", "joint_damping={'*': 1e6}"])
def test_physics_that_diverges_is_a_failure_with_a_name_and_a_log(tmp_path, stiff):
    given = ("--set", f"simulation.physics.{stiff}", "--set", "simulation.duration=0.1s")
    done = wbc("run", "planar_exchange_dynamic", *given, cwd=tmp_path)
    assert done.returncode == 1 and "internal error" not in done.stderr, done.stderr
    folder = tmp_path / "runs/planar_exchange_dynamic"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["success"] is False and summary["failure"] == "diverged"
    assert 0.0 < summary["failure_t"] < 0.1
    log = arrays(folder / "log.npz")
    assert len(log["t"]) == 50 and np.isfinite(log["q"]).all()
    assert np.isnan(log["q_meas"][-1]).all()


def test_off_a_terminal_progress_is_a_few_plain_lines(short):
    lines = short[1].stderr.splitlines()
    assert "\r" not in short[1].stderr
    assert 1 <= len([line for line in lines if "eps_f" in line]) <= 5
    assert "Traceback" not in short[1].stderr


def test_on_a_terminal_one_line_is_kept_up_to_date(tmp_path):
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "run", "planar_exchange", *SHORT], cwd=tmp_path, env=environment(),
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=theirs,
    )  # fmt: skip
    os.close(theirs)
    told = b""
    while True:
        try:
            piece = os.read(ours, 4096)
        except OSError:  # the terminal's other end is closed
            break
        if not piece:
            break
        told += piece
    os.close(ours)
    assert process.wait(PATIENCE) == 1
    lines = told.replace(b"compiling the kernels (once)...\r\n", b"")
    assert b"\n" not in lines
    assert lines.count(b"\r") >= 2
    assert lines.endswith(b" \r"), "the line was not taken away at the end"


def test_the_same_run_from_another_folder_is_bit_identical(short, tmp_path):
    wbc("run", "planar_exchange", *SHORT, "--out", ".", cwd=tmp_path)
    first = (short[0] / "runs/planar_exchange/log.npz").read_bytes()
    assert first == (tmp_path / "log.npz").read_bytes()


def test_a_run_is_its_own_scenario(tmp_path):
    """What was set is kept: the saved scenario runs to the same arrays."""
    wbc("run", "planar_exchange", *SHORT, "--set", CARRY, "--out", "a", cwd=tmp_path)
    wbc("run", "a/scenario.yaml", "--out", "b", cwd=tmp_path)
    first, second = arrays(tmp_path / "a/log.npz"), arrays(tmp_path / "b/log.npz")
    assert list(first["phase_names"]) == ["carry"]
    for name in set(first) - {"meta"}:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)


def test_a_scenario_without_object_and_phases_runs_to_its_end(tmp_path):
    (tmp_path / "posture.yaml").write_text(POSTURE)
    done = wbc("run", "posture.yaml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("posture: success\n")
    log = arrays(tmp_path / "out/log.npz")
    assert log["object_error"].shape == (50, 0, 2)
    assert log["task_error"][-1, 0] < log["task_error"][0, 0]


def test_seed_and_pace(tmp_path):
    done = wbc(
        "run", "planar_exchange", "--set", "simulation.duration=0.5", "--seed", "3", "--realtime",
        "--out", "a", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 1
    assert json.loads((tmp_path / "a/summary.json").read_text())["seed"] == 3
