"""``wbc run --view`` and ``wbc view``: what the viewer suffers never reaches the run."""

from __future__ import annotations

import os
import pty
import signal
import socket
import subprocess
import time

import pytest

from .shell import (
    COMMAND,
    PATIENCE,
    PHASES,
    SHORT,
    children,
    environment,
    finish,
    gone,
    start,
    wait_for_tick,
    wbc,
)

HALF = ("run", "planar_exchange", "--set", "simulation.duration=0.5")
VIEW = ("--view", "--no-browser")


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """A run without a view: (folder, bytes of its log)."""
    folder = tmp_path_factory.mktemp("alone")
    wbc(*HALF, "--out", ".", cwd=folder)
    return folder, (folder / "log.npz").read_bytes()


def test_a_view_does_not_change_the_run(alone, tmp_path):
    done = wbc(*HALF, *VIEW, "--out", ".", cwd=tmp_path)
    assert done.stdout.startswith("live view: http://127.0.0.1:")
    assert (tmp_path / "log.npz").read_bytes() == alone[1]


def test_a_viewer_killed_mid_run_does_not_change_the_run(alone, tmp_path):
    process = start(*HALF, *VIEW, "--out", ".", cwd=tmp_path)
    wait_for_tick(process)
    for viewer in children(process.pid):
        os.kill(viewer, signal.SIGKILL)
    _, errors = finish(process)
    assert process.returncode == 1
    assert errors.count("the live view is gone (ended by SIGKILL)") == 1
    assert (tmp_path / "log.npz").read_bytes() == alone[1]


def test_a_taken_port_means_the_next_one(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = wbc(
            "run", "planar_exchange", *SHORT, *VIEW, "--fast", "--port", str(port), cwd=tmp_path
        )
    first = done.stdout.splitlines()[0]
    assert f"port {port} is taken" in first
    assert f":{port}/" not in first
    assert done.returncode == 1
    assert done.stderr.count("live view") == 0


def test_a_view_plays_at_the_pace_of_the_clock(tmp_path):
    long = ("run", "planar_exchange", "--set", "simulation.duration=2", *VIEW)
    process = start(*long, cwd=tmp_path)
    wait_for_tick(process)
    began = time.monotonic()
    finish(process)
    assert time.monotonic() - began > 1.7
    process = start(*long, "--fast", cwd=tmp_path)
    finish(process)
    assert process.returncode == 1


def test_at_a_terminal_the_view_stays_until_enter(tmp_path):
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "run", "planar_exchange", *SHORT, *VIEW], cwd=tmp_path, stdin=theirs,
        env=environment(PYTHONUNBUFFERED="1"), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    os.close(theirs)
    assert process.stdout is not None
    told = iter(process.stdout.readline, "")
    assert any("Enter ends it (again: wbc view runs/planar_exchange)" in line for line in told)
    viewers = children(process.pid)
    assert viewers and process.poll() is None
    os.write(ours, b"\n")
    assert process.wait(PATIENCE) == 1, "the code of the run, not that of its view"
    os.close(ours)
    finish(process)
    assert gone(viewers)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["ctrl-c", "sigterm"])
def test_a_replay_ends_by_ctrl_c(alone, tmp_path, number):
    process = start("view", str(alone[0]), "--no-browser", cwd=tmp_path)
    assert process.stdout is not None
    assert "live view: http://127.0.0.1:" in process.stdout.readline()
    viewers = children(process.pid)
    process.send_signal(number)
    _, errors = finish(process)
    assert process.returncode == 0
    assert errors == ""
    assert gone(viewers)


def test_a_run_becomes_one_html_file_and_a_set_of_pictures(alone, tmp_path):
    done = wbc("view", str(alone[0] / "log.npz"), "--html", "run.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "run.html").read_text(encoding="utf-8")
    assert "planar_exchange" in page and PHASES[-1] in page
    done = wbc("plot", str(alone[0]), "--out", "pictures", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    names = {path.stem for path in (tmp_path / "pictures").glob("*.png")}
    assert {"object_error", "residuals", "tasks", "stack", "strip"} <= names


def test_a_log_without_its_folder_can_be_shown(alone, tmp_path):
    """The log carries its scenario, and the robot is found by its name."""
    (tmp_path / "mine.npz").write_bytes(alone[1])
    done = wbc("view", "mine.npz", "--html", "run.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_html_that_cannot_be_written(alone, tmp_path):
    done = wbc("view", str(alone[0]), "--html", "no/such/run.html", cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "cannot write" in done.stderr
