"""The chapter's simulation: rigid bodies, soft fingertips, the classical Runge-Kutta rule.

Robot: M(q) v̇ + h(q, v) = τ + Σ J_iᵀ f_i over the independent joints. Object: free, Newton-Euler
about its centre of mass. Between them the pads of `wbc.sim.pads`. One step of the rule evaluates
all of it four times; the object's rotation goes by its exponential coordinates over the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray
from wbc.compiled import kernel
from wbc.contact.grasp import ContactMode
from wbc.contact.surfaces import Surface
from wbc.control.state import Measurement
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel
from wbc.rotations import cross, dexp_inverse, exp_so3, rotate
from wbc.sim.feet import Feet
from wbc.sim.pads import Pads, pad_forces
from wbc.sim.plant import Plant, Sensed, no_numbers

Feedback: TypeAlias = Callable[[float, Measurement], Array]
"""Torques (nv,) from the time since the step began [s] and what is measured there."""

_HUGE = 1e10
"""No position, velocity or energy of a robot is as large in SI units: there the rule has
diverged."""


@dataclass(frozen=True)
class FreeBody:
    """The object as a rigid body.

    Attributes:
        mass: [kg].
        com: (3,) centre of mass, object frame [m].
        inertia: (3,) about it, principal: object's axes [kg m²]; in the plane only the last counts.
    """

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class Physics:
    """What the simulation is told beside robot, object and pads.

    Attributes:
        step: longest step of the rule [s].
        friction: (N,) μ of tips that hold or come to hold.
        sliding_friction: (N,) μ of tips that slide on purpose.
        armature: (nv,) reflected inertia of the motors, added to M's diagonal.
        joint_damping: (nv,) viscous friction of the joints [Nm s/rad].
    """

    step: float
    friction: Array
    sliding_friction: Array
    armature: Array
    joint_damping: Array


@kernel
def _joint_accelerations(
    mass: Array, drift: Array, v: Array, tau: Array, force: Array, linear: Array, armature: Array,
    joint_damping: Array, master: IntArray, ratio: Array, out: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """v̇ of the independent joints; kinetic energy, power of the torques and of joint friction.

    Args:
        mass: (n_full, n_full) of all joints, of which the upper triangle counts; reduced by virtual
            work, M = Sᵀ M_full S with S the ratios.
        drift: (n_full,) M_full's Coriolis, centrifugal and gravity torques.
        force: (N, 3) of the tips on the object; `linear` (N, 3, nv) the tips' Jacobians.
        out: (nv,) filled with v̇; NaN where forces or torques are not finite.
    """
    nv, full = v.shape[0], master.shape[0]
    m, rest = np.zeros((nv, nv)), tau - joint_damping * v
    for a in range(full):
        rest[master[a]] -= ratio[a] * drift[a]
        m[master[a], master[a]] += ratio[a] * ratio[a] * mass[a, a]
        for b in range(a + 1, full):
            term = ratio[a] * ratio[b] * mass[a, b]
            m[master[a], master[b]] += term
            m[master[b], master[a]] += term
    for j in range(nv):
        m[j, j] += armature[j]
        for i in range(force.shape[0]):
            for r in range(3):
                rest[j] -= linear[i, r, j] * force[i, r]
    if np.isfinite(m).all() and np.isfinite(rest).all():  # else `solve` would raise
        out[:] = np.linalg.solve(m, rest)
    else:
        out[:] = np.nan
    kinetic = 0.5 * np.sum(v * (m @ v))
    return kinetic, np.sum(v * tau), np.sum(joint_damping * v * v)


@kernel
def _pushed(push: Array, arm: Array, velocity: Array, spin: Array, wrench: Array) -> float:
    """Add a force at `arm` from the centre of mass to the wrench about it; its power."""
    wrench[:3] += push
    wrench[3:] += cross(arm, push)
    return float(np.sum(push * (velocity + cross(spin, arm))))


@kernel
def _body_rates(
    rotation: Array, phi: Array, velocity: Array, spin: Array, mass: float, inertia: Array,
    gravity: Array, planar: bool, wrench: Array, out: Array,
) -> float:  # fmt: skip
    """Rates (12,) of position, φ, velocity and spin of the centre of mass; the kinetic energy."""
    own, turning, moment = np.empty(3), np.empty(3), np.empty(3)
    rotate(rotation.T, spin, own)
    rotate(rotation.T, wrench[3:], moment)
    if planar:
        moment[:2] = 0.0
    momentum = inertia * own
    moment -= cross(own, momentum)
    for r in range(3):
        moment[r] = moment[r] / inertia[r] if inertia[r] > 0.0 else 0.0
    rotate(rotation, moment, turning)
    out[:3] = velocity
    out[3:6] = dexp_inverse(phi, spin)
    out[6:9] = wrench[:3] / mass + gravity
    if planar:
        out[8] = 0.0
    out[9:] = turning
    return 0.5 * mass * np.sum(velocity * velocity) + 0.5 * np.sum(own * momentum)


@final
class CompliantPlant(Plant):
    """Robot, object and pads under torques.

    What has diverged stays as it is, and is said to be no numbers, until `reset`.

    Attributes:
        energy: of everything, kinetic, of gravity and in springs, at the last evaluation [J].
        work, lost: what the torques have put in and what dampers and sliding have taken, since
            `reset` [J], by the same rule: energy = energy at reset + work − lost to its accuracy.
        momentum: (6,) of the object, linear [kg m/s] and angular about the world's origin.
        feet: the surface points below the tips.
    """

    def __init__(
        self, model: RobotModel, tips: tuple[str, ...], surface: Surface, body: FreeBody,
        pads: Pads, physics: Physics, *, fixture: bool = False,
    ) -> None:  # fmt: skip
        """
        Args:
            tips: (N,) frames of the fingertips.
            fixture: the object is held where `reset` puts it until `release`.
        """
        n, nv = len(tips), model.nv
        self._model = model
        self._kin = Kinematics(model, tips)
        self._data: Any = model.pin_model.createData()
        self._body = body
        self._pads = pads
        self._physics = physics
        self._planar = surface.planar
        self._inertia = body.inertia * (np.array([0.0, 0.0, 1.0]) if surface.planar else 1.0)
        gravity = np.array(model.pin_model.gravity.linear)
        self._gravity = gravity * (np.array([1.0, 1.0, 0.0]) if surface.planar else 1.0)
        self.feet = Feet(surface, pads.rest_length)
        self._holds: BoolArray = np.ones(n, dtype=np.bool_)
        self._mu: Array = np.array(physics.friction)
        # q, v, then position, φ, velocity, spin of the object, bristles, slip, work, lost
        ends = np.cumsum([0, nv, nv, 3, 3, 3, 3, 3 * n, n, 2]).tolist()
        self._slices = [slice(a, b) for a, b in pairwise(ends)]
        self._body_rates = slice(ends[2], ends[6])
        self._y: Array = np.zeros(ends[-1])
        self._rotation: Array = np.eye(3)  # at the start of the step; φ is from there
        self._force: Array = np.zeros((n, 3))
        self._wrench: Array = np.zeros(6)
        self._fixture = self._held = fixture
        self._push: Array = np.zeros(3)
        self._bears: BoolArray = np.ones(n, dtype=np.bool_)
        self._slide: Array = np.zeros(n)
        self._v: Array = np.zeros(nv)
        self.energy = 0.0

    @property
    def work(self) -> float:
        """Of the torques since `reset` [J]."""
        return float(self._y[-2])

    @property
    def lost(self) -> float:
        """To dampers and sliding since `reset` [J]."""
        return float(self._y[-1])

    @property
    def momentum(self) -> Array:
        """(6,) of the object, linear [kg m/s], and angular about the world's origin [kg m²/s]."""
        _, _, com, _, velocity, spin, *_ = self._parts(self._y)
        linear = self._body.mass * velocity
        turning = self._rotation @ (self._inertia * (spin @ self._rotation))
        return np.concatenate([linear, turning + np.cross(com, linear)])

    def reset(
        self, q: Array, v: Array, position: Array, rotation: Array, twist: Array | None = None
    ) -> Sensed:
        """As `Plant.reset`; no torques act while it is looked at.

        Args:
            twist: (6,) velocity of the object's centre of mass [m/s] and its turning rate [rad/s],
                world axes; at rest where not given.
        """
        self._y[:] = 0.0
        mine_q, mine_v, com, _, velocity, spin, *_ = self._parts(self._y)
        mine_q[:], mine_v[:] = q, v
        if twist is not None:
            velocity[:], spin[:] = twist[:3], twist[3:]
        self._rotation = np.array(rotation, dtype=np.float64)
        com[:] = position + self._rotation @ self._body.com
        self._held = self._fixture
        self.treat(np.full(len(self._holds), ContactMode.FIXED))
        self.disturb(np.zeros(3), np.zeros(len(self._holds), dtype=np.bool_))
        self.feet.forget()
        return self._sensed()

    def treat(self, mode: IntArray) -> None:
        """As `Plant.treat`: tips that slide on purpose have the friction of sliding ones."""
        self._holds = mode == ContactMode.FIXED
        given = self._physics
        self._mu = np.where(mode == ContactMode.SLIDING, given.sliding_friction, given.friction)

    def disturb(self, push: Array, lost: BoolArray) -> None:
        """As `Plant.disturb`; the work of the push is part of `work`."""
        self._push, self._bears = np.array(push, dtype=np.float64), ~lost

    def release(self) -> None:
        """As `Plant.release`."""
        self._held = False

    def step(self, tau: Array, dt: float) -> Sensed:
        """As `Plant.step`."""
        return self._advanced(lambda _: tau, dt)

    def step_feedback(self, feedback: Feedback, dt: float) -> Sensed:
        """Advance by dt with torques that are a function of the state in every evaluation.

        This is how the chapter's figures were computed; a robot holds its torques over a tick.
        """
        return self._advanced(lambda elapsed: feedback(elapsed, self._measured()), dt)

    def _parts(self, y: Array) -> list[Array]:
        return [y[part] for part in self._slices]

    def _measured(self) -> Measurement:
        return Measurement(self._kin.q.copy(), self._v, self._force.copy())

    def _sensed(self) -> Sensed:
        if _diverged(self._y):
            return no_numbers(self._model.nv, len(self._holds))
        self._begin()
        self._rates(self._y, lambda _: np.zeros(self._model.nv), 0.0)
        q, v, com, _, _, _, _, slip, _ = (part.copy() for part in self._parts(self._y))
        position = com - self._rotation @ self._body.com
        return Sensed(q, v, self._force.copy(), position, self._rotation.copy(), slip)

    def _begin(self) -> None:
        """Rotation of the step, and the feet of the tips, at `self._y`."""
        q, _, com, phi, *_ = self._parts(self._y)
        self._rotation = exp_so3(phi) @ self._rotation
        phi[:] = 0.0
        tips = self._kin.update(q).position
        self.feet.begin((tips - (com - self._rotation @ self._body.com)) @ self._rotation)

    def _advanced(self, torques: Callable[[float], Array], dt: float) -> Sensed:
        count = max(1, math.ceil(dt / self._physics.step - 1e-9))
        h = dt / count
        for k in range(count):
            y, t = self._y, k * h
            if _diverged(y):
                break
            if k:  # what is sensed before a step has begun it
                self._begin()
            with np.errstate(over="ignore", invalid="ignore"):  # where it diverges
                a = self._rates(y, torques, t)
                b = self._rates(y + 0.5 * h * a, torques, t + 0.5 * h)
                c = self._rates(y + 0.5 * h * b, torques, t + 0.5 * h)
                d = self._rates(y + h * c, torques, t + h)
                self._y = y + h / 6.0 * (a + 2.0 * (b + c) + d)
        return self._sensed()

    def _rates(self, y: Array, torques: Callable[[float], Array], elapsed: float) -> Array:
        """dy/dt, NaN where y has diverged; leaves the contact forces and the energy behind."""
        out = np.full_like(y, np.nan)
        if _diverged(y):
            return out
        q, v, com, phi, velocity, spin, bristles, _, _ = self._parts(y)
        q_rate, v_rate, _, _, _, _, bristle_rate, slip_rate, account = self._parts(out)
        kin, pads, model, given = self._kin.update(q), self._pads, self._model, self._physics
        self._v = v
        rotation = exp_so3(phi) @ self._rotation
        origin = com - rotation @ self._body.com
        records = self.feet.follow((kin.position - origin) @ rotation)
        stored, lost = pad_forces(
            self.feet.near & self._bears, records, kin.position, kin.linear @ v, origin, rotation,
            com, velocity, spin, *pads, self._mu, bristles.reshape(-1, 3), self._force,
            bristle_rate.reshape(-1, 3), self._slide, self._wrench,
        )  # fmt: skip
        pushed = _pushed(self._push, origin - com, velocity, spin, self._wrench)
        tau = torques(elapsed)
        full = model.full(q)
        full_v = model.ratio * v[model.master]
        mass = pin.crba(model.pin_model, self._data, full)
        drift = pin.nonLinearEffects(model.pin_model, self._data, full, full_v)
        kinetic, power, rubbed = _joint_accelerations(
            mass, drift, v, tau, self._force, kin.linear, given.armature, given.joint_damping,
            model.master, model.ratio, v_rate,
        )  # fmt: skip
        moving = _body_rates(
            rotation, phi, velocity, spin, self._body.mass, self._inertia, self._gravity,
            self._planar, self._wrench, out[self._body_rates],
        )  # fmt: skip
        if self._held:
            out[self._body_rates] = 0.0
        q_rate[:] = v
        slip_rate[:] = self._slide * self._holds
        account[:] = power + pushed, lost + rubbed
        height = pin.computePotentialEnergy(model.pin_model, self._data, full)
        height -= self._body.mass * float(self._gravity @ com)
        self.energy = kinetic + moving + stored + height
        return out


def _diverged(y: Array) -> bool:
    """Whether a state is none that a robot can be in; also where parts are not finite."""
    return not bool((np.abs(y) < _HUGE).all())
