"""The exchange in MuJoCo: physics that no one here wrote, behind the interface of every engine."""

from __future__ import annotations

import copy
import math
from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.grasp import ContactMode
from wbc.sim.mujoco_model import OBJECT_BIT, MujocoModel, wxyz
from wbc.sim.mujoco_shapes import mujoco
from wbc.sim.plant import Plant, Sensed


@final
class MujocoPlant(Plant):
    """Robot and object in MuJoCo.

    Two plants of one model step independently: each has the state of its own. Forces and slip are
    those of the last physics step of a tick.

    Attributes:
        model, data: mujoco.MjModel and MjData, e.g. for a viewer; the model is the plant's own.
    """

    def __init__(self, model: MujocoModel, *, fixture: bool = False) -> None:
        """
        Args:
            fixture: the object is held where `reset` puts it until `release`.
        """
        self._mj = mujoco()
        self._map = model
        # a model of its own: step and friction are changed in it
        self.model: Any = copy.copy(model.model)
        self.data: Any = self._mj.MjData(self.model)
        self._fixture = fixture
        self._friction: Array = np.array(self.model.geom_friction[model.pad_geom, 0])
        self._hold: BoolArray = np.ones(len(model.pad_geom), dtype=np.bool_)
        self._slip: Array = np.zeros(len(model.pad_geom))
        warnings = self._mj.mjtWarning
        self._fatal = [int(kind) for kind in (
            warnings.mjWARN_BADQPOS, warnings.mjWARN_BADQVEL, warnings.mjWARN_BADQACC,
            warnings.mjWARN_BADCTRL)]  # fmt: skip
        self._lost = False

    @property
    def held(self) -> bool:
        """Whether the fixture holds the object."""
        return bool(self.data.eq_active[self._map.fixture])

    def reset(self, q: Array, v: Array, position: Array, rotation: Array) -> Sensed:
        """See `Plant.reset`; the fixture, if there is one, takes hold of the object."""
        where, data, robot = self._map, self.data, self._map.robot
        self._mj.mj_resetData(self.model, data)
        data.qpos[where.position] = robot.full(q)
        data.qvel[where.velocity] = robot.ratio * np.asarray(v, dtype=np.float64)[robot.master]
        at = where.object_position
        data.qpos[at : at + 3], data.qpos[at + 3 : at + 7] = position, wxyz(rotation)
        data.mocap_pos[where.fixture_body] = data.qpos[at : at + 3]
        data.mocap_quat[where.fixture_body] = data.qpos[at + 3 : at + 7]
        data.eq_active[where.fixture] = self._fixture
        self._slip[:] = 0.0
        self._lost = False
        self.treat(np.full(len(self._hold), ContactMode.FIXED))
        self.disturb(np.zeros(3), np.zeros(len(self._hold), dtype=np.bool_))
        self._mj.mj_forward(self.model, data)
        return self._sensed(0.0)

    def treat(self, mode: IntArray) -> None:
        """See `Plant.treat`."""
        self._hold = mode == ContactMode.FIXED
        mu = np.where(mode == ContactMode.SLIDING, self._map.sliding_friction, self._friction)
        self.model.geom_friction[self._map.pad_geom, 0] = mu

    def release(self) -> None:
        """As `Plant.release`."""
        self.data.eq_active[self._map.fixture] = False

    def disturb(self, push: Array, lost: BoolArray) -> None:
        """As `Plant.disturb`, until `reset`; tips whose contact is lost go through the object."""
        where, data = self._map, self.data
        body = where.object_body
        arm = data.xpos[body] - data.xipos[body]
        data.xfrc_applied[body] = [*push, *np.cross(arm, push)]
        gone = where.pad_geom[lost]
        self.model.geom_conaffinity[where.pad_geom] = where.model.geom_conaffinity[where.pad_geom]
        self.model.geom_conaffinity[gone] &= ~OBJECT_BIT

    def step(self, tau: Array, dt: float) -> Sensed:
        """See `Plant.step`: as few physics steps of equal length as keep to the model's largest."""
        steps = max(1, math.ceil(dt / self._map.model.opt.timestep - 1e-9))
        self.model.opt.timestep = dt / steps
        self._lost = self._lost or not np.isfinite(tau).all()
        if not self._lost:
            self.data.ctrl[self._map.motor] = tau
            self._mj.mj_step(self.model, self.data, nstep=steps)
            self._lost = any(self.data.warning[kind].number for kind in self._fatal)
        return _no_numbers(self._map) if self._lost else self._sensed(dt)

    def _sensed(self, dt: float) -> Sensed:
        where, data = self._map, self.data
        own = where.robot.own
        force = self._contacts(dt)
        at = where.object_position
        w, x, y, z = data.qpos[at + 3 : at + 7]
        return Sensed(
            q=np.array(data.qpos[where.position[own]]),
            v=np.array(data.qvel[where.velocity[own]]),
            force=force,
            object_position=np.array(data.qpos[at : at + 3]),
            object_rotation=pin.Quaternion(w, x, y, z).normalized().toRotationMatrix(),
            slip=np.array(self._slip),
        )

    def _contacts(self, dt: float) -> Array:
        """(N, 3) forces of the pads on the object; what slides adds to the slip.

        MuJoCo's force acts on the second geom of a contact, whose frame's rows are the axes.
        """
        where, data = self._map, self.data
        force = np.zeros((len(where.pad_geom), 3))
        wrench = np.zeros(6)
        pairs = np.array(data.contact.geom).reshape(-1, 2)
        for c in np.flatnonzero(np.any(pairs == where.object_geom, axis=1)):
            second = pairs[c, 1] == where.object_geom
            mine = where.pad_geom == pairs[c, 0 if second else 1]
            if not mine.any():
                continue
            self._mj.mj_contactForce(self.model, data, int(c), wrench)
            axes = data.contact.frame[c].reshape(3, 3)
            on_object = axes.T @ wrench[:3]
            force[mine] += on_object if second else -on_object
            if wrench[0] > 0.0:
                body = int(where.pad_body[np.flatnonzero(mine)[0]])
                point = data.contact.pos[c]
                across = axes[1:] @ (self._velocity(body, point) - self._velocity(
                    where.object_body, point))  # fmt: skip
                self._slip[mine & self._hold] += dt * float(np.linalg.norm(across))
        return force

    def _velocity(self, body: int, point: Array) -> Array:
        """(3,) velocity of a body's point in the world [m/s]."""
        data = self.data
        twist, origin = data.cvel[body], data.subtree_com[self.model.body_rootid[body]]
        out: Array = twist[3:] + np.cross(twist[:3], point - origin)
        return out


def _no_numbers(model: MujocoModel) -> Sensed:
    nv, contacts = model.robot.nv, len(model.pad_geom)
    shapes = ((nv,), (nv,), (contacts, 3), (3,), (3, 3), (contacts,))
    return Sensed(*(np.full(shape, np.nan) for shape in shapes))
