"""What goes into a tick and comes out of it: values, never changed in place."""

from __future__ import annotations

from enum import IntFlag
from typing import NamedTuple

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.grasp import ContactState
from wbc.control.load_estimate import LoadState
from wbc.control.references import Motion
from wbc.stack.activation import Activation
from wbc.stack.limits import Limited
from wbc.stack.supervisor import StackEvent, StackState

PRESSING = 0.1
"""Planned normal force from which on a finger is to touch, [N]: below, a touch only begins."""


class Status(IntFlag):
    """What gave way in a tick; 0 when nothing did. Never an exception, never a NaN."""

    OK = 0
    SCALED = 1
    """The limit filter slowed the secondary tasks or the main task."""
    CLIPPED = 2
    """Joints were clipped one by one: the main task's direction is lost for this tick."""
    NEAR_SINGULAR = 4
    """The main task's rows are nearly dependent: its inverse is damped."""
    BAD_MEASUREMENT = 8
    """The measurement holds a NaN or an infinity, or has the wrong size: the robot brakes."""
    BAD_COMMAND = 16
    """The law gave no finite velocity: the robot brakes."""
    PHASE_TIMEOUT = 32
    """A phase did not reach its exit condition in time."""
    DONE = 64
    """Every phase has ended; the last references are held."""
    AT_EDGE = 128
    """A sliding contact was kept from going over the edge of its face."""
    UNSUPPORTED = 256
    """A phase in which a finger lets go waits: those that are to hold the object do not press."""


class Measurement(NamedTuple):
    """What the robot reports. The first stage runs on its own references and only checks `q`.

    Attributes:
        q: (nv,) measured joint positions, [rad] or [m].
        v: (nv,) measured joint velocities; None where nothing is measured but positions.
        force: (N, 3) force of each fingertip on the object, world axes [N]; None likewise.
        stamp: when it was measured, on any steady clock [s]; None where that is not known.
    """

    q: Array
    v: Array | None = None
    force: Array | None = None
    stamp: float | None = None


class PhaseState(NamedTuple):
    """Where the sequence of phases is.

    Attributes:
        current: index of the phase.
        since: time it began, [s].
        motion: its references.
        done: the last phase has met its exit condition.
        stopped: a timeout ended the sequence; the references are held.
        timeouts: names of the phases that timed out.
        felt: by finger, ticks in a row in which it has felt what it is to touch; empty before the
            first. Once it is sure, it stays so for the phase.
        steady: ticks in a row in which the fingers that hold press as `until.press` asks.
        waits: the next phase would let go of an object that no one else is felt to hold.
    """

    current: int
    since: float
    motion: Motion
    done: bool
    stopped: bool
    timeouts: tuple[str, ...]
    felt: tuple[int, ...] = ()
    steady: int = 0
    waits: bool = False

    @property
    def status(self) -> Status:
        """What the sequence has to say in a tick."""
        found = Status.UNSUPPORTED if self.waits else Status.OK
        if self.timeouts:
            found |= Status.PHASE_TIMEOUT
        if self.done:
            found |= Status.DONE
        return found


class ForceState(NamedTuple):
    """What the force planner carries from tick to tick.

    Attributes:
        v: (nv,) velocity commanded up to its last tick, for the acceleration.
        c: (N, 4) last feasible forces in the contact frames, x, y, z (inward) [N] and t [Nm].
        starts: by set of contacts, its last feasible forces; None where it begins cold.
        load: how the object differs from the one believed; None where that is not estimated.
        balanced: whether every set of contacts asked for in its last tick had feasible forces.
    """

    v: Array
    c: Array
    starts: tuple[Array | None, ...]
    load: LoadState | None = None
    balanced: bool = True


