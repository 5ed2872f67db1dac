"""A rehearsal: the stack itself goes through the phases quickly, before the robot does.

What it finds at the end of each phase are the pre-grasp and grasp configurations of arms and hands;
where a phase cannot be finished, or bodies would meet, it says which finger, which joints, which
bodies and how far. Nothing but the controller solves: what is rehearsed is what will be run, with
longer ticks and coarser exit conditions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, final

import numpy as np

from wbc.arrays import Array
from wbc.contact.classify import classify
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactMode, GraspClass
from wbc.control.coarse import REACHED, coarse_controller
from wbc.control.controller import Controller
from wbc.control.force_planner import ForcePlanner
from wbc.control.phases import Phase
from wbc.control.plan import Fault, load_fault, loose_fault, plan_faults, through, way_fault
from wbc.control.references import References
from wbc.control.state import ControllerState, Measurement, TickRecord
from wbc.costs.collision import Collision
from wbc.errors import SetupError
from wbc.forces import ForceStatus
from wbc.robot.collision_scene import OBJECT

TICK = 5e-3
"""Euler tick of a rehearsal, [s]; shorter where gains are so high that it would not be stable."""

LONGEST = 120.0
"""Where a rehearsal ends at the latest, in the robot's time, [s]: it is to be quick."""

_NEAR = 0.5  # of the safety distance: nearer than this, avoidance has lost
_AT_LIMIT = 1e-3  # a joint this near to its limit stands at it, [rad] or [m]
_TOUCHING = 0.01  # bodies this near may be what stands in the way, [m]
_BEHIND = 0.02  # a tip further than this behind its reference cannot follow it, [m]
_STRETCHED = 0.1  # least over largest singular value of a tip's Jacobian in a stretched arm

_SHORT = "fingers stop short of where they go: "
_REMEDY = {
    "object": "move the object, or leave the pair out in robot.collisions",
    "start": "move the robot's start, or leave the pair out in robot.collisions",
    "approach": "let a reach with an offset lead the fingers round, or choose other contact points",
    "bodies": "move the contact points or the start apart",
    "reach": "move the object or the start nearer",
}


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
        load: whether they hold the object at rest there, and how many times; None: not planned.
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
    load: tuple[ForceStatus, float] | None


@final
@dataclass(frozen=True)
class Rehearsal:
    """How the phases went.

    Attributes:
        stages: of the phases that began, in order. None where the plan alone shows a fault; the
            last is the phase that failed where one did, and those after it were not tried.
        faults: why the exchange cannot be carried out; empty where it can.
        warnings: what may not go as it was meant.
    """

    stages: tuple[Stage, ...]
    faults: tuple[Fault, ...]
    warnings: tuple[Fault, ...]


def rehearse(controller: Controller, start: ControllerState, tick: float = TICK) -> Rehearsal:
    """Go through all phases from `start`, stopping at the first that cannot be finished.

    Args:
        controller: its workspaces are used; its definitions and what it will do stay as they are.
        start: from `Controller.init`.
        tick: [s].

    Raises:
        SetupError: a tick that is not positive and finite.
    """
    if not 0.0 < tick < math.inf:
        raise SetupError(f"the tick of a rehearsal must be positive and finite, got {tick}")
    kin = controller.law.kin
    before = kin.reference
    try:
        kin.update(
            start.q, start.contact, kin.start._replace(reach=controller.phases.phases[0].pad)
        )
        found = _start_faults(controller, start)
        found = found or plan_faults(controller.phases.phases, kin, start.phase.motion.tips[0])
        stages: tuple[Stage, ...] = ()
        if not any(fault.grave for fault in found):
            stages, later = _through_phases(controller, start, tick)
            found += [fault for fault in later if fault.grave or not _told(fault, found)]
        faults = tuple(fault for fault in found if fault.grave)
        return Rehearsal(stages, faults, tuple(fault for fault in found if not fault.grave))
    finally:
        kin.reference = before


def _through_phases(
    controller: Controller, start: ControllerState, tick: float
) -> tuple[tuple[Stage, ...], list[Fault]]:
    """The phases up to the first that cannot be finished, and what was found."""
    coarse = coarse_controller(controller, tick)
    phases, tick = coarse.phases.phases, coarse.settings.dt
    stages: list[Stage] = []
    found = _entered(coarse, start)
    nearest: tuple[float, tuple[str, str] | None] = (math.inf, None)
    least = _least(controller)
    state, longest = start, min(LONGEST, sum(phase.timeout for phase in phases))
    for _ in range(math.ceil(longest / tick) + 1):
        record, after = coarse.step(state, Measurement(state.q))
        if record.phase != state.phase.current:  # the tick began a new phase at its start
            stages.append(_stage(coarse, state, nearest, controller.planner))
            if nearest[0] <= least:
                found.append(_collision(state, stages[-1]))
                break
            nearest = (math.inf, None)
            found += _from_afar(coarse, state, stages[-1], record) + _entered(coarse, after)
        nearest = min(nearest, _closest(coarse), key=lambda pair: pair[0])
        state = state._replace(phase=after.phase)  # as it was when that was decided
        blocked = any(fault.grave for fault in found)
        # bodies of an arm that strains for what is too far are no cause, and it is seen to the end
        collided = nearest[0] <= least and _lag(coarse, state) <= _BEHIND
        if collided or state.phase.done or state.phase.stopped or blocked:
            stages.append(_stage(coarse, state, nearest, controller.planner))
            if state.phase.stopped:
                found.append(_unfinished(coarse, state, stages[-1], record))
            elif nearest[0] <= least:
                found.append(_collision(state, stages[-1]))
            break
        state = after
    return tuple(stages), found + _loose(phases, stages)


