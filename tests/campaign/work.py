"""What workers are given in tests: functions that a process of its own can import."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import NamedTuple


class Task(NamedTuple):
    """A number, and a folder where deaths are counted."""

    number: int
    folder: Path


def square(task: Task) -> tuple[int, int]:
    return task.number**2, os.getpid()


def dies(task: Task) -> int:
    """Number 2 aborts its process, 4 leaves it, 6 is killed; each time."""
    with open(task.folder / f"{task.number}.{time.monotonic_ns()}", "w"):
        pass
    if task.number == 2:
        os.abort()
    if task.number == 4:
        os._exit(0)
    if task.number == 6:
        os.kill(os.getpid(), signal.SIGKILL)
    return task.number


def dies_once(task: Task) -> int:
    """Number 3 takes its process with it when it is first tried."""
    mark = task.folder / "tried"
    if task.number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return task.number


def raises(task: Task) -> int:
    raise RuntimeError("not for the pool to judge")


def threads(task: Task) -> str | None:
    return os.environ.get("OMP_NUM_THREADS")


def sleeps(task: Task) -> int:
    (task.folder / f"pid.{os.getpid()}").touch()
    time.sleep(60.0)
    return task.number


def interrupts(task: Task) -> int:
    """Ctrl-C reaches the processes of a terminal, too."""
    os.kill(os.getpid(), signal.SIGINT)
    return task.number
