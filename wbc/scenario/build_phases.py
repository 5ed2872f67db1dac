"""Phase blocks to the sequence of phases."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from wbc.arrays import Array, read_only
from wbc.contact.grasp import ContactMode, Grasp
from wbc.control.force_planner import passages
from wbc.control.phases import ExitCondition, ObjectMotion, Phase, PhaseSequence, TaskMotion
from wbc.rotations import rotation_from_quaternion
from wbc.scenario import schema
from wbc.scenario.schema import Scenario
from wbc.scenario.synergies import Hands, tasks_of, weights_in
from wbc.scenario.tables import borne

FORCE_CLOSURE = 1e-6
"""ε_f and ε_m below which a grasp counts as in unit frictionless equilibrium."""

_AT_ONCE = 1e-3  # duration where nothing moves, [s]


def build_phases(
    scenario: Scenario, grasp: Grasp, tasks: list[str], hands: Hands | None = None
) -> PhaseSequence:
    """The phases in order; one that never ends where the scenario lists none.

    Args:
        tasks: names of the stack's secondary tasks, then of the fingers' tip tasks.
        hands: the synergies of each synergy task; None: their weights are not led.
    """
    specs = scenario.phases or (
        schema.Phase(name="run", tasks=tuple(tasks[: len(tasks) - grasp.count])),
    )
    force = np.array([scenario.contacts[name].force for name in grasp.fingers], dtype=np.float64)
    phases = []
    for number, spec in enumerate(specs):
        for name, value in spec.force.items():
            force[grasp.fingers.index(name)] = value
        led = () if hands is None else _task_motions(scenario, spec, tasks, hands)
        bears = borne(scenario, number)
        phases.append(replace(_phase(spec, grasp, tasks, force), task_motions=led, borne=bears))
    phases = [_closing(phases, k) for k in range(len(phases))]
    if scenario.forces is not None:  # a phase in which nothing moves lasts until forces have passed
        _, ways = passages(phases)
        for k, (way, spec) in enumerate(zip(ways, specs, strict=True)):
            if way.ramps:
                over = way.ramps * scenario.forces.ramp if spec.over is None else phases[k].over
                phases[k] = replace(phases[k], over=over, passes=True)
    return PhaseSequence(tuple(phases))


def _closing(phases: list[Phase], k: int) -> Phase:
    """Phase k, asking for force closure of those fingers, too, that will hold alone after it."""
    phase = phases[k]
    if phase.until.force_closure is None:
        return phase
    now = set(np.flatnonzero(phase.mode))
    for later in phases[k + 1 :]:
        fingers = set(np.flatnonzero(later.mode))
        if fingers < now:
            alone = tuple(sorted(int(i) for i in fingers))
            return replace(phase, until=replace(phase.until, closing=alone))
    return phase


def _phase(spec: schema.Phase, grasp: Grasp, tasks: list[str], force: Array) -> Phase:
    count = grasp.count
    mode = np.zeros(count, dtype=np.int64)
    reach = np.full(count, math.nan)
    for name, kind in spec.contacts.items():
        mode[grasp.fingers.index(name)] = ContactMode[kind.upper()]
    offset = np.zeros((count, 3))
    for name, goal in spec.reach.items():
        reach[grasp.fingers.index(name)] = goal.clearance
        offset[grasp.fingers.index(name)] = goal.offset
    wanted = np.array([name in spec.tasks for name in tasks], dtype=np.bool_)
    if count:
        wanted[len(tasks) - count :] = np.isfinite(reach)
    touch = None if spec.until is None else spec.until.touch
    pressed = np.where(mode != ContactMode.FREE, force / grasp.stiffness, 0.0)
    return Phase(
        name=spec.name,
        mode=mode,
        reach=reach,
        offset=offset,
        wanted=wanted,
        pad=grasp.rest_length - np.minimum(pressed, grasp.rest_length),
        object_motion=_object_motion(spec),
        over=_AT_ONCE if spec.over is None else spec.over,
        until=_until(spec, tasks),
        timeout=math.inf if spec.timeout is None else spec.timeout.after,
        on_timeout="hold" if spec.timeout is None else spec.timeout.then,
        search=0.0 if touch is None else touch.search,
    )


def _task_motions(
    scenario: Scenario, spec: schema.Phase, tasks: list[str], hands: Hands
) -> tuple[TaskMotion, ...]:
    return tuple(
        TaskMotion(
            tasks.index(name),
            read_only(weights_in(spec.weights[name], task, hands[name])),
            task.path == "linear",
        )
        for name, task in tasks_of(scenario)
        if name in spec.weights
    )


def _object_motion(spec: schema.Phase) -> ObjectMotion | None:
    if spec.object is None:
        return None
    target = spec.object.target
    return ObjectMotion(
        np.array(target.xyz, dtype=np.float64),
        rotation_from_quaternion(np.array(target.xyzw)),
        spec.object.relative,
    )


def _until(spec: schema.Phase, tasks: list[str]) -> ExitCondition:
    until = spec.until
    if until is None:
        return ExitCondition(time=math.inf)
    return ExitCondition(
        time=until.time or 0.0,
        residuals=tuple((tasks.index(name), limit) for name, limit in until.residual.items()),
        tip_error=until.tip_error,
        distance=until.distance,
        force_closure=FORCE_CLOSURE if until.force_closure else None,
        touch=None if until.touch is None else until.touch.force,
        press=until.press,
    )
