"""Both stages in one tick: what is measured goes in, the torques to be held come out."""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array
from wbc.control.controller import Controller
from wbc.control.force_control import Command, ForceControl, Goal, TorqueState
from wbc.control.set_points import SetPoints
from wbc.control.state import ControllerState, DynamicsRecord, Measurement, TickRecord

_BRIDGED = 5
"""Ticks without joint positions after which the first stage is told, and brakes at once: a
reference that stops and starts within a tick asks more of the joints than a gap of some ticks."""


class LoopState(NamedTuple):
    """What both stages carry from tick to tick.

    Attributes:
        first: of the first stage.
        second: of the second.
        blind: ticks in a row without joint positions.
    """

    first: ControllerState
    second: TorqueState
    blind: int


class LoopTick(NamedTuple):
    """A tick's outcome.

    Attributes:
        record: ready for the log. Joints and forces in it are as measured, NaN where they are not;
            where the object truly is and how far contacts have slid is not known here: NaN.
        command: the torques to be held until the next tick.
        goal: what the second stage followed.
    """

    record: TickRecord
    command: Command
    goal: Goal


@final
class TorqueController:
    """First stage, set points and second stage as one controller of a robot driven by torques.

    ``state = control.init(start)``, then ``tick, state = control.step(state, measurement)`` once
    per tick; ``tick.command.tau`` is what the joints are to be given. As with `Controller`, the
    state is a value, and there are no threads, no clock and no files.

    Attributes:
        first, second, set_points: the parts.
    """

    def __init__(self, first: Controller, second: ForceControl, set_points: SetPoints) -> None:
        """
        Args:
            set_points: planned forces where no optimizer plans them.
        """
        self.first = first
        self.second = second
        self.set_points = set_points

    def init(self, start: ControllerState) -> LoopState:
        """State before the first tick.

        Args:
            start: of the first stage: `Controller.init`, or the `start` of a scenario's assembly.
        """
        return LoopState(start, self.second.init(), 0)

    def step(self, state: LoopState, measurement: Measurement) -> tuple[LoopTick, LoopState]:
        """One tick. Never raises on numbers: what gave way is in the record's statuses."""
        blind = 0 if np.isfinite(measurement.q).all() else state.blind + 1
        bridged = 0 < blind <= _BRIDGED  # the second stage holds its torques, the references go on
        seen = measurement._replace(q=state.first.q) if bridged else measurement
        record, first = self.first.step(state.first, seen)
        goal = self._goal(record, first, measurement.force)
        command, second = self.second.step(state.second, goal, measurement, self.first.settings.dt)
        tick = LoopTick(_logged(record, command, goal, measurement), command, goal)
        return tick, LoopState(first, second, blind)

    def _goal(self, record: TickRecord, state: ControllerState, found: Array | None) -> Goal:
        """What the second stage is to follow in this tick."""
        if record.forces is not None:
            force = record.forces.force
        else:
            force = self.set_points.at(record, state.phase.motion, found)
        arms = record.contact_points - record.object_position
        return Goal(record.q, record.v, record.mode, arms, record.contact_normals, force)


def _logged(record: TickRecord, command: Command, goal: Goal, measured: Measurement) -> TickRecord:
    """The record with what was measured and commanded."""
    q, force = record.q, goal.force
    return record._replace(dynamics=DynamicsRecord(
        command.tau, _like(force, measured.force), force, np.full(3, np.nan),
        np.full((3, 3), np.nan), np.full(len(force), np.nan), _like(q, measured.q),
        _like(q, measured.v), int(command.status),
    ))  # fmt: skip


def _like(wanted: Array, measured: Array | None) -> Array:
    """A measurement as floats of a shape; NaN where it is missing or of another."""
    if measured is None or np.shape(measured) != wanted.shape:
        return np.full(wanted.shape, np.nan)
    return np.asarray(measured, dtype=np.float64)
