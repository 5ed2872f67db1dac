"""What a run says while it goes on: one line kept up to date, or a few plain ones, on stderr."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import TextIO, final

from wbc.compiled import COMPILED
from wbc.control.state import TickRecord

_ON_TERMINAL = 0.1
_PLAIN = 10.0
_PATIENCE = 2.5
_COMPILING = "compiling the kernels (once)..."
_LOADING = "loading..."


@final
class Progress:
    """Phase, time and residuals of the tick last seen, as often as a reader can use.

    On a terminal one line is written over again; elsewhere a line appears when a phase begins and
    every ten seconds.
    """

    def __init__(
        self, phase_names: tuple[str, ...], duration: float, stream: TextIO | None = None
    ) -> None:
        self._phases = phase_names
        self._duration = duration
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._next = 0.0
        self._phase = -1
        self._written = 0

    def tick(self, record: TickRecord) -> None:
        """Show a tick if it is time to."""
        now = time.monotonic()
        if now < self._next and (self._terminal or record.phase == self._phase):
            return
        self._next = now + (_ON_TERMINAL if self._terminal else _PLAIN)
        self._phase = record.phase
        self._show(self._line(record))

    def say(self, text: str) -> None:
        """A line of its own, above the one that is kept up to date."""
        self.clear()
        self._write(text + "\n")

    def clear(self) -> None:
        """Take the line away."""
        if self._written:
            self._write("\r" + " " * self._written + "\r")
            self._written = 0

    def _line(self, record: TickRecord) -> str:
        share = min(100.0, 100.0 * record.t / self._duration)
        line = f"{self._phases[record.phase]:<12} {record.t:6.2f} s {share:3.0f} %"
        if not len(record.mode):
            return line
        eps_f, eps_m = record.residuals
        return f"{line}   eps_f {eps_f:.1e}   eps_m {eps_m:.1e}"

    def _show(self, line: str) -> None:
        if not self._terminal:
            self._write(line + "\n")
            return
        self._write("\r" + line.ljust(self._written))
        self._written = max(self._written, len(line))

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):
            pass  # nobody reads; the run goes on


@final
class SlowNotice:
    """Says why, if what happens inside takes long enough for somebody to wonder."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._timer = threading.Timer(_PATIENCE, say, (_COMPILING if COMPILED else _LOADING,))
        self._timer.daemon = True

    def over(self) -> None:
        """What may take long is done."""
        self._timer.cancel()

    def __enter__(self) -> SlowNotice:
        self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.over()
