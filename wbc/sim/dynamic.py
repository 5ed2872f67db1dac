"""A robot driven by torques: both stages, once per tick, on what an engine makes of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from wbc.arrays import Array
from wbc.control.controller import Controller
from wbc.control.force_control import ForceControl, Goal, TorqueState
from wbc.control.set_points import SetPoints
from wbc.control.state import ControllerState, Measurement, TickRecord
from wbc.control.torque_controller import TorqueController
from wbc.control.watch import WatchSettings
from wbc.sim.compliant import CompliantPlant
from wbc.sim.plant import Plant, Sensed
from wbc.sim.trial import Trial


@dataclass(frozen=True)
class Dynamics:
    """What a run under torques needs beside the controller.

    Attributes:
        plant: robot and object.
        second: the second stage.
        set_points: planned forces where no optimizer plans them.
        trial: what is wrong in this run; None: nothing.
        watch: thresholds of the watchdogs.
        release: index of the phase at whose start a fixture lets go of the object; None: there is
            no fixture.
        held: torques are held over the tick; else they are a function of the state in every
            evaluation of the compliant plant, as in the chapter's simulation.
    """

    plant: Plant
    second: ForceControl
    set_points: SetPoints
    held: bool = True
    release: int | None = None
    trial: Trial | None = None
    watch: WatchSettings = field(default_factory=WatchSettings)

    def control(self, controller: Controller) -> TorqueController:
        """Both stages as one controller, as a robot of one's own would have it."""
        return TorqueController(controller, self.second, self.set_points, self.watch)


def run(
    controller: Controller, state: ControllerState, ticks: int, dynamics: Dynamics
) -> Iterator[tuple[TickRecord, ControllerState]]:
    """Step a controller on a robot that its torques move.

    The plant begins at rest at the controller's references, the object where it should be.

    Yields:
        Each tick's record, with what was measured, and the state after it.
    """
    plant, trial, dt = dynamics.plant, dynamics.trial, controller.settings.dt
    start = controller.law.kin.start
    pose = start.position, start.rotation
    if trial is not None:
        trial.begin()
        pose = trial.placed(*pose)
    sensed = plant.reset(state.q, np.zeros(len(state.q)), *pose)
    control = dynamics.control(controller)
    loop, mode = control.init(state), np.full(controller.law.kin.grasp.count, -1)
    for _ in range(ticks):
        seen = sensed.measurement if trial is None else trial.seen(sensed)
        tick, loop = control.step(loop, seen)
        record = tick.record
        if not np.array_equal(mode, record.mode):
            mode = record.mode
            plant.treat(mode)
        if dynamics.release is not None and record.phase >= dynamics.release:
            plant.release()
        yield _with_truth(record, sensed), loop.first
        tau = tick.command.tau
        if trial is not None:
            tau = trial.misjudged(tau, seen.q)
            if trial.eventful:
                plant.disturb(*trial.happening(record.t))
        if dynamics.held or not isinstance(plant, CompliantPlant):
            sensed = plant.step(tau, dt)
        else:
            sensed = plant.step_feedback(_Following(control.second, loop.second, tick.goal), dt)


def _with_truth(record: TickRecord, sensed: Sensed) -> TickRecord:
    """The record with robot and object where they are, whatever the sensors say."""
    assert record.dynamics is not None  # a `TorqueController` made it
    return record._replace(dynamics=record.dynamics._replace(
        force=sensed.force, object_position=sensed.object_position,
        object_rotation=sensed.object_rotation, slip=sensed.slip, q=sensed.q, v=sensed.v,
    ))  # fmt: skip


@dataclass(frozen=True)
class _Following:
    """The second stage between ticks, its reference moving on, its integrators standing."""

    second: ForceControl
    state: TorqueState
    goal: Goal

    def __call__(self, elapsed: float, measured: Measurement) -> Array:
        limits, law = self.second.gains, self.second.torques
        tau = law(self.state, self.goal, measured, elapsed)
        return np.clip(tau, limits.tau_min, limits.tau_max)
