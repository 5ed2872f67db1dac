"""The planar exchange under torques with a fault put in, and what must hold whatever the fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.cli.session import run_meta
from wbc.control.force_control import TorqueStatus
from wbc.control.state import Measurement, Status
from wbc.recording import Log, Recorder
from wbc.recording.dynamic_facts import dropped
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic
from wbc.sim.plant import Plant, Sensed

NAME = "planar_exchange_dynamic"
DT = 2e-3


class Injected:
    """In place of a `Trial`: sensors that say what a test wants, contacts that bear nothing."""

    eventful = True

    def __init__(
        self, seen: Callable[[int, Measurement], Any] | None = None,
        lost: dict[str, tuple[float, float]] | None = None, fingers: tuple[str, ...] = (),
        push: Callable[[float], Array] | None = None,
    ) -> None:  # fmt: skip
        self._seen, self._lost, self._fingers, self._push = seen, lost or {}, fingers, push
        self._tick = -1

    def begin(self) -> None:
        self._tick = -1

    def placed(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        return position, rotation

    def seen(self, truth: Sensed) -> Any:
        self._tick += 1
        return (
            truth.measurement if self._seen is None else self._seen(self._tick, truth.measurement)
        )

    def misjudged(self, tau: Array, q: Array) -> Array:
        return tau

    def happening(self, t: float) -> tuple[Array, BoolArray]:
        gone = [a <= t < b for a, b in (self._lost.get(f, (0.0, 0.0)) for f in self._fingers)]
        return np.zeros(3) if self._push is None else self._push(t), np.array(gone)


class Altered(Plant):
    """A plant whose motors do something else."""

    def __init__(self, plant: Plant, motors: Callable[[int, Array, Sensed], Array]) -> None:
        self._plant, self._motors, self._tick = plant, motors, -1

    def reset(self, q: Array, v: Array, position: Array, rotation: Array) -> Sensed:
        self._last = self._plant.reset(q, v, position, rotation)
        return self._last

    def treat(self, mode: IntArray) -> None:
        self._plant.treat(mode)

    def disturb(self, push: Array, lost: BoolArray) -> None:
        self._plant.disturb(push, lost)

    def step(self, tau: Array, dt: float) -> Sensed:
        self._tick += 1
        self._last = self._plant.step(self._motors(self._tick, tau, self._last), dt)
        return self._last


@dataclass(frozen=True)
class Run:
    """A run with a fault."""

    log: Log
    done: bool
    limit: Array

    def ticks(self, flag: TorqueStatus) -> IntArray:
        """Ticks in which a bit of the second stage's status is set."""
        return np.flatnonzero(self.log.torque_status & flag)

    def waits(self) -> IntArray:
        """Ticks in which a phase waits for somebody to hold the object."""
        return np.flatnonzero(self.log.status & Status.UNSUPPORTED)

    def phase(self, name: str) -> IntArray:
        """Ticks of a phase."""
        return np.flatnonzero(self.log.phase == self.log.phase_names.index(name))


def run(
    ticks: int, *, motors: Callable[[int, Array, Sensed], Array] | None = None,
    settings: dict[str, Any] | None = None, gains: dict[str, Any] | None = None, **fault: Any,
) -> Run:  # fmt: skip
    """So many ticks of the exchange with a fault; all invariants are checked."""
    assembly = build(load(NAME, settings or {}))
    dynamics = build_dynamics(assembly)
    assert dynamics is not None
    if fault:
        fingers = assembly.controller.law.kin.grasp.fingers
        dynamics = replace(dynamics, trial=Injected(fingers=fingers, **fault))
    if motors is not None:
        dynamics = replace(dynamics, plant=Altered(dynamics.plant, motors))
    if gains is not None:
        dynamics.second.gains = replace(dynamics.second.gains, **gains)
    recorder, done = Recorder(run_meta(assembly, dynamics), ticks), False
    for record, state in dynamic.run(assembly.controller, assembly.start, ticks, dynamics):
        recorder.append(record)
        done = state.phase.done
    found = Run(recorder.finish(), done, dynamics.second.gains.tau_max)
    check_invariants(found)
    return found


def check_invariants(found: Run) -> None:
    """Commands finite and within limits, and the object in the hands."""
    log = found.log
    assert np.isfinite(log.tau).all() and np.isfinite(log.q).all() and np.isfinite(log.v).all()
    assert (np.abs(log.tau) <= found.limit + 1e-9).all()
    assert (np.abs(log.v) <= np.array(log.meta.v_limit) + 1e-9).all()
    assert (log.q >= np.array(log.meta.q_lower) - 1e-9).all()
    assert (log.q <= np.array(log.meta.q_upper) + 1e-9).all()
    assert dropped(log) is None


def readable(log: Log, folder: Path) -> bool:
    """Whether the log comes back from a file as it went in."""
    back = Log.load(log.save(folder / "log.npz"))
    return all(
        np.array_equal(getattr(back, name), getattr(log, name), equal_nan=True)
        for name in ("t", "q", "tau", "torque_status", "q_meas")
    )


@cache
def undisturbed(ticks: int) -> Run:
    """The same without a fault."""
    return run(ticks)
