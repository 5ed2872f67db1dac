"""Ctrl-C and SIGTERM at any moment: the code says so, and what there is can be read."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from wbc.recording import Log

from .shell import children, environment, finish, gone, start, wait_for_tick

RUN = ("run", "planar_exchange", "--realtime", "--out", "out")


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["ctrl-c", "sigterm"]
)
def test_a_signal_mid_run_leaves_a_readable_log(tmp_path, number, code):
    process = start(*RUN, cwd=tmp_path)
    wait_for_tick(process)
    time.sleep(0.7)
    process.send_signal(number)
    out, errors = finish(process)
    assert process.returncode == code, errors
    assert "Traceback" not in errors
    assert "no success: interrupted" in out
    log = Log.load(tmp_path / "out/log.npz")
    assert not log.complete
    assert 10 < log.ticks < 2250
    assert np.isfinite(log.q).all()
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["success"] is False
    assert summary["interrupted"] is True
    assert summary["reason"].startswith("interrupted")
    assert summary["ticks"] == log.ticks


@pytest.mark.parametrize("delay", [0.3, 0.8, 1.2])
def test_a_signal_before_the_first_tick_is_no_traceback(tmp_path, delay):
    process = start(*RUN, cwd=tmp_path)
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, errors = finish(process)
    # interrupted while a library runs code of its own, Python ends by the signal itself: to a
    # shell that is 130 as well
    assert process.returncode in (130, -signal.SIGINT)
    assert "Traceback" not in errors
    left = list((tmp_path / "out").glob("*.npz")) if (tmp_path / "out").exists() else []
    assert all(Log.load(path).complete is False for path in left)


def test_ctrl_c_while_the_kernels_are_compiled(tmp_path):
    """A machine that has no compiled kernels yet: it is told what takes long, and may give up."""
    pytest.importorskip("numba")
    process = start(*RUN, cwd=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert process.stderr is not None
    assert process.stderr.readline() == "compiling the kernels (once)...\n"
    process.send_signal(signal.SIGTERM)
    _, errors = finish(process)
    assert process.returncode == 143
    assert "Traceback" not in errors


SWALLOWS = """
import signal
from wbc.cli.interrupt import Interrupts
compiler = {"__name__": "llvmlite.binding", "signal": signal}
exec(
    "def compile():\\n"
    "    try: signal.raise_signal(signal.SIGTERM)\\n"
    "    except BaseException: print('lost')",
    compiler,
)
with Interrupts(owns_process=OWNER):
    compiler["compile"]()
"""


@pytest.mark.parametrize("owner", [True, False])
def test_a_compiler_that_would_lose_the_exception_is_not_given_one(tmp_path, owner):
    source = SWALLOWS.replace("OWNER", str(owner))
    process = subprocess.run(
        [sys.executable, "-c", source], cwd=tmp_path, env=environment(), capture_output=True,
        text=True, timeout=60,
    )  # fmt: skip
    ended = (process.returncode, process.stdout, process.stderr)
    assert ended == ((143, "", "interrupted\n") if owner else (0, "lost\n", ""))


def test_an_impatient_user_still_gets_the_log(tmp_path):
    process = start(*RUN, cwd=tmp_path)
    wait_for_tick(process)
    for _ in range(5):
        process.send_signal(signal.SIGINT)
        time.sleep(0.002)
    _, errors = finish(process)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert Log.load(tmp_path / "out/log.npz").ticks >= 1


def test_the_viewer_ends_with_an_interrupted_run(tmp_path):
    process = start(*RUN, "--view", "--no-browser", "--port", "7360", cwd=tmp_path)
    wait_for_tick(process)
    viewers = children(process.pid)
    assert viewers
    process.send_signal(signal.SIGINT)
    finish(process)
    assert process.returncode == 130
    assert gone(viewers)