def _told(fault: Fault, found: list[Fault]) -> bool:
    """Whether a finger's contact has its warning already."""
    return any(fault.about == other.about and fault.finger == other.finger for other in found)


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


def _start_faults(controller: Controller, start: ControllerState) -> list[Fault]:
    """Bodies that meet before anything has moved; `kin` is at the start."""
    law = controller.law
    if not (np.isfinite(start.q).all() and np.isfinite(law.kin.object_position).all()):
        return [Fault("start", "start: the robot's joints or the object's pose are no numbers")]
    if law.distances is None:
        return []
    distances = law.distances.update(
        law.kin.robot, law.kin.object_position, law.kin.object_rotation
    )
    faults = []
    for k in np.argsort(distances.value):
        if not distances.value[k] <= 0.0:
            break
        a, b = distances.scene.pair_names[k]
        about: Literal["object", "start"] = "object" if OBJECT in (a, b) else "start"
        met = _met((a, b), float(distances.value[k]))
        faults.append(Fault(about, f"start: {met} ({_REMEDY[about]})"))
    return faults


def _entered(controller: Controller, state: ControllerState) -> list[Fault]:
    """Tips whose way in the phase that begins goes through the object."""
    grasp, motion, index = controller.law.kin.grasp, state.phase.motion, state.phase.current
    phase, faults = controller.phases.phases[index], []
    for i in np.flatnonzero(np.isfinite(phase.reach)):
        inside = through(grasp.surface, motion.tips[0, i], motion.tips[1, i])
        if inside is not None:
            faults.append(way_fault(phase, index, grasp.fingers[i], inside))
    return faults


def _from_afar(
    controller: Controller, state: ControllerState, stage: Stage, record: TickRecord
) -> list[Fault]:
    """Fingers that begin to touch though the phase before left them beside their points."""
    fingers = controller.law.kin.grasp.fingers
    touching = (record.mode != ContactMode.FREE) & (state.contact.mode == ContactMode.FREE)
    return [
        Fault(
            "phase",
            f"finger '{fingers[i]}' begins to touch {1e3 * stage.gap[i]:.1f} mm beside its contact "
            "point (give the phase before it 'tip_error' in 'until', and time)",
            record.phase,
            fingers[i],
        )
        for i in np.flatnonzero(touching & (stage.gap > 2.0 * REACHED))
    ]


def _tips(kin: ExtendedKinematics) -> Array:
    """(N, 3) where the tips are, object frame, [m]."""
    away = kin.robot.position[: kin.grasp.count] - kin.object_position
    tips: Array = away @ kin.object_rotation
    return tips


def _gap(controller: Controller, state: ControllerState) -> Array:
    """(N,) distance of each reaching tip from its target, [m]; `kin` is at the state."""
    kin, phase = controller.law.kin, controller.phases.phases[state.phase.current]
    gap = np.linalg.norm(state.phase.motion.tips[1] - _tips(kin), axis=1)
    return np.where(np.isfinite(phase.reach), gap, np.nan)


def _stage(
    controller: Controller, state: ControllerState, nearest: tuple[float, tuple[str, str] | None],
    planner: ForcePlanner | None,
) -> Stage:  # fmt: skip
    model = controller.law.kin.robot.model
    room = np.minimum(state.q - model.lower, model.upper - state.q)
    kin = controller.law.kin.update(state.q, state.contact, controller.law.kin.reference)
    gap = _gap(controller, state)
    jacobians = kin.robot.linear[: len(gap), : 2 if kin.grasp.planar else 3]
    squares = np.linalg.det(jacobians @ jacobians.transpose(0, 2, 1))
    t = state.tick * controller.settings.dt
    return Stage(
        controller.phases.phases[state.phase.current].name,
        t,
        state.q,
        gap,
        tuple(model.joint_names[j] for j in np.flatnonzero(room < _AT_LIMIT)),
        nearest[1],
        nearest[0],
        classify(kin) if kin.holding else None,
        np.sqrt(np.maximum(squares, 0.0)),
        None if planner is None else planner.at_rest(kin, t, state.phase),
    )


