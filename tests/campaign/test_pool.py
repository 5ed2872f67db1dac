"""Processes that die: whose task is tried again or given up, and that no other is touched."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wbc.campaign.pool import in_processes
from wbc.campaign.trial import ATTEMPTS
from wbc.errors import WbcError

from . import work

ROOT = Path(__file__).resolve().parents[2]


def tasks(count: int, folder: Path) -> list[work.Task]:
    return [work.Task(number, folder) for number in range(count)]


def never() -> bool:
    return False


def gone(pid: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
    return True


def test_every_task_once_by_as_many_processes_as_asked_for(tmp_path: Path) -> None:
    done = list(in_processes(work.square, tasks(20, tmp_path), 2, never))
    assert sorted(task.number for task, _ in done) == list(range(20))
    assert all(result[0] == task.number**2 for task, result in done)
    pids = {result[1] for _, result in done}
    assert 1 <= len(pids) <= 2 and os.getpid() not in pids
    assert all(gone(pid) for pid in pids)


def test_a_process_is_replaced_before_its_memory_has_grown_too_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wbc.campaign.pool._LIFE", 3)
    done = list(in_processes(work.square, tasks(10, tmp_path), 1, never))
    assert [task.number for task, _ in done] == list(range(10))
    pids = [result[1] for _, result in done]
    assert [pids.count(pid) for pid in dict.fromkeys(pids)] == [3, 3, 3, 1]
    assert all(gone(pid) for pid in pids)


def test_what_kills_its_process_is_given_up_and_the_others_go_on(tmp_path: Path) -> None:
    done = {t.number: r for t, r in in_processes(work.dies, tasks(8, tmp_path), 2, never)}
    assert done == {n: None if n in (2, 4, 6) else n for n in range(8)}
    tried = [int(path.name.partition(".")[0]) for path in tmp_path.iterdir()]
    assert {n: tried.count(n) for n in range(8)} == {
        n: ATTEMPTS if n in (2, 4, 6) else 1 for n in range(8)
    }


def test_a_process_killed_once_costs_nothing(tmp_path: Path) -> None:
    done = {t.number: r for t, r in in_processes(work.dies_once, tasks(6, tmp_path), 1, never)}
    assert done == {n: n for n in range(6)}


def test_an_exception_is_a_death(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert [r for _, r in in_processes(work.raises, tasks(1, tmp_path), 1, never)] == [None]
    assert "not for the pool to judge" in capfd.readouterr().err


def test_a_process_has_one_thread_and_the_parent_keeps_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert [r for _, r in in_processes(work.threads, tasks(1, tmp_path), 1, never)] == ["1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_a_stop_ends_the_processes_at_once(tmp_path: Path) -> None:
    began = time.monotonic()
    results = in_processes(work.sleeps, tasks(4, tmp_path), 2, lambda: len(pids(tmp_path)) == 2)
    assert list(results) == []
    assert time.monotonic() - began < 30.0
    assert all(gone(pid) for pid in pids(tmp_path))


def pids(folder: Path) -> list[int]:
    return [int(path.name.partition(".")[2]) for path in folder.glob("pid.*")]


ORPHANS = """
import sys
from pathlib import Path
from campaign import work
from wbc.campaign.pool import in_processes
if __name__ == "__main__":
    folder = Path(sys.argv[1])
    list(in_processes(work.sleeps, [work.Task(n, folder) for n in range(2)], 2, lambda: False))
"""


def test_processes_do_not_outlive_the_one_that_started_them(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(ORPHANS)
    path = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
    parent = subprocess.Popen(
        [sys.executable, script, tmp_path], env={**os.environ, "PYTHONPATH": path}
    )
    until = time.monotonic() + 60.0
    while len(pids(tmp_path)) < 2 and time.monotonic() < until:
        time.sleep(0.05)
    assert len(pids(tmp_path)) == 2
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    until = time.monotonic() + 10.0
    while not all(gone(pid) for pid in pids(tmp_path)) and time.monotonic() < until:
        time.sleep(0.05)
    assert all(gone(pid) for pid in pids(tmp_path))


def test_processes_that_cannot_start_are_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    # a child cannot find this function: its module is nowhere on disk
    monkeypatch.setattr(work.square, "__module__", "campaign_nowhere")
    monkeypatch.setitem(sys.modules, "campaign_nowhere", work)
    with pytest.raises(WbcError, match="end as soon as they are started"):
        list(in_processes(work.square, tasks(3, tmp_path), 2, never))
    capfd.readouterr()


def test_ctrl_c_is_not_for_the_processes(tmp_path: Path) -> None:
    done = [r for _, r in in_processes(work.interrupts, tasks(3, tmp_path), 2, never)]
    assert sorted(n for n in done if n is not None) == [0, 1, 2]
