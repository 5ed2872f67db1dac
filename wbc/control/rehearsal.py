"""A rehearsal: the stack itself goes through the phases quickly, before the robot does.

What it finds at the end of each phase are the pre-grasp and grasp configurations of arms and hands;
where a phase cannot be finished, or bodies would meet, it says which finger, which joints, which
bodies and how far. Nothing but the controller solves: what is rehearsed is what will be run, with
longer ticks and coarser exit conditions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array
from wbc.contact.classify import classify
from wbc.contact.grasp import GraspClass
from wbc.control.controller import Controller
from wbc.control.phases import ExitCondition, Phase, PhaseSequence
from wbc.control.state import ControllerState, Measurement, TickRecord
from wbc.costs.collision import Collision

TICK = 5e-3
"""Euler tick of a rehearsal, [s]: short enough for every gain up to 100 /s."""

_POSITION = 1e-3  # what counts as reached, [m]
_RESIDUAL = 1e-3  # what counts as balanced, in the task's units
_ENDLESS = 2.0  # after its motion, a phase without timeout is given so long, [s]
_NEAR = 0.5  # of the safety distance: nearer than this, avoidance has lost
_AT_LIMIT = 1e-3  # a joint this near to its limit stands at it, [rad] or [m]


class Stage(NamedTuple):
    """What became of one phase.

    Attributes:
        name: the phase's.
        time: when it ended, [s].
        q: (nv,) configuration at its end: of a phase that reaches, the pre-grasp or grasp.
        gap: (N,) distance of each reaching tip from its target, [m]; NaN where it does not reach.
        at_limit: joints that stand at a limit there.
        nearest: the two bodies that came nearest during the phase, None where none are watched.
        distance: how near, [m].
        grasp: what kind of grasp the fingers in contact form at its end; None where none is.
        manipulability: (N,) w of (46) of each finger there, [m²] in the plane, else [m³].
    """

    name: str
    time: float
    q: Array
    gap: Array
    at_limit: tuple[str, ...]
    nearest: tuple[str, str] | None
    distance: float
    grasp: GraspClass | None
    manipulability: Array


@final
@dataclass(frozen=True)
class Rehearsal:
    """How the phases went.

    Attributes:
        stages: of the phases that began, in order.
        faults: why the exchange cannot be carried out, one sentence each; empty where it can.
    """

    stages: tuple[Stage, ...]
    faults: tuple[str, ...]


def rehearse(controller: Controller, start: ControllerState, tick: float = TICK) -> Rehearsal:
    """Go through all phases from `start`, stopping at the first that cannot be finished.

    Args:
        controller: its workspaces are used, its definitions stay as they are.
        start: from `Controller.init`.
        tick: [s].
    """
    phases = PhaseSequence(tuple(_coarse(phase) for phase in controller.phases.phases))
    settings = replace(controller.settings, dt=tick, runge_kutta=False)
    coarse = controller.like(phases, settings)
    stages: list[Stage] = []
    faults: list[str] = []
    nearest: tuple[float, tuple[str, str] | None] = (math.inf, None)
    least = _least(controller)
    state, longest = start, sum(p.timeout for p in phases.phases)
    for _ in range(math.ceil(longest / tick) + 1):
        record, after = coarse.step(state, Measurement(state.q))
        if record.phase != state.phase.current:  # the tick began a new phase at its start
            stages.append(_stage(coarse, state, record, nearest))
            nearest = (math.inf, None)
        nearest = min(nearest, _closest(coarse), key=lambda pair: pair[0])
        state = after
        collided = nearest[0] <= least
        if collided or state.phase.done or state.phase.stopped:
            stages.append(_stage(coarse, state, record, nearest))
            if collided:
                faults.append(_collision(stages[-1]))
            elif state.phase.stopped:
                faults.append(_unfinished(coarse, stages[-1], record))
            break
    return Rehearsal(tuple(stages), (*faults, *_loose(stages)))


def _coarse(phase: Phase) -> Phase:
    """The same phase with exit conditions that a long tick can meet, and an end in any case."""
    until = phase.until
    if math.isinf(until.time):
        until = ExitCondition(time=phase.over)
    until = replace(
        until,
        residuals=tuple((task, max(limit, _RESIDUAL)) for task, limit in until.residuals),
        tip_error=None if until.tip_error is None else max(until.tip_error, _POSITION),
        object_error=None if until.object_error is None else max(until.object_error, _POSITION),
        force_closure=None if until.force_closure is None else max(until.force_closure, _RESIDUAL),
    )
    patience = phase.timeout
    if math.isinf(patience):
        patience = max(until.time, phase.over) + _ENDLESS
    return replace(phase, until=until, timeout=patience, on_timeout="stop")


def _least(controller: Controller) -> float:
    """Distance that no watched pair may come below, [m]: between contact and the safety distance.

    Where several costs watch, the smallest of their safety distances counts for all pairs.
    """
    costs = controller.law.costs
    watched = [cost.safety_distance for cost in costs if isinstance(cost, Collision)]
    return _NEAR * min(watched, default=0.0)


def _closest(controller: Controller) -> tuple[float, tuple[str, str] | None]:
    distances = controller.law.distances
    if distances is None or not len(distances.value):
        return math.inf, None
    distance = distances.smallest()
    return distance, distances.scene.pair_names[int(distances.value.argmin())]


def _stage(
    controller: Controller, state: ControllerState, record: TickRecord,
    nearest: tuple[float, tuple[str, str] | None],
) -> Stage:  # fmt: skip
    model = controller.law.kin.robot.model
    room = np.minimum(state.q - model.lower, model.upper - state.q)
    phase = controller.phases.phases[state.phase.current]
    first = len(controller.task_names) - len(phase.reach)
    gap = np.where(np.isfinite(phase.reach), record.task_error[first:], np.nan)
    kin = controller.law.kin.update(state.q, state.contact, controller.law.kin.reference)
    jacobians = kin.robot.linear[: len(gap), : 2 if kin.grasp.planar else 3]
    squares = np.linalg.det(jacobians @ jacobians.transpose(0, 2, 1))
    return Stage(
        phase.name,
        record.t,
        state.q,
        gap,
        tuple(model.joint_names[j] for j in np.flatnonzero(room < _AT_LIMIT)),
        nearest[1],
        nearest[0],
        classify(kin) if kin.holding else None,
        np.sqrt(np.maximum(squares, 0.0)),
    )


def _loose(stages: list[Stage]) -> list[str]:
    """Grasps that no friction holds."""
    return [
        f"phase '{stage.name}': {' and '.join(stage.grasp.fingers)} do not hold the object: "
        "the grasp is not force closed, whatever the friction (move the contact points)"
        for stage in stages
        if stage.grasp is not None and math.isinf(stage.grasp.friction_needed)
    ]


def _collision(stage: Stage) -> str:
    a, b = stage.nearest or ("?", "?")
    how = "would collide"
    if stage.distance > 0.0:
        how = f"come as near as {1e3 * stage.distance:.2g} mm, below half the safety distance"
    return f"phase '{stage.name}': '{a}' and '{b}' {how} (at {stage.time:.2f} s)"


def _unfinished(controller: Controller, stage: Stage, record: TickRecord) -> str:
    """Which of the exit conditions is not met, and what may be the cause."""
    phase = next(p for p in controller.phases.phases if p.name == stage.name)
    until, fingers = phase.until, controller.law.kin.grasp.fingers
    said = []
    if until.tip_error is not None and np.nanmax(stage.gap, initial=0.0) > until.tip_error:
        worst = int(np.nanargmax(stage.gap))
        said.append(f"finger '{fingers[worst]}' stops {1e3 * stage.gap[worst]:.1f} mm short")
    for task, limit in until.residuals:
        if not record.task_error[task] <= limit:
            name = controller.task_names[task]
            said.append(f"'{name}' stays at {record.task_error[task]:.2g}")
    if until.force_closure is not None and not max(record.residuals) <= until.force_closure:
        said.append("the grasp does not come into balance")
    said = said or ["its exit condition is not met"]
    if stage.at_limit:
        said.append(f"at a limit: {', '.join(stage.at_limit)}")
    if stage.nearest is not None:
        a, b = stage.nearest
        said.append(f"nearest bodies: '{a}' and '{b}', {1e3 * stage.distance:.0f} mm")
    return f"phase '{stage.name}': {'; '.join(said)}"
