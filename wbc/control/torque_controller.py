"""Both stages in one tick: what is measured goes in, the torques to be held come out."""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.contact.grasp import ContactMode
from wbc.contact.surfaces.foot import outward
from wbc.control import checks
from wbc.control.controller import Controller
from wbc.control.force_control import Command, ForceControl, Goal, TorqueState
from wbc.control.readings import Readings
from wbc.control.references import Motion
from wbc.control.set_points import SetPoints, balanced
from wbc.control.state import (
    PRESSING,
    ControllerState,
    DynamicsRecord,
    Measurement,
    TickRecord,
)
from wbc.control.watch import View, Watch, WatchSettings, WatchState
from wbc.errors import SetupError

_SEEKING = 0.015  # [m/s] at which a finger looks for an object that it has lost
_FURTHEST = 0.008  # [m] that it goes
_PART = 0.2  # of its planned force with which a finger feels for an object that it has lost


class LoopState(NamedTuple):
    """What both stages carry from tick to tick.

    Attributes:
        first: of the first stage.
        second: of the second.
        watch: of the watchdogs.
        sought: (N,) how far fingers have gone inward to look for a contact since they last were
            free [m].
    """

    first: ControllerState
    second: TorqueState
    watch: WatchState
    sought: Array


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
        first, second, set_points, watch: the parts.
    """

    def __init__(
        self, first: Controller, second: ForceControl, set_points: SetPoints,
        settings: WatchSettings | None = None,
    ) -> None:  # fmt: skip
        """
        Args:
            set_points: planned forces where no optimizer plans them.
            settings: of the watchdogs; as they stand where not given.
        """
        limits, count = first.settings, first.law.kin.grasp.count
        given = WatchSettings() if settings is None else settings
        readings = Readings(
            limits.lower, limits.upper, limits.velocity, count, given.bridged, given.frozen
        )
        self.watch = Watch(given, readings, second.fingers, count)
        self.first = first
        self.second = second
        self.set_points = set_points

    def init(self, start: ControllerState, measured: Array | None = None) -> LoopState:
        """State before the first tick.

        Args:
            start: of the first stage: `Controller.init`, or the `start` of a scenario's assembly.
            measured: (nv,) where the joints are, to make sure that it is where they start: from the
                first tick on they are held there with all the stiffness there is.

        Raises:
            SetupError: a joint is further off than the watchdogs let a moving one be.
        """
        if measured is not None:
            self._at_start(start.q, checks.vector("measured", measured, len(start.q)))
        none = np.zeros(self.first.law.kin.grasp.count)
        return LoopState(start, self.second.init(), self.watch.init(), none)

    def step(self, state: LoopState, measurement: Measurement) -> tuple[LoopTick, LoopState]:
        """One tick. Never raises on what is measured: what gave way is in the record's statuses."""
        dt = self.first.settings.dt
        view, watch = self.watch.look(state.watch, measurement, state.first.q, state.first.v, dt)
        sought, way = self._sought(state, view.seeks, dt)
        record, first = self.first.step(sought, view.measured, view.pace, view.bears, view.asked)
        goal = self._goal(record, first, view)
        kept = goal.copied()  # what becomes of a tick does not become of the state
        command, second = self.second.step(state.second, kept, view.measured, dt)
        command = command._replace(tau=command.tau.copy(), status=command.status | view.status)
        watch = self.watch.done(watch, kept, command.status)
        tick = LoopTick(_logged(record, command, goal, watch), command, goal)
        way = np.where(record.mode == ContactMode.FREE, 0.0, way)
        return tick, LoopState(first, second, watch, way)

    def _at_start(self, q: Array, measured: Array) -> None:
        way = np.abs(measured - q)
        off = way / self.watch.error_at_stand
        worst = int(np.argmax(off))
        if off[worst] > 0.5:
            name = self.first.law.kin.robot.model.joint_names[worst]
            raise SetupError(
                f"joint '{name}' is {way[worst]:.3g} from where the run starts: bring the robot "
                "there first, or start the run where it is"
            )

    def _sought(
        self, state: LoopState, seeks: BoolArray, dt: float
    ) -> tuple[ControllerState, Array]:
        """The contact points of fingers that look for the object moved inward, up to a bound."""
        if not seeks.any():
            return state.first, state.sought
        step = np.where(seeks, np.minimum(_SEEKING * dt, _FURTHEST - state.sought), 0.0)
        contact = state.first.contact
        normal = outward(self.first.law.kin.grasp.surface.charts(contact.xi, contact.face))
        shift = contact.shift - step[:, None] * normal
        return state.first._replace(contact=contact._replace(shift=shift)), state.sought + step

    def _goal(self, record: TickRecord, state: ControllerState, view: View) -> Goal:
        """What the second stage is to follow in this tick."""
        found, motion = view.measured.force, state.phase.motion
        if record.forces is not None:
            force = record.forces.force
        else:
            force = self.set_points.at(record, motion, found)
        arms = record.contact_points - record.object_position
        order = np.argsort(-view.spare)  # who is lost the most first
        shares, left = view.spare[order], force.copy()
        for k in range(np.count_nonzero(view.spare)):
            gone = np.zeros(len(order), dtype=np.bool_)
            gone[order[: k + 1]] = True
            last = shares[k + 1] if k + 1 < len(shares) else 0.0
            if shares[k] > last:  # between two sets of fingers as their shares are: no step
                others = self._without(gone, record, motion, found, force, arms)
                left += (shares[k] - last) * (others - force)
        return Goal(record.q, record.v, record.mode, arms, record.contact_normals, left)

    def _without(
        self, gone: BoolArray, record: TickRecord, motion: Motion, found: Array | None,
        force: Array, arms: Array,
    ) -> Array:  # fmt: skip
        """Planned forces (N, 3) if some fingers bear nothing; the plan where the others cannot
        balance the object by pressing."""
        mode = np.where(gone, ContactMode.FREE, record.mode)
        normals = record.contact_normals
        press = -np.einsum("ir,ir->i", normals, force)
        planner = self.first.planner
        if record.forces is None:
            others = self.set_points.at(record._replace(mode=mode), motion, found)
        else:
            others = balanced(
                press, mode, arms, normals, record.forces.wrench, self.first.law.kin.grasp.planar
            )
        wanted = -np.einsum("ir,ir->i", normals, others)
        along = others + wanted[:, None] * normals
        wanted = np.maximum(wanted, 0.0)  # a contact only pushes
        if planner is not None:
            drag = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
            along *= np.minimum(1.0, planner.settings.mu * wanted / drag)[:, None]
        others = along - wanted[:, None] * normals
        change = others - force
        if record.forces is None and found is not None:  # as `balanced`: what they do bear counts
            fixed = (record.mode == ContactMode.FIXED)[:, None]
            change = np.where(fixed, np.where(gone[:, None], found - force, change), 0.0)
        lost = float(np.linalg.norm(force[gone], axis=1).sum())
        # what stays open, in parts of what was lost: all up to a quarter, none from 3/4 on
        part = min(1.0, max(0.0, 1.5 - 2.0 * _wrench_size(change, arms) / max(lost, PRESSING)))
        better: Array = force + part * (others - force)
        better[gone] = _feeling(force[gone])
        return better


