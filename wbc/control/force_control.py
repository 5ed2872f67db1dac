"""The second stage: joint torques that follow the first stage's references and planned forces (36).

Fingers are under the chapter's parallel force/position control, arms and torso under joint control
with the object's weight, and whatever else is planned at the tips, fed forward through the hand.
The torques are held over the tick, as on a robot.

Where the chapter is silent or printed otherwise:

- Δp is of the tip in the world, so that fingers make up for the errors of their arm, or relative
  to the palm: the text has both.
- k_d acts on q̇ − q̇_d: as printed, a finger that slides would press against its own motion.
- f_d has the planned friction, too, and force errors are taken along the normal.
- Only errors of internal forces are acted on: of the fingers that hold, what their normals can
  bear without moving the object. Errors that no press of theirs can mend would make their
  integrators walk the object. A tip that slides presses by its own error: those that hold bear it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntFlag
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.compiled import kernel
from wbc.contact.grasp import ContactMode
from wbc.control.state import Measurement
from wbc.robot.dynamics import InverseDynamics
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel
from wbc.rotations import cross

_FIXED, _SLIDING = int(ContactMode.FIXED), int(ContactMode.SLIDING)
_BALANCE = 0.05
"""λ of the internal forces: presses whose sum is this small beside them count half as internal."""


_HUGE = 1e9
"""No position, velocity or force of a robot is as large, in SI units."""


class TorqueStatus(IntFlag):
    """What gave way in the second stage or was found by its watchdogs; 0 when nothing was.

    From BAD_MEASUREMENT on, but for BAD_COMMAND, see `wbc.control.watch`.
    """

    OK = 0
    SATURATED = 1
    """A joint was asked for more than its limit; integrators that ask for more of it wait."""
    INTEGRAL_LIMIT = 2
    """An integrator stands at its bound."""
    BAD_MEASUREMENT = 4
    """A reading is missing, no number, of the wrong size or absurd: the last one goes on."""
    BAD_COMMAND = 8
    """The first stage asks for what is no number: the last torques are held."""
    BLIND = 16
    """That lasts: all stands still, as planned, until the sensor is back."""
    FROZEN = 32
    """A sensor says the very same while something moves: as if it were not there."""
    LATE = 64
    """A measurement came later than half a tick after its time; if more do, all stands still."""
    STALE = 128
    """A measurement's time stamp is not after the last one's: it is not used."""
    TRACKING = 256
    """A joint is far from its reference: all goes slower, or stands still."""
    CONTACT_LOST = 512
    """A finger that is to press is not felt: all stands still until it is."""
    OVERLOADED = 1024
    """Joints stay at their torque limits: all goes slower."""
    SLOWED = 2048
    """References go slower than planned."""
    HELD = 4096
    """References stand still; phases and their timeouts wait."""


@dataclass(frozen=True)
class ForceGains:
    """Gains of (36) and of the joint control.

    Finger joints are those of `finger_joints`: with one fingertip on it, a whole arm is a finger.

    Attributes:
        position: (N,) k_P of the tips [N/m].
        force: (N,) k_F [1].
        integral: (N,) k_I [1/s].
        smoothing: [s] time constant of the force errors that k_F acts on; 0: as they are measured.
        windup: (N,) largest force that an integrator adds [N].
        damping: (nv,) k_d of finger joints and damping of the others [Nm s/rad].
        stiffness: (nv,) of the joints [Nm/rad]; 0 for finger joints unless a posture is wanted.
        joint_integral: (nv,) [Nm/(rad s)] of arm joints.
        joint_windup: (nv,) largest torque of that [Nm].
        tau_min, tau_max: (nv,) [Nm].
        inertia: feed the torques of the commanded acceleration forward, beside those of gravity.
        relative: Δp is of the tip relative to the palm; else in the world, and fingers make up for
            the errors of their arm, too.
    """

    position: Array
    force: Array
    integral: Array
    smoothing: float
    windup: Array
    damping: Array
    stiffness: Array
    joint_integral: Array
    joint_windup: Array
    tau_min: Array
    tau_max: Array
    inertia: bool
    relative: bool = True


class Goal(NamedTuple):
    """What the first stage asks for in a tick.

    Attributes:
        q, v: (nv,) reference at the start of the tick, and the velocity commanded over it.
        mode: (N,) ContactMode.
        points: (N, 3) contact points from the object's origin, world axes [m].
        normals: (N, 3) outward.
        force: (N, 3) planned force of each contact on the object [N].
    """

    q: Array
    v: Array
    mode: IntArray
    points: Array
    normals: Array
    force: Array

    def copied(self) -> Goal:
        """The same, sharing no array."""
        q, v, mode = self.q.copy(), self.v.copy(), self.mode.copy()
        return Goal(q, v, mode, self.points.copy(), self.normals.copy(), self.force.copy())


class Track(NamedTuple):
    """The first stage's reference as a smooth motion.

    Attributes:
        q, v, a: (nv,) at the start of a tick; the acceleration is that of its middle.
        rate: (nv,) velocity commanded over the tick.
        change: (nv,) its change from the tick before, per time.
    """

    q: Array
    v: Array
    a: Array
    rate: Array
    change: Array

    def then(self, q: Array, rate: Array, dt: float) -> Track:
        """The next tick's.

        The commanded velocity is a staircase. The motion behind it has, at the start of a tick, the
        mean of the two velocities that meet there, and in its middle the acceleration that is seen
        half a tick ahead; without either a robot is late by half a tick.
        """
        change = (rate - self.rate) / dt
        ahead = change + 0.5 * (change - self.change)
        return Track(q, 0.5 * (self.rate + rate), ahead, rate, change)

    def at(self, elapsed: float) -> Track:
        """A time [s] into the tick."""
        q = self.q + elapsed * (self.v + 0.5 * elapsed * self.a)
        return self._replace(q=q, v=self.v + elapsed * self.a)


class TorqueState(NamedTuple):
    """What the second stage carries from tick to tick.

    Attributes:
        integral: (N,) what the integrators add to the presses [N].
        error: (N,) the internal force errors, smoothed [N].
        joint_integral: (nv,) what they add to the torques [Nm].
        tau: (nv,) the last torques.
        track: the reference.
    """

    integral: Array
    error: Array
    joint_integral: Array
    tau: Array
    track: Track


class Command(NamedTuple):
    """A tick's outcome.

    Attributes:
        tau: (nv,) torques to be held over the tick, finite and within their limits [Nm].
        error: (N,) planned less measured normal force [N]; 0 where free.
        status: what gave way.
    """

    tau: Array
    error: Array
    status: TorqueStatus


@kernel
def internal_part(normals: Array, points: Array, mode: IntArray) -> Array:
    """(N, N) P: the part of normal force errors that the second stage acts on.

    Of the fingers that hold it is the null space of the map from their presses to the wrench on
    the object, P = λ² (GᵀG + λ²)⁻¹: a bounded, smooth form, for presses that nearly balance are
    as internal as those that do. Sliding tips stand for themselves, free ones for nothing.

    Args:
        normals: (N, 3) outward; points: (N, 3) from the object's origin [m].
    """
    n = mode.shape[0]
    part = np.zeros((n, n))
    holds = np.flatnonzero(mode == _FIXED)
    count = holds.shape[0]
    for i in range(n):
        if mode[i] == _SLIDING:
            part[i, i] = 1.0
    if count == 0:
        return part
    length = 1e-9
    for k in range(count):
        point = points[holds[k]]
        length = max(length, np.sqrt(np.sum(point * point)))
    wrench = np.empty((count, 6))  # a row for each press
    for k in range(count):
        wrench[k, :3] = normals[holds[k]]
        wrench[k, 3:] = cross(points[holds[k]], normals[holds[k]]) / length
    square = _BALANCE * _BALANCE * np.eye(count)
    inside = np.linalg.solve(wrench @ wrench.T + square, square)
    for k in range(count):
        for j in range(count):
            part[holds[k], holds[j]] = inside[k, j]
    return part


@kernel
def _assembled(
    own: BoolArray, linear: Array, tips: Array, wanted: Array, normals: Array, force: Array,
    press: Array, position: Array, tau: Array,
) -> None:  # fmt: skip
    """Add J_iᵀ(k_P Δp_i + f_di − n (press)) to the torques; arms get J_iᵀ f_di.

    Args:
        own: (N, nv) joints of the fingers themselves.
        press: (N,) what force control adds along the inward normal [N].
    """
    for i in range(tips.shape[0]):
        for j in range(tau.shape[0]):
            for r in range(3):
                push = force[i, r]
                if own[i, j]:
                    push += position[i] * (wanted[i, r] - tips[i, r]) - press[i] * normals[i, r]
                tau[j] += linear[i, r, j] * push


def finger_joints(model: RobotModel, tips: tuple[str, ...]) -> BoolArray:
    """(nv,) joints that carry one of the tips only; the others are arms and torso.

    What counts is the tree and not what a joint looks like: joints that carry several tips are an
    arm's, and so are those that carry none; where an arm ends in a single tip, all its joints are
    the finger's.

    Args:
        tips: frames of the fingertips; a name given twice is one tip.
    """
    chains = (model.support(model.frame(tip)) for tip in set(tips))
    carried: Array = sum(chains, np.zeros(model.nv))
    single: BoolArray = carried == 1.0
    return single


@final
class ForceControl:
    """(36) for all fingers of a robot, joint control for the rest; holds no state between ticks.

    Attributes:
        fingers: (nv,) joints that carry one tip only; the others are arms and torso.
        gains: as given.
    """

    def __init__(self, model: RobotModel, tips: tuple[str, ...], gains: ForceGains) -> None:
        """
        Args:
            tips: (N,) frames of the fingertips; fingers may share one.
        """
        self.fingers = finger_joints(model, tips)
        chains = [model.support(model.frame(tip)) > 0.0 for tip in tips]
        self._own = np.array([chain & self.fingers for chain in chains]).reshape(-1, model.nv)
        self.gains = gains
        self._kin = Kinematics(model, tips)
        self._wanted = Kinematics(model, tips)
        self._dynamics = InverseDynamics(model)
        self._nv = model.nv

    def init(self) -> TorqueState:
        """Before the first tick: at rest, integrators too."""
        none = np.zeros(self._nv)
        tips, track = np.zeros(len(self._own)), Track(none, none, none, none, none)
        return TorqueState(tips, tips, none, none, track)

    def step(
        self, state: TorqueState, goal: Goal, measured: Measurement, dt: float
    ) -> tuple[Command, TorqueState]:
        """One tick. Never raises on numbers, never NaN: what gave way is in the status."""
        none = np.zeros(len(self._own))
        if not all(_sound(part) for part in goal):
            return Command(state.tau.copy(), none, TorqueStatus.BAD_COMMAND), state
        state = state._replace(track=state.track.then(goal.q, goal.v, dt))
        if not self._usable(measured):
            return Command(state.tau.copy(), none, TorqueStatus.BAD_MEASUREMENT), state
        q, _, force = _all(measured)
        error, acted = _errors(goal, force)
        touching, gains, status = goal.mode != ContactMode.FREE, self.gains, TorqueStatus.OK
        before = state._replace(integral=np.where(touching, state.integral, 0.0))
        share = 1.0 - math.exp(-dt / gains.smoothing) if gains.smoothing > 0.0 else 1.0
        now = before._replace(
            error=np.where(touching, state.error + share * (acted - state.error), 0.0),
            integral=np.clip(
                before.integral + dt * gains.integral * acted, -gains.windup, gains.windup
            ),
            joint_integral=np.clip(
                before.joint_integral + dt * gains.joint_integral * (goal.q - q),
                -gains.joint_windup, gains.joint_windup,
            ),
        )  # fmt: skip
        tau = self.torques(now, goal, measured)
        beyond = tau - np.clip(tau, gains.tau_min, gains.tau_max)
        if beyond.any():  # what a limit holds back is not to be integrated, but may be taken back
            status |= TorqueStatus.SATURATED
            more = now.integral - before.integral
            torque = -np.einsum("irj,ir,i->ij", self._kin.linear, goal.normals, more)
            waits = (self._own & (torque * beyond > 0.0)).any(axis=1)
            further = (now.joint_integral - before.joint_integral) * beyond > 0.0
            now = now._replace(
                integral=np.where(waits, before.integral, now.integral),
                joint_integral=np.where(further, before.joint_integral, now.joint_integral),
            )
            tau = np.clip(self.torques(now, goal, measured), gains.tau_min, gains.tau_max)
        at_bound = (np.abs(now.integral) >= gains.windup) & touching & (gains.integral > 0.0)
        if at_bound.any():
            status |= TorqueStatus.INTEGRAL_LIMIT
        return Command(tau, error, status), now._replace(tau=tau)

    def torques(
        self, state: TorqueState, goal: Goal, measured: Measurement, elapsed: float = 0.0
    ) -> Array:
        """(nv,) of the law a time [s] into the tick that `state` is of, without limits."""
        gains, track = self.gains, state.track.at(elapsed)
        q, v, force = _all(measured)
        kin = self._kin.update(q)
        # about the palm where it is, or where it should be
        arms = q if gains.relative else track.q
        wanted = self._wanted.update(np.where(self.fingers, track.q, arms))
        acted = state.error if gains.smoothing > 0.0 else _errors(goal, force)[1]
        none = np.zeros(self._nv)
        tau = self._dynamics.torques(
            q, v if gains.inertia else none, track.a if gains.inertia else none
        )
        tau += gains.stiffness * (track.q - q) + gains.damping * (track.v - v)
        tau += state.joint_integral
        _assembled(
            self._own, kin.linear, kin.position, wanted.position, goal.normals, goal.force,
            gains.force * acted + state.integral, gains.position, tau,
        )  # fmt: skip
        return tau

    def _usable(self, measured: Measurement) -> bool:
        """Whether everything is there, finite and of the right size."""
        if measured.v is None or measured.force is None:
            return False
        sizes = ((self._nv,), (self._nv,), (len(self._own), 3))
        return all(
            np.shape(x) == size and _sound(x)
            for x, size in zip((measured.q, measured.v, measured.force), sizes, strict=True)
        )


def _errors(goal: Goal, force: Array) -> tuple[Array, Array]:
    """(N,) planned less measured normal forces, and the part of them that is acted on [N]."""
    error = np.einsum("ir,ir->i", goal.normals, force - goal.force)
    error[goal.mode == ContactMode.FREE] = 0.0
    return error, internal_part(goal.normals, goal.points, goal.mode) @ error


def _sound(values: Array | IntArray) -> bool:
    """Whether these are numbers that a robot can have to do with."""
    return bool((np.abs(values) < _HUGE).all())


def _all(measured: Measurement) -> tuple[Array, Array, Array]:
    """Everything measured, of a measurement that is usable."""
    if measured.v is None or measured.force is None:
        raise ValueError("velocities and forces are not measured")
    return measured.q, measured.v, measured.force
