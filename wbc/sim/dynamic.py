"""A robot driven by torques: both stages, once per tick, on what an engine makes of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wbc.arrays import Array
from wbc.control.controller import Controller
from wbc.control.force_control import ForceControl, Goal, TorqueState
from wbc.control.set_points import SetPoints
from wbc.control.state import ControllerState, DynamicsRecord, Measurement, TickRecord
from wbc.sim.compliant import CompliantPlant
from wbc.sim.plant import Plant
from wbc.sim.trial import Trial

_BRIDGED = 5
"""Ticks without joint positions after which the first stage is told, and brakes at once: a
reference that stops and starts within a tick asks more of the joints than a gap of some ticks."""


@dataclass(frozen=True)
class Dynamics:
    """What a run under torques needs beside the controller.

    Attributes:
        plant: robot and object.
        second: the second stage.
        set_points: planned forces where no optimizer plans them.
        trial: what is wrong in this run; None: nothing.
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


def run(
    controller: Controller, state: ControllerState, ticks: int, dynamics: Dynamics
) -> Iterator[tuple[TickRecord, ControllerState]]:
    """Step a controller on a robot that its torques move.

    The plant begins at rest at the controller's references, the object where it should be.

    Yields:
        Each tick's record, with what was measured, and the state after it.
    """
    plant, second, dt = dynamics.plant, dynamics.second, controller.settings.dt
    trial, start = dynamics.trial, controller.law.kin.start
    pose = start.position, start.rotation
    if trial is not None:
        trial.begin()
        pose = trial.placed(*pose)
    sensed = plant.reset(state.q, np.zeros(len(state.q)), *pose)
    torques, mode = second.init(), np.full(controller.law.kin.grasp.count, -1)
    blind = 0
    for _ in range(ticks):
        seen = sensed.measurement if trial is None else trial.seen(sensed)
        blind = 0 if np.isfinite(seen.q).all() else blind + 1
        bridged = 0 < blind <= _BRIDGED  # the second stage holds its torques, the references go on
        record, state = controller.step(state, None if bridged else Measurement(seen.q))
        if not np.array_equal(mode, record.mode):
            mode = record.mode
            plant.treat(mode)
        if dynamics.release is not None and record.phase >= dynamics.release:
            plant.release()
        goal = _goal(record, state, dynamics.set_points, seen.force)
        command, torques = second.step(torques, goal, seen, dt)
        yield record._replace(dynamics=DynamicsRecord(
            command.tau, sensed.force, goal.force, sensed.object_position, sensed.object_rotation,
            sensed.slip, sensed.q, sensed.v, int(command.status),
        )), state  # fmt: skip
        tau = command.tau
        if trial is not None:
            tau = trial.misjudged(tau, seen.q)
            if trial.eventful:
                plant.disturb(*trial.happening(record.t))
        if dynamics.held or not isinstance(plant, CompliantPlant):
            sensed = plant.step(tau, dt)
        else:
            sensed = plant.step_feedback(_Following(second, torques, goal), dt)


def _goal(
    record: TickRecord, state: ControllerState, set_points: SetPoints, found: Array | None
) -> Goal:
    """What the second stage is to follow in this tick."""
    if record.forces is not None:
        force = record.forces.force
    else:
        force = set_points.at(record, state.phase.motion, found)
    arms = record.contact_points - record.object_position
    return Goal(record.q, record.v, record.mode, arms, record.contact_normals, force)


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