class ControllerState(NamedTuple):
    """Everything the controller carries from tick to tick.

    Attributes:
        tick: number of the next tick; t = tick · dt.
        q: (nv,) commanded positions q_d of (35).
        v: (nv,) last commanded velocity.
        rates: (nv + 5N,) the same with the rates of the contact variables, as in `law.Motion`.
        contact: the contact variables η_d.
        activation: gains of all tasks, tips included.
        stack: who is in the stack.
        order: tasks from the highest priority down, free tips first.
        next_order: the order asked for, while tasks that change place fade out; else None.
        level_order: levels in the present order.
        phase: where the sequence of phases is.
        targets: target of each task.
        forces: of the force planner; None before its first tick, and where there is none.
    """

    tick: int
    q: Array
    v: Array
    rates: Array
    contact: ContactState
    activation: Activation
    stack: StackState
    order: tuple[int, ...]
    next_order: tuple[int, ...] | None
    level_order: IntArray
    phase: PhaseState
    targets: tuple[Array | None, ...]
    forces: ForceState | None = None


class ForceRecord(NamedTuple):
    """The contact forces planned for a tick; world axes.

    Attributes:
        force: (N, 3) force of each contact on the object, [N]; 0 where free.
        spin: (N,) moment about the inward normal that a soft finger exerts, [Nm].
        torque: (nv,) joint torques τ = J_hᵀ c + τ_e (4), [Nm].
        cone_margin: (N,) c_z − |s|, [N]; NaN where free.
        torque_margin: (nv,) distance of each torque to its nearer limit, [Nm]; inf without one.
        wrench: (6,) h_e that the contacts supply, about the object's origin, [N], [Nm].
        mass: of the object with its contents, [kg].
        com: (3,) their centre of mass, [m].
        status: the verdict, index into the members of `wbc.forces.ForceStatus`.
        iterations: Newton steps of this tick.
        phi: the cost (15), [N].
        sum_normal: Σ c_z, [N].
    """

    force: Array
    spin: Array
    torque: Array
    cone_margin: Array
    torque_margin: Array
    wrench: Array
    mass: float
    com: Array
    status: int
    iterations: int
    phi: float
    sum_normal: float


class DynamicsRecord(NamedTuple):
    """What a tick under torques began with, and the torques of it; world axes.

    Attributes:
        tau: (nv,) torques held over the tick [Nm].
        force: (N, 3) measured force of each contact on the object [N].
        plan: (N, 3) planned force [N]; 0 where free.
        object_position, object_rotation: where the object truly is.
        slip: (N,) tangential way slid so far while a contact was to hold [m].
        q, v: (nv,) where the joints are, and their velocities.
        status: bits of `wbc.control.force_control.TorqueStatus`.
    """

    tau: Array
    force: Array
    plan: Array
    object_position: Array
    object_rotation: Array
    slip: Array
    q: Array
    v: Array
    status: int


class TickRecord(NamedTuple):
    """One tick as it is logged: the situation at t and the command for the tick that begins there.

    Attributes:
        t: [s].
        q: (nv,) positions at t.
        v: (nv,) velocity commanded for [t, t + dt].
        object_position, object_rotation: object pose as the fingers in contact hold it.
        reference_position, reference_rotation: where it should be.
        object_error: (N, 2) position [m] and orientation [rad] error by each finger, NaN if free.
        mode: (N,) ContactMode of each finger.
        contact_points, contact_normals: (N, 3) in the world.
        task_error: (M,) norm of each task's error, tips included.
        within: (M,) in the stack.
        activation: (M,) ρ.
        residuals: ε_f [1] and ε_m [m²] over the grasp's fingers (44)-(45).
        cost: C_Σ.
        min_distance: smallest distance of the watched pairs, [m].
        phase: index.
        status: what gave way.
        limited: what the limit filter did.
        independence: smallest independent share of the main task's rows, 1 = orthogonal.
        freedom: (L,) share of freedom each level found, 1 = all.
        event: the supervisor's decision, if any.
        forces: the planned contact forces; None where the scenario plans none.
        dynamics: what torques and sensors said; None on the ideal robot.
    """

    t: float
    q: Array
    v: Array
    object_position: Array
    object_rotation: Array
    reference_position: Array
    reference_rotation: Array
    object_error: Array
    mode: IntArray
    contact_points: Array
    contact_normals: Array
    task_error: Array
    within: BoolArray
    activation: Array
    residuals: tuple[float, float]
    cost: float
    min_distance: float
    phase: int
    status: Status
    limited: Limited
    independence: float
    freedom: Array
    event: StackEvent | None
    forces: ForceRecord | None = None
    dynamics: DynamicsRecord | None = None
