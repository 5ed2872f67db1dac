"""The planar exchange by torques, and the same with a world that is not as it is thought to be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wbc.arrays import Array
from wbc.cli.session import run_meta
from wbc.contact.surfaces import Surface
from wbc.recording import Log, Recorder, summarize
from wbc.recording.dynamic_facts import normal_forces, object_error_true
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics, true_body, true_pads, true_physics
from wbc.sim import dynamic
from wbc.sim.compliant import CompliantPlant, FreeBody
from wbc.sim.pads import Pads


@dataclass(frozen=True)
class World:
    """What is true beside what the scenario says.

    Attributes:
        surface, body, pads: functions of what the scenario has; None: as it says.
    """

    surface: Callable[[Surface], Surface] | None = None
    body: Callable[[FreeBody], FreeBody] | None = None
    pads: Callable[[Pads], Pads] | None = None


def exchanged(settings: dict[str, Any] | None = None, world: World | None = None) -> Log:
    """The log of the exchange."""
    assembly = build(load("planar_exchange_dynamic", settings or {}))
    dynamics = build_dynamics(assembly)
    assert dynamics is not None
    if world is not None:
        scenario, model = assembly.loaded.scenario, assembly.model
        grasp = assembly.controller.law.kin.grasp
        tips = tuple(scenario.robot.fingers[name] for name in grasp.fingers)
        body, pads = true_body(scenario), true_pads(scenario, grasp)
        plant = CompliantPlant(
            model,
            tips,
            world.surface(grasp.surface) if world.surface else grasp.surface,
            world.body(body) if world.body else body,
            world.pads(pads) if world.pads else pads,
            true_physics(scenario, model, grasp),
        )
        dynamics = replace(dynamics, plant=plant)
    recorder = Recorder(run_meta(assembly, dynamics), assembly.ticks)
    steps = dynamic.run(assembly.controller, assembly.start, assembly.ticks, dynamics)
    for record, _ in steps:
        recorder.append(record)
        if not np.isfinite(record.dynamics.q).all():
            break
    return recorder.finish()


@dataclass(frozen=True)
class Figures:
    """What the exchange is judged by, in a part of it.

    Attributes:
        position, angle: largest error of the true object [mm], [mrad].
        force: (4,) largest force errors [N].
        off: (4,) ticks in which a finger that was to press did not.
    """

    position: float
    angle: float
    force: Array
    off: Array


def figures(log: Log, *phases: str, least: float = 0.1) -> Figures:
    """Of the phases named, all where none is; the first 0.3 s of the run apart.

    Args:
        least: planned force from which on a finger is to press [N].
    """
    names = [log.phase_names[k] for k in log.phase]
    within = (log.t > 0.3) & np.isin(names, phases or log.phase_names)
    way, angle = object_error_true(log)
    planned, measured = normal_forces(log)
    error = np.abs(np.where(log.in_contact, measured - planned, 0.0))
    off = log.in_contact & (planned >= least) & ~(measured > 0.0)
    return Figures(
        1e3 * float(way[within].max()), 1e3 * float(angle[within].max()),
        error[within].max(axis=0), off[within].sum(axis=0),
    )  # fmt: skip


def outcome(log: Log) -> dict[str, Any]:
    """The summary."""
    return summarize(log)
