"""Ctrl-C and SIGTERM: a command ends at once, but a run finishes its tick and writes its files."""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType
from typing import Any, final

_WATCHED = (signal.SIGINT, signal.SIGTERM)
_COMPILERS = ("numba", "llvmlite")


@final
class Interrupts:
    """Receives signals while it is entered.

    A signal raises KeyboardInterrupt with its number; while a run is ticking only a second one
    does, and while its files are written none does. Some libraries lose the exception when it
    meets them as they are imported, hence `check`.

    An exception thrown into the compiler of the kernels may be lost, be taken for a fault or bring
    the process down later: a process told to end meanwhile ends on the spot. It has no results yet,
    kernels that are done are kept, and the viewer goes when the process is gone.

    A command that owns its process and was told to end ignores what comes after: Python, on its
    way out, would otherwise be killed by it and the exit code lost.

    Attributes:
        owns_process: the process ends with the command.
        ticking, saving: what a run is at.
        received: the first signal, 0 before it.
    """

    def __init__(self, *, owns_process: bool) -> None:
        self.owns_process = owns_process
        self.ticking = False
        self.saving = False
        self.received = 0
        self._before: list[tuple[signal.Signals, Any]] = []

    @property
    def exit_code(self) -> int:
        """By the shell's custom: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + self.received

    def check(self) -> None:
        """Raise now what was received before."""
        if self.received:
            raise KeyboardInterrupt(self.received)

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():  # no other may set handlers
            self._before = [(n, signal.signal(n, self._receive)) for n in _WATCHED]
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before:
            ended = self.owns_process and self.received
            signal.signal(number, signal.SIG_IGN if ended else before)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        again = self.received != 0
        self.received = self.received or number
        if not self.saving and (again or not self.ticking):
            if self.owns_process and _compiling(frame):
                print("interrupted", file=sys.stderr, flush=True)
                sys.stdout.flush()
                os._exit(self.exit_code)
            raise KeyboardInterrupt(self.received)


def _compiling(frame: FrameType | None) -> bool:
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in _COMPILERS:
            return True
        frame = frame.f_back
    return False