def _loose(phases: tuple[Phase, ...], stages: list[Stage]) -> list[Fault]:
    """Grasps that no friction holds where they have come to, told once; loads too great for one."""
    faults: dict[tuple[str, ...], Fault] = {}
    for index, (phase, stage) in enumerate(zip(phases, stages, strict=False)):
        grasp = stage.grasp
        if stage.load is not None and (heavy := load_fault(phase, index, stage.load)) is not None:
            faults[stage.name,] = heavy
        if grasp is not None:
            fault = loose_fault(phase, index, grasp.fingers, grasp.friction_needed)
            if fault is not None:
                faults.setdefault(grasp.fingers, fault)
    return list(faults.values())


def _missing(controller: Controller, stage: Stage) -> str:
    """The tips that are not where they should be, furthest first."""
    far = [i for i in np.argsort(-stage.gap) if stage.gap[i] > REACHED]
    fingers = controller.law.kin.grasp.fingers
    return ", ".join(f"'{fingers[i]}' {1e3 * stage.gap[i]:.1f} mm" for i in far)


def _collision(state: ControllerState, stage: Stage) -> Fault:
    pair = stage.nearest or ("?", "?")
    remedy = _REMEDY["approach" if OBJECT in pair else "bodies"]
    near = ", below half the safety distance" if stage.distance > 0.0 else ""
    text = (
        f"phase '{stage.name}': {_met(pair, stage.distance)} at {stage.time:.2f} s{near} ({remedy})"
    )
    return Fault("phase", text, state.phase.current)


def _met(pair: tuple[str, str], distance: float) -> str:
    a, b = pair
    if distance <= 0.0:
        return f"'{a}' and '{b}' collide, {-1e3 * distance:.1f} mm deep"
    return f"'{a}' and '{b}' come as near as {1e3 * distance:.1f} mm"


def _lag(controller: Controller, state: ControllerState) -> float:
    """How far the tips that reach are behind their references, [m]; `kin` is at the state."""
    kin, phase = controller.law.kin, controller.phases.phases[state.phase.current]
    references = References(kin.grasp.count)
    references.at(state.tick * controller.settings.dt, state.phase.motion)
    behind = np.linalg.norm(references.tips[:, :3] - _tips(kin), axis=1)
    return float(np.max(behind[np.isfinite(phase.reach)], initial=0.0))


def _unfinished(
    controller: Controller, state: ControllerState, stage: Stage, record: TickRecord
) -> Fault:
    """Which of the exit conditions is not met, and what may be the cause."""
    index = state.phase.current
    phase, said, remedy = controller.phases.phases[index], [], "give it more time"
    until = phase.until
    if until.object_error is not None and np.nanmax(record.object_error[:, 0], initial=0.0) > (
        until.object_error
    ):
        said.append(f"the object is {1e3 * np.nanmax(record.object_error[:, 0]):.1f} mm off")
        remedy = "move the object's target nearer"
    if until.tip_error is not None and np.nanmax(stage.gap, initial=0.0) > until.tip_error:
        said += [f"{_SHORT}{_missing(controller, stage)}", *_held_back(controller, stage)]
        remedy = _REMEDY["reach"]
    if until.distance is not None and not said:
        said.append(f"a tip stays nearer than {1e3 * until.distance:.1f} mm to the object")
    for task, limit in until.residuals:
        if not record.task_error[task] <= limit:
            name = controller.task_names[task]
            said.append(f"'{name}' stays at {record.task_error[task]:.2g}, above {limit:.2g}")
            remedy = "choose other contact points, or give it more time"
    if until.force_closure is not None and not max(record.residuals) <= until.force_closure:
        said.append("the grasp does not come into balance")
        remedy = "choose other contact points, or give it more time"
    said = said or ["its exit condition is not met"]
    if stage.nearest is not None and stage.distance < _TOUCHING:
        said.append(_met(stage.nearest, stage.distance))
    text = f"phase '{phase.name}': {'; '.join(said)} ({remedy})"
    return Fault("phase", text, index)


def _held_back(controller: Controller, stage: Stage) -> list[str]:
    """Why the tip that is furthest off may stop short."""
    kin, worst = controller.law.kin, int(np.nanargmax(stage.gap))
    model = kin.robot.model
    own = model.support(model.frame(kin.robot.frames[worst]))
    limits = [name for name in stage.at_limit if own[model.joint(name)]]
    if limits:
        return [f"at a limit: {', '.join(limits)}"]
    singular = np.linalg.svd(
        kin.robot.linear[worst, : 2 if kin.grasp.planar else 3], compute_uv=False
    )
    return ["its arm is stretched"] if singular[-1] < _STRETCHED * singular[0] else []
