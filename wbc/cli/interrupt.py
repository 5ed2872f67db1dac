"""Ctrl-C and SIGTERM during a run: the tick at hand is finished, then the run ends."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any, final

_WATCHED = (signal.SIGINT, signal.SIGTERM)


@final
class Interrupts:
    """Collects signals while it is entered.

    Before `ticking` is set there is no tick to finish, so a signal raises KeyboardInterrupt, with
    its number, at once; while ticking only a second one does. Once `saving` is set nothing does:
    the files are written.

    Attributes:
        ticking, saving: what the run is at.
        received: the first signal, 0 before it.
    """

    def __init__(self) -> None:
        self.ticking = False
        self.saving = False
        self.received = 0
        self._before: list[Any] = []

    @property
    def exit_code(self) -> int:
        """By the shell's custom: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + self.received

    def __enter__(self) -> Interrupts:
        self._before = [signal.signal(number, self._receive) for number in _WATCHED]
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in zip(_WATCHED, self._before, strict=True):
            signal.signal(number, before)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        again = self.received != 0
        self.received = self.received or number
        if not self.saving and (again or not self.ticking):
            raise KeyboardInterrupt(self.received)
