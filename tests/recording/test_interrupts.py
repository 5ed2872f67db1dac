"""Runs that are stopped from outside, as real processes: what was recorded can be read."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wbc.recording import Log

RUN = """
import sys
from tests.recording.runs import META, record
from wbc.recording import Recorder

recorder = Recorder(META, capacity_hint=16)
k = 0
try:
    while True:
        recorder.append(record(k))
        k += 1
        if k == 1:
            print("running", flush=True)
        if {every} and k % {every} == 0:
            recorder.save_partial(sys.argv[1])
except KeyboardInterrupt:
    recorder.finish(complete=False).save(sys.argv[1])
    sys.exit(130)
"""


def start(path: Path, every: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", RUN.format(every=every), path],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def wait_for(path: Path, process: subprocess.Popen[bytes]) -> None:
    """Until the first partial log is there."""
    deadline = time.monotonic() + 60.0
    while not path.exists():
        assert process.poll() is None, process.stderr
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.mark.parametrize("delay", [0.0, 0.011, 0.023, 0.04, 0.083])
def test_a_killed_run_leaves_its_last_partial_log(tmp_path: Path, delay: float) -> None:
    path = tmp_path / "log.npz"
    process = start(path, every=25)
    try:
        wait_for(path, process)
        time.sleep(delay)  # somewhere in an append, a write or a rename
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
    log = Log.load(path)
    assert log.ticks >= 25 and log.ticks % 25 == 0 and not log.complete
    # a kill in the middle of a write leaves at most the part of that one write
    assert len(os.listdir(tmp_path)) <= 2


def test_an_interrupted_run_leaves_all_its_ticks(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    process = start(path, every=0)
    assert process.stdout is not None and process.stdout.readline() == b"running\n"
    time.sleep(0.05)
    os.kill(process.pid, signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    log = Log.load(path)
    assert not log.complete and log.ticks > 0
    assert log.t[-1] == pytest.approx((log.ticks - 1) * log.meta.dt)


@pytest.fixture
def small_disk(tmp_path: Path) -> Path:
    """A file system of 128 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=128k", "none", str(place)]
    try:
        done = subprocess.run(command, capture_output=True)
    except FileNotFoundError:
        pytest.skip("no mount here")
    if done.returncode:
        pytest.skip("mounting is not allowed here")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_full_disk_keeps_the_last_log_that_fitted(small_disk: Path) -> None:
    path = small_disk / "log.npz"
    process = start(path, every=20)
    _, stderr = process.communicate(timeout=60)
    last = stderr.decode().strip().splitlines()[-1]
    assert last == f"wbc.errors.WbcError: cannot write '{path}': No space left on device"
    log = Log.load(path)
    assert log.ticks > 0 and log.ticks % 20 == 0
    assert os.listdir(small_disk) == ["log.npz"]
