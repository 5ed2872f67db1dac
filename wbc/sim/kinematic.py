"""The ideal robot: it is where it is told to be."""

from __future__ import annotations

from collections.abc import Iterator

from wbc.control.controller import Controller
from wbc.control.state import ControllerState, Measurement, TickRecord


def run(
    controller: Controller, state: ControllerState, ticks: int
) -> Iterator[tuple[TickRecord, ControllerState]]:
    """Step a controller on an ideal robot whose joints follow the commands exactly.

    Yields:
        Each tick's record and the state after it.
    """
    for _ in range(ticks):
        record, state = controller.step(state, Measurement(state.q))
        yield record, state
