"""The phases of an exchange: who touches how, what moves where, when it is over."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactMode, ContactState, Grasp, equilibrium_residuals
from wbc.control.observe import Seen
from wbc.control.references import Aim, Motion, Targets, standing
from wbc.control.state import PRESSING, PhaseState
from wbc.control.touch import Felt, found
from wbc.rotations import log_so3

SURE = 3
"""Ticks in a row in which something must be felt: a single one may be noise."""

_ASTRAY, _ELSEWHERE = 5e-3, -1
"""How much further than it is to search a finger may feel something, and still believe that it is
the object [m]; the count of one that felt something elsewhere: it stops, and the phase does not
end."""


@dataclass(frozen=True)
class ExitCondition:
    """All that is given must hold for a phase to end.

    Attributes:
        time: least duration, [s].
        residuals: (task index, largest |e|) in the task's units.
        tip_error: largest distance of a reaching tip from its target, [m].
        distance: least distance of the reaching tips outside the object's surface, where they have
            found that, [m].
        force_closure: ε_f and ε_m both below this; None: not asked.
        closing: fingers that are to hold alone later: they must be in equilibrium by themselves.
        object_error: largest position error of the object by any finger, [m].
        touch: force [N] at which a reaching finger feels the object and stops; all must; None:
            they stop at their targets.
        press: part of its planned force with which every finger that holds must press; None: not
            asked.
    """

    time: float = 0.0
    residuals: tuple[tuple[int, float], ...] = ()
    tip_error: float | None = None
    distance: float | None = None
    force_closure: float | None = None
    closing: tuple[int, ...] = ()
    object_error: float | None = None
    touch: float | None = None
    press: float | None = None


class ObjectMotion(NamedTuple):
    """A motion of the object.

    Attributes:
        position: (3,) [m], rotation: (3, 3): the pose at the end, or the displacement to it.
        relative: a displacement from the pose at the start, in the world's axes.
    """

    position: Array
    rotation: Array
    relative: bool


class TaskMotion(NamedTuple):
    """A motion of a task's target.

    Attributes:
        task: index.
        goal: (k,) where it goes, in the task's units; the target may have a rate beside it.
        linear: at constant speed; else minimum-jerk.
    """

    task: int
    goal: Array
    linear: bool


@dataclass(frozen=True)
class Phase:
    """One phase.

    Attributes:
        name: unique.
        mode: (N,) ContactMode of each finger.
        reach: (N,) clearance outside the surface that a free tip goes to, [m]; NaN: it does not.
        offset: (N, 3) how far beside that, in the object's axes, [m].
        search: how far on from there a tip goes that is to feel the object, [m].
        wanted: (M,) tasks asked for, tips included.
        pad: (N,) l − Δl at the end of the phase, [m].
        object_motion: where the object goes; None: it stays.
        borne: whether something else than fingers, as a table, bears the object as it begins.
        passes: whether planned forces pass to or from other contacts; that is not cut short.
        task_motions: targets of tasks that are led somewhere; the others stay.
        over: duration of the phase's motions, [s].
        until: exit condition.
        timeout: time after which the phase has failed, [s].
        on_timeout: "stop" (end the sequence in this phase), "next" (go on), "hold" (keep trying).
    """

    name: str
    mode: IntArray
    reach: Array
    offset: Array
    wanted: BoolArray
    pad: Array
    object_motion: ObjectMotion | None = None
    task_motions: tuple[TaskMotion, ...] = ()
    over: float = 0.5
    until: ExitCondition = field(default_factory=ExitCondition)
    timeout: float = np.inf
    on_timeout: str = "stop"
    search: float = 0.0
    borne: bool = False
    passes: bool = False

    @property
    def senses(self) -> bool:
        """Whether it ends by what the fingertips feel."""
        return self.until.touch is not None or self.until.press is not None

    def tip_goal(self, grasp: Grasp, i: int, point: Array, normal: Array) -> Array:
        """Where tip i goes, (3,) [m], object frame; NaN where the phase does not lead it.

        Args:
            point, normal: (3,) its contact point and the outward normal there, object frame.
        """
        if self.mode[i] != ContactMode.FREE:
            held: Array = point + self.pad[i] * normal
            return held
        goal: Array = point + (grasp.rest_length[i] + self.reach[i]) * normal + self.offset[i]
        return goal


class Transition(NamedTuple):
    """The state after a tick's look at the phase.

    Attributes:
        phase: where the sequence is now.
        contact: contact variables, with new touches initialised.
        entered: whether a phase began.
        timed_out: whether a timeout fell in this tick.
    """

    phase: PhaseState
    contact: ContactState
    entered: bool
    timed_out: bool


def unsupported(
    before: IntArray, after: IntArray, balanced: bool, bears: BoolArray | None,
    asked: BoolArray | None,
) -> bool:  # fmt: skip
    """Whether a change of modes would let go of an object that is not sure to be held then.

    Args:
        before, after: (N,) ContactMode.
        balanced: whether the forces planned last balance the object within all limits.
        bears: (N,) fingers that are felt to touch; None: it is not known, and taken as given.
        asked: (N,) fingers that are to press; None: all. Of those that are not, as passive ones,
            none need be felt as long as some other is.
    """
    free, holds = ContactMode.FREE, after == ContactMode.FIXED
    if not holds.any() or not ((before != free) & (after == free)).any():
        return False
    if not balanced:
        return True
    if bears is None:
        return False
    holds &= before != free  # who only touches then holds nothing yet
    must = holds if asked is None else holds & asked
    return not bears[holds].any() or not bears[must].all()


@final
@dataclass(frozen=True)
class PhaseSequence:
    """The phases in order."""

    phases: tuple[Phase, ...]

    def begin(self, index: int, t: float, kin: ExtendedKinematics, last: Motion | None) -> Motion:
        """Motions of phase `index` from where the references and the tips are at t.

        Args:
            kin: the kinematics at t.
            last: the motion of the phase before; None at the start.
        """
        phase, grasp = self.phases[index], kin.grasp
        n = grasp.count
        position = np.zeros((2, 3))
        rotation, turn = np.array(kin.reference.rotation), np.zeros(3)
        if (
            last is not None
        ):  # exactly where the last motion ended or stands, not where errors left it
            position[:] = kin.reference.position
        else:
            position[:] = kin.object_position
        goal = phase.object_motion
        if goal is not None and goal.relative:
            position[1] += goal.position
            turn = log_so3(goal.rotation)
        elif goal is not None:
            position[1] = goal.position
            turn = log_so3(goal.rotation @ rotation.T)
        reach = np.stack([np.array(kin.reference.reach), phase.pad])
        tips = np.zeros((2, n, 3))
        for i in range(n):
            normal, point = kin.frame[i, :, 2], kin.charts[i, 0]
            if kin.state.mode[i] == ContactMode.FREE:
                offset = kin.robot.position[i] - kin.object_position
                tips[0, i] = offset @ kin.object_rotation
                reach[0, i] = grasp.rest_length[i]
            else:
                tips[0, i] = point + kin.reference.reach[i] * normal
            if phase.mode[i] != ContactMode.FREE:
                tips[1, i] = tips[0, i]  # where it touches it stays while its tip task fades
            elif np.isfinite(phase.reach[i]):
                tips[1, i] = phase.tip_goal(grasp, i, point, normal) - phase.search * normal
            else:
                tips[1, i] = tips[0, i]
        motion = Motion(t, max(phase.over, 1e-9), position, rotation, turn, reach, tips)
        if last is None or last.pace == 1.0:
            return motion
        return motion._replace(pace=last.pace, now=t, quickening=last.quickening)

    def lead(
        self, state: PhaseState, targets: Targets, last: Motion | None
    ) -> tuple[PhaseState, Targets]:
        """The phase that begins with the aims of its motion, and the targets with their goals.

        Args:
            targets: when it begins; `last`, the motion of the phase before, leads some of them.
        """
        start = state.motion.start
        before = targets if last is None else standing(start, last, targets)
        goals, aims = list(before), []
        for task, goal, linear in self.phases[state.current].task_motions:
            here, k = before[task], len(goal)
            assert here is not None  # `checks.controller` saw to it
            goals[task] = np.concatenate([goal, np.zeros(len(here) - k)])  # where it rests
            aims.append(Aim(task, goal - here[:k], linear))
        return state._replace(motion=state.motion._replace(aims=tuple(aims))), tuple(goals)

    def advance(
        self, state: PhaseState, t: float, kin: ExtendedKinematics, seen: Seen,
        felt: Felt | None = None, planned: Array | None = None,
    ) -> Transition:  # fmt: skip
        """Look at the phase at time t, all evaluated there; the result is in force from t.

        Args:
            felt: what the fingertips report, in a phase that `senses`.
            planned: (N,) normal forces planned up to t [N]; None: none are.
        """
        if state.done or state.stopped:
            return Transition(state, kin.state, False, False)
        state = state._replace(waits=False) if state.waits else state
        phase = self.phases[state.current]
        if felt is not None:
            state = _sensed(phase, state, kin, felt, planned)
        if self._over(phase, state, t, kin, seen):
            return self._enter_next(state, t, kin, felt)
        late = phase.timeout
        if phase.passes and phase.on_timeout == "next":
            late = max(late, phase.over)  # or planned forces would step
        if t - state.since >= late - 1e-9 and phase.name not in state.timeouts:
            state = state._replace(timeouts=(*state.timeouts, phase.name))
            if phase.on_timeout == "next":
                return self._enter_next(state, t, kin, felt)._replace(timed_out=True)
            stopped = phase.on_timeout == "stop"
            return Transition(state._replace(stopped=stopped), kin.state, False, True)
        return Transition(state, kin.state, False, False)

    def _over(
        self, phase: Phase, state: PhaseState, t: float, kin: ExtendedKinematics, seen: Seen
    ) -> bool:
        until = phase.until
        if t - state.since < until.time - 1e-9:
            return False
        if until.touch is not None and not _all_touch(phase, state):
            return False
        if t < state.motion.start + state.motion.duration - 1e-9 and not (
            until.touch is not None
            and phase.object_motion is None
            and not (phase.task_motions or phase.passes)
        ):
            return False  # a reference cut short would be a velocity step
        if until.press is not None and state.steady < SURE:
            return False
        if any(not seen.task_error[k] <= limit for k, limit in until.residuals):
            return False
        if until.force_closure is not None and not self._closed(until, kin, seen):
            return False
        if until.object_error is not None:
            errors = seen.object_error[:, 0]
            if np.any(errors[~np.isnan(errors)] > until.object_error):
                return False
        reaching = np.flatnonzero(np.isfinite(phase.reach))
        for i in reaching:
            tip = (kin.robot.position[i] - kin.object_position) @ kin.object_rotation
            if (
                until.tip_error is not None
                and until.touch is None
                and not (np.linalg.norm(state.motion.tips[1, i] - tip) <= until.tip_error)
            ):
                return False
            if until.distance is not None:
                away = kin.grasp.surface.level(tip - kin.state.shift[i])
                if not away >= until.distance:
                    return False
        return True

    def _closed(self, until: ExitCondition, kin: ExtendedKinematics, seen: Seen) -> bool:
        limit = until.force_closure or 0.0
        if not max(seen.residuals) <= limit or not until.closing:
            return max(seen.residuals) <= limit
        fingers = list(until.closing)
        alone = equilibrium_residuals(
            kin.charts[fingers, 0], kin.frame[fingers, :, 2], kin.grasp.share[fingers]
        )
        return max(alone) <= limit

    def _enter_next(
        self, state: PhaseState, t: float, kin: ExtendedKinematics, felt: Felt | None = None
    ) -> Transition:
        if state.current + 1 >= len(self.phases):
            return Transition(state._replace(done=True), kin.state, False, False)
        index = state.current + 1
        mode = self.phases[index].mode
        if felt is not None and self.phases[state.current].until.touch is not None:
            touching = np.array(state.felt or (0,) * kin.grasp.count) >= SURE
            contact = found(kin.grasp, kin.state, felt.tips, touching & (mode != ContactMode.FREE))
            kin.update(kin.robot.q, contact, kin.reference)
        motion = self.begin(index, t, kin, state.motion)
        pivot = np.array(kin.state.pivot)
        for i in np.flatnonzero((kin.state.mode == ContactMode.FREE) & (mode != ContactMode.FREE)):
            pivot[i] = kin.touch(int(i))
        contact = kin.state._replace(mode=mode, pivot=pivot)
        state = state._replace(current=index, since=t, motion=motion, felt=(), steady=0)
        return Transition(state, contact, True, False)


def _sensed(
    phase: Phase, state: PhaseState, kin: ExtendedKinematics, felt: Felt, planned: Array | None
) -> PhaseState:
    """Who touches by now, its reference stopped where it is; how long all have pressed enough."""
    until, n = phase.until, len(felt.press)
    if until.press is not None and planned is not None:
        asked = (phase.mode == ContactMode.FIXED) & (planned > PRESSING)
        up = bool(asked.any() and (felt.press >= until.press * planned)[asked].all())
        state = state._replace(steady=state.steady + 1 if up else 0)
    if until.touch is None:
        return state
    before, motion = state.felt or (0,) * n, state.motion
    counts, tips = list(before), None
    for i in np.flatnonzero(np.isfinite(phase.reach)).tolist():
        if not 0 <= counts[i] < SURE:
            continue
        counts[i] = counts[i] + 1 if felt.press[i] >= until.touch else 0
        if counts[i] == SURE:
            if abs(felt.gap[i]) > phase.search + _ASTRAY:
                counts[i] = _ELSEWHERE
            tips = np.array(motion.tips) if tips is None else tips
            tips[:, i] = (kin.robot.position[i] - kin.object_position) @ kin.object_rotation
    if tips is not None:
        motion = motion._replace(tips=tips)
    return state._replace(felt=tuple(counts), motion=motion)


def _all_touch(phase: Phase, state: PhaseState) -> bool:
    reaching = np.flatnonzero(np.isfinite(phase.reach)).tolist()
    return bool(state.felt) and all(state.felt[i] >= SURE for i in reaching)
