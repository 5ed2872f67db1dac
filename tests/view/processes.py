"""What the tests of the live view ask the kernel about its process (Linux only)."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path


def wait_until(condition: Callable[[], bool], timeout: float = 20.0) -> bool:
    until = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


def listening(pid: int) -> list[str]:
    """Hexadecimal `address:port` of every TCP socket the process listens on, v4 and v6."""
    inodes = set()
    for entry in os.listdir(f"/proc/{pid}/fd"):
        try:
            target = os.readlink(f"/proc/{pid}/fd/{entry}")
        except OSError:
            continue
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    found = []
    for table in ("tcp", "tcp6"):
        path = Path(f"/proc/{pid}/net/{table}")
        if not path.exists():
            continue
        for line in path.read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and words[9] in inodes:
                found.append(words[1])
    return found


def running(pid: int) -> bool:
    """False also for a process that has ended and was not yet collected."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rsplit(")", 1)[1].split()[0] not in "ZX"


def shared_maps() -> int:
    """Mapped regions of this process that belong to a slot."""
    return Path("/proc/self/maps").read_text().count("memfd:wbc-view")


def open_files() -> int:
    return len(os.listdir("/proc/self/fd"))