def _wrench_size(force: Array, arms: Array) -> float:
    """Size of the wrench of forces (N, 3) [N], moments at the distance of the furthest contact."""
    length = max(float(np.max(np.linalg.norm(arms, axis=1))), 1e-9)
    moment = np.cross(arms, force).sum(axis=0) / length
    return float(np.hypot(np.linalg.norm(force.sum(axis=0)), np.linalg.norm(moment)))


def _feeling(force: Array) -> Array:
    """Planned forces (k, 3) of fingers that have lost the object: a part, to feel for it."""
    size = np.linalg.norm(force, axis=1, keepdims=True)
    least = np.minimum(size, 2.0 * PRESSING)
    part: Array = force * (np.maximum(_PART * size, least) / np.maximum(size, 1e-9))
    return part


def _logged(record: TickRecord, command: Command, goal: Goal, watch: WatchState) -> TickRecord:
    """The record with what was measured and commanded."""
    sensed, unknown = watch.readings, np.full((3, 3), np.nan)
    slip = np.full(len(goal.force), np.nan)
    return record._replace(dynamics=DynamicsRecord(
        command.tau.copy(), sensed.force.copy(), goal.force.copy(), unknown[0], unknown, slip,
        sensed.q.copy(), sensed.v.copy(), int(command.status),
    ))  # fmt: skip
