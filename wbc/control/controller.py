"""The tick: everything that happens between a state and the next, in the order it happens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.contact.grasp import ContactState, ObjectReference
from wbc.contact.recharting import recharted
from wbc.control import checks
from wbc.control.force_planner import ForcePlanner
from wbc.control.integrator import runge_kutta
from wbc.control.law import CostForecast, Law, Locks, Motion, Sight, moved
from wbc.control.limiting import Guarded, finite, guarded, solved, within_limits
from wbc.control.numbers import finite_reading
from wbc.control.observe import Seen, observe
from wbc.control.pace import paced
from wbc.control.phases import PhaseSequence, unsupported
from wbc.control.places import handed_over, moving, ready
from wbc.control.references import References, led
from wbc.control.state import ControllerState, Measurement, PhaseState, Status, TickRecord
from wbc.control.supervision import TickForecast
from wbc.control.touch import TouchSense
from wbc.errors import SetupError, UnknownNameError
from wbc.stack import activation as gains
from wbc.stack.limits import NOT_LIMITED, Bounds, Limited
from wbc.stack.supervisor import StackEvent, StackState, Supervisor

_NEAR_SINGULAR = 1e-3  # the share below which `solve_main` damps its inverse


@dataclass(frozen=True)
class Settings:
    """Numbers of the tick.

    Attributes:
        dt: the tick, [s].
        runge_kutta: integrate the references by the classical fourth-order rule, else Euler's.
        smoothing: μ of the gains, [1/s]; inf switches at once.
        lower, upper, velocity, acceleration: (nv,) limits of the filter; acceleration may be inf.
    """

    dt: float
    runge_kutta: bool
    smoothing: float
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array

    @cached_property
    def bounds(self) -> Bounds:
        """The limits as the filter takes them."""
        return Bounds(self.lower, self.upper, self.velocity, self.acceleration, self.acceleration)


@final
class Controller:
    """First-stage controller: object motion and contact evolution to joint references (35)-(43).

    ``state = controller.init(q0)``, then ``record, state = controller.step(state, measurement)`` as
    often as wanted: no threads, no clock, no files. The state is a value; the controller itself
    holds only definitions and workspaces, so one controller serves one thread at a time.

    Attributes:
        task_names: the tasks in the order of every (M,) array: the stack's, then the fingers' tips.
        planner: of the contact forces; None: none are planned.
        touch: the fingertips as sensors; None: no phase asks what they feel.
    """

    def __init__(
        self,
        law: Law,
        forecast: CostForecast,
        supervisor: Supervisor,
        phases: PhaseSequence,
        priority: Sequence[int],
        settings: Settings,
        planner: ForcePlanner | None = None,
        touch: TouchSense | None = None,
    ) -> None:
        checks.controller(law, phases, priority, settings)
        self.law = law
        self.supervisor = supervisor
        self.phases = phases
        self.settings = settings
        self.planner = planner
        self.touch = touch
        self.task_names = tuple(task.name for task in law.stack.tasks)
        self._costs = forecast
        self._forecast = TickForecast(law, forecast, settings.dt, supervisor.horizon)
        self._references = References(law.kin.grasp.count)
        self._tip_targets = tuple(self._references.tips)  # rows that follow the references
        self._priority = tuple(priority)
        # tips of free fingers come before every task: they are what is left of the main task there
        self._tips = tuple(k for k in range(len(self.task_names)) if k not in self._priority)

    def step(
        self,
        state: ControllerState,
        measurement: Measurement | None = None,
        pace: float = 1.0,
        bears: BoolArray | None = None,
        asked: BoolArray | None = None,
    ) -> tuple[TickRecord, ControllerState]:
        """One tick. Never raises on numbers: what gave way is in the record's status.

        Args:
            pace: share of their speed with which references, tasks and costs move on, in [0, 1];
                to change smoothly. The object stays held; at 0 no phase begins.
            bears, asked: (N,) fingers that are felt to touch, and that are to press: no phase that
                lets a finger go begins without those that hold then; see `phases.unsupported`.
        """
        t, dt = state.tick * self.settings.dt, self.settings.dt
        state = state._replace(phase=paced(state.phase, t, dt, pace))
        state, seen = self._situation(t, state, measurement, bears, asked)  # phase, tasks
        here = guarded(state.q, state.contact, self.law.kin.grasp, self.settings.bounds)
        motion, locks = solved(
            self.law, state.level_order, self._levels(state.activation), here, dt
        )
        sight = self.law.sight()
        forces, held = None, None
        if self.planner is not None:  # before the tick's further stages move the kinematics on
            forces, held = self.planner.plan(self.law.kin, t, state, measurement)
        stack, event, target = self._supervised(t, state, motion)  # who is in the stack
        gains_next = gains.advance(state.activation, target, self.settings.smoothing, dt)
        shares = (1.0, 1.0)
        if self.settings.runge_kutta and finite(motion):  # three further evaluations in the tick
            motion, shares = self._over_the_tick(t, state, motion, locks, target, gains_next)
        step, status, limited = self._limited(state, motion, here, locks, shares, measurement)
        q, contact = moved(state.q, state.contact, step, dt)
        v = step[: len(q)]  # what the limit filter let pass
        record = self._record(t, state, seen, sight, v, stack, event, status, limited)
        return record._replace(forces=forces), state._replace(
            tick=state.tick + 1, q=q, v=v, rates=step, contact=contact, activation=gains_next,
            stack=stack, forces=held,
        )  # fmt: skip

    def init(self, q0: Array, *, v0: Array | None = None) -> ControllerState:
        """State at t = 0: first phase, every gain at 0.

        Args:
            q0: (nv,) joint positions; the fingers that hold in the first phase are to be closed on
                their contact points (see `wbc.control.setup`).
            v0: (nv,) velocity the robot starts with; 0 where not given.
        """
        law, n = self.law, self.law.kin.grasp.count
        tasks, first = len(self.task_names), self.phases.phases[0]
        nv = law.kin.robot.model.nv
        q = checks.vector("q0", q0, nv)
        contact = ContactState.planned(law.kin.grasp, first.mode)
        reference = law.kin.start._replace(reach=first.pad)  # not where a tick has left it
        # every finger that holds sees the object where the scenario puts it
        law.kin.update(q, contact._replace(mode=np.zeros(n, dtype=np.int64)), reference)
        pivot = np.array([law.kin.touch(i) for i in range(n)]).reshape(n, 3, 3)
        law.kin.update(q, contact._replace(pivot=pivot), reference)
        motion = self.phases.begin(0, 0.0, law.kin, None)
        phase = PhaseState(0, 0.0, motion, False, False, ())
        targets = tuple(task.target for task in law.stack.tasks)
        phase, targets = self.phases.lead(phase, targets, None)
        order = self._tips + self._priority
        rates = np.zeros(len(q) + 5 * n)
        rates[: len(q)] = 0.0 if v0 is None else checks.vector("v0", v0, nv)
        return ControllerState(
            tick=0,
            q=q,
            v=rates[: len(q)],
            rates=rates,
            contact=contact._replace(pivot=pivot),
            activation=self._start_gains(first.wanted),
            stack=StackState(first.wanted.copy(), np.ones(tasks, dtype=np.bool_), -np.inf, 0),
            order=order,
            next_order=None,
            level_order=law.stack.level_order(order),
            phase=phase,
            targets=targets,
        )

    def _start_gains(self, wanted: BoolArray) -> gains.Activation:
        """Every gain at 0, but 1 for tips that reach: their references start where they are."""
        rho = np.zeros(len(wanted))
        tips = list(self._tips)
        rho[tips] = wanted[tips]
        return gains.Activation(rho, rho)

    def like(self, phases: PhaseSequence, settings: Settings) -> Controller:
        """A controller of the same robot, tasks and costs, in the same workspaces; no planner."""
        supervisor, priority = self.supervisor, self._priority
        return Controller(
            self.law, self._costs, supervisor, phases, priority, settings, touch=self.touch
        )

    def insert(self, state: ControllerState, task: str) -> ControllerState:
        """Ask for a task from the next tick on; it fades in. The next phase asks anew."""
        return self._want(state, task, True)

    def remove(self, state: ControllerState, task: str) -> ControllerState:
        """Ask no longer for a task; it fades out. The next phase asks anew."""
        return self._want(state, task, False)

    def reorder(self, state: ControllerState, tasks: Sequence[str]) -> ControllerState:
        """Give the stack's tasks a new order, highest priority first, without the object task.

        Tasks that change place relative to another fade out, take their place and fade in again.
        """
        wanted = tuple(self._index(name) for name in tasks)
        if sorted(wanted) != sorted(self._priority):
            names = ", ".join(self.task_names[k] for k in self._priority)
            raise SetupError(
                f"an order names each of these once, the object task left out: {names}"
            )
        return state._replace(next_order=self._tips + wanted)

    def retarget(self, state: ControllerState, task: str, target: Array) -> ControllerState:
        """Give a task a new target, in the layout of its definition's."""
        k = self._index(task)
        old, new = state.targets[k], np.array(target, dtype=np.float64)
        if old is None or old.shape != new.shape or not np.isfinite(new).all():
            shape = "no target" if old is None else f"a finite target of shape {old.shape}"
            raise ValueError(f"task '{task}' takes {shape}, got shape {new.shape}")
        return state._replace(targets=(*state.targets[:k], new, *state.targets[k + 1 :]))

    def _index(self, task: str) -> int:
        if task not in self.task_names:
            raise UnknownNameError("task", task, self.task_names)
        return self.task_names.index(task)

    def _want(self, state: ControllerState, task: str, wanted: bool) -> ControllerState:
        mask = state.stack.wanted.copy()
        mask[self._index(task)] = wanted
        return state._replace(stack=state.stack._replace(wanted=mask))

    def _situation(
        self,
        t: float,
        state: ControllerState,
        measurement: Measurement | None,
        bears: BoolArray | None,
        asked: BoolArray | None,
    ) -> tuple[ControllerState, Seen]:
        """Everything at t; where a phase begins at t, evaluated again under it."""
        state = self._reordered(state)
        other = recharted(self.law.kin.grasp.surface, state.contact, state.rates)
        if other is not None:
            state = state._replace(contact=other[0], rates=other[1])
        self._evaluate(t, state.q, state.contact, state, self._active(state))
        seen = observe(self.law)
        if state.phase.motion.pace == 0.0:
            return state, seen
        felt, planned = None, None
        if self.touch is not None and self.phases.phases[state.phase.current].senses:
            felt = self.touch.read(self.law.kin, measurement)
            planned = None if state.forces is None else state.forces.c[:, 2]
        change = self.phases.advance(state.phase, t, self.law.kin, seen, felt, planned)
        before, after = state.contact.mode, change.contact.mode
        planned_well = state.forces is None or state.forces.balanced
        if change.entered and unsupported(before, after, planned_well, bears, asked):
            self._evaluate(t, state.q, state.contact, state, self._active(state))
            return state._replace(phase=state.phase._replace(waits=True)), seen
        if not change.entered:
            if change.phase is not state.phase:
                state = state._replace(phase=change.phase)
            return state, seen
        phase, targets = self.phases.lead(change.phase, state.targets, state.phase.motion)
        begins = self.phases.phases[phase.current]
        state = state._replace(phase=phase, targets=targets)
        state = handed_over(state, change.contact, begins, self._tips)
        self._evaluate(t, state.q, state.contact, state, self._active(state))
        return state, observe(self.law)

    def _evaluate(
        self, t: float, q: Array, contact: ContactState, state: ControllerState,
        active: Sequence[bool],
    ) -> None:  # fmt: skip
        reference = self._references.at(t, state.phase.motion)
        targets = led(t, state.phase.motion, state.targets)
        targets = targets[: len(self._priority)] + self._tip_targets
        self.law.evaluate(q, contact, reference, targets, active, state.phase.motion.pace)

    def _active(self, state: ControllerState) -> list[bool]:
        """(M,) tasks to evaluate: the stack's always, for log and return, tips if in force."""
        first = len(self._priority)
        wanted, rho = state.stack.wanted[first:].tolist(), state.activation.rho[first:].tolist()
        return [True] * first + [w or r > 0.0 for w, r in zip(wanted, rho, strict=True)]

    def _reordered(self, state: ControllerState) -> ControllerState:
        if state.next_order is None or not ready(state, state.activation.rho):
            return state
        return state._replace(
            order=state.next_order,
            next_order=None,
            level_order=self.law.stack.level_order(state.next_order),
        )

    def _targets(self, state: ControllerState, stack: StackState) -> Array:
        target: Array = stack.within.astype(np.float64)
        if state.next_order is not None:
            target[moving(state, len(target))] = 0.0
        return target

    def _levels(self, activation: gains.Activation) -> Array:
        levels: Array = activation.rho[self.law.stack.level_task]
        return levels

    def _supervised(
        self, t: float, state: ControllerState, motion: Motion
    ) -> tuple[StackState, StackEvent | None, Array]:
        """The stack from now on, what changed, and what each gain goes to."""
        target = self._targets(state, state.stack)
        forecast = self._forecast.fresh(
            state.q, motion.total[: len(state.q)], state.level_order, target
        )
        order = state.order[len(self._tips) :]
        stack, event = self.supervisor.decide(state.stack, t, order, forecast)
        return stack, event, target if event is None else self._targets(state, stack)

    def _over_the_tick(
        self, t: float, state: ControllerState, motion: Motion, locks: Locks,
        target: Array, gains_next: gains.Activation,
    ) -> tuple[Motion, tuple[float, float]]:  # fmt: skip
        active = self._active(state)

        def stage(q: Array, contact: ContactState, at: float, levels: Array) -> Motion:
            self._evaluate(at, q, contact, state, active)
            return self.law.solve(state.level_order, levels, locks)

        dt, rate = self.settings.dt, self.settings.smoothing
        half = gains.advance(state.activation, target, rate, 0.5 * dt)
        levels = (self._levels(half), self._levels(gains_next))
        velocity = self.settings.velocity
        return runge_kutta(motion, stage, state.q, state.contact, t, dt, levels, velocity)

    def _limited(
        self, state: ControllerState, motion: Motion, here: Guarded, locks: Locks,
        shares: tuple[float, float], measurement: Measurement | None,
    ) -> tuple[Array, Status, Limited]:  # fmt: skip
        """The velocity of q̃ that goes out: within the limits, finite, whatever came in."""
        dt, status = self.settings.dt, Status.OK
        shape = state.q.shape
        if measurement is not None and finite_reading(measurement, "q", shape) is None:
            status |= Status.BAD_MEASUREMENT
        if not finite(motion):
            status |= Status.BAD_COMMAND
        if status:
            nothing = np.zeros(len(motion.total))
            motion = Motion(nothing, nothing)

        def later() -> ObjectReference:
            return self._references.at((state.tick + 1) * dt, state.phase.motion)

        step, limited = within_limits(
            self.law, state.q, state.contact, state.rates, motion, here, locks,
            None if status else later, dt,
        )  # fmt: skip
        if not status and min(shares) < 1.0:  # what the stages gave way counts too
            main, secondary = min(limited.main, shares[0]), min(limited.secondary, shares[1])
            limited = limited._replace(main=main, secondary=secondary)
        if not status and locks.edges:
            status |= Status.AT_EDGE
        if limited != NOT_LIMITED:
            status |= Status.CLIPPED if limited.clipped else Status.SCALED
        return step, status, limited

    def _record(
        self, t: float, state: ControllerState, seen: Seen, sight: Sight, v: Array,
        stack: StackState, event: StackEvent | None, status: Status, limited: Limited,
    ) -> TickRecord:  # fmt: skip
        if sight.independence < _NEAR_SINGULAR:
            status |= Status.NEAR_SINGULAR
        status |= state.phase.status
        return TickRecord(
            t=t,
            q=state.q.copy(),
            v=v.copy(),  # what becomes of a record does not become of the state
            object_position=seen.object_position,
            object_rotation=seen.object_rotation,
            reference_position=seen.reference_position,
            reference_rotation=seen.reference_rotation,
            object_error=seen.object_error,
            mode=state.contact.mode.copy(),
            contact_points=seen.points,
            contact_normals=seen.normals,
            task_error=seen.task_error,
            within=stack.within,
            activation=state.activation.rho.copy(),
            residuals=seen.residuals,
            cost=seen.cost,
            min_distance=seen.min_distance,
            phase=state.phase.current,
            status=status,
            limited=limited,
            independence=sight.independence,
            freedom=sight.freedom,
            event=event,
        )
