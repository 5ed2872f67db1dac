"""Running wbc as a process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wbc.scenario import load

ROOT = Path(__file__).resolve().parents[2]
COMMAND = (sys.executable, "-m", "wbc")
SHORT = ("--set", "simulation.duration=0.2")
PATIENCE = 240.0  # the kernels may have to be compiled first

PHASES = tuple(phase.name for phase in load("planar_exchange").scenario.phases)

CARRY = (
    "phases=[{name: carry, contacts: {f1: fixed, f2: fixed}, tasks: [dexterity], over: 4 s, "
    "object: {target: {position: [0.3, 0.2], angle: 30 deg}, relative: true}, until: {time: 4 s}}]"
)
"""A setting of planar_exchange under which the object moves."""

POSTURE = """\
name: posture
robot: {urdf: planar_gripper}
tasks: {rest: {type: posture, gain: 2 /s, target: {'*': 10 deg}}}
stack: {priority: [rest]}
simulation: {duration: 0.1 s, step: 2 ms}
"""
"""A scenario without object, costs and phases."""


def environment(**more: str) -> dict[str, str]:
    """This process's, with the checkout on the path and nothing that changes how wbc behaves."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("WBC_")}
    return {**kept, "PYTHONPATH": str(ROOT), **more}


def wbc(*arguments: str, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        [*COMMAND, *arguments], cwd=cwd, env=environment(**more), stdin=subprocess.DEVNULL,
        capture_output=True, text=True, timeout=PATIENCE,
    )  # fmt: skip


def start(*arguments: str, cwd: Path, **more: str) -> subprocess.Popen[str]:
    """A command that goes on; its output is unbuffered."""
    return subprocess.Popen(
        [*COMMAND, *arguments], cwd=cwd, env=environment(PYTHONUNBUFFERED="1", **more),
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def finish(process: subprocess.Popen[str]) -> tuple[str, str]:
    """The rest of its output and errors."""
    try:
        return process.communicate(timeout=PATIENCE)
    finally:
        process.kill()


def wait_for_tick(process: subprocess.Popen[str]) -> None:
    """Until its first line of progress is out: the run is under way."""
    assert process.stderr is not None
    while line := process.stderr.readline():
        if "eps_f" in line:
            return
    raise AssertionError(f"the run ended before its first tick, code {process.poll()}")


def children(pid: int) -> list[int]:
    """Processes whose parent is `pid` (Linux)."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdecimal():
            try:
                stat = Path(f"/proc/{entry}/stat").read_text()
            except OSError:
                continue
            state, parent = stat.rsplit(")", 1)[1].split()[:2]
            if int(parent) == pid and state not in "ZX":
                found.append(int(entry))
    return found


def gone(pids: Sequence[int], timeout: float = 10.0) -> bool:
    """Whether none of the processes runs any more, within the timeout."""
    until = time.monotonic() + timeout
    while any(_runs(pid) for pid in pids):
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


def _runs(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rsplit(")", 1)[1].split()[0] not in "ZX"


def arrays(path: Path) -> dict[str, np.ndarray]:
    """Everything in a log, read without unpickling."""
    with np.load(path, allow_pickle=False) as found:
        return {name: found[name] for name in found.files}
