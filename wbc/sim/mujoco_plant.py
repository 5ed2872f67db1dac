"""The exchange in MuJoCo: physics that no one here wrote, behind the interface of every engine."""

from __future__ import annotations

import copy
import math
from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray
from wbc.compiled import kernel
from wbc.contact.grasp import ContactMode
from wbc.rotations import cross, exp_so3
from wbc.sim.mujoco_model import OBJECT_BIT, MujocoModel, wxyz
from wbc.sim.mujoco_plane import Followed
from wbc.sim.mujoco_shapes import mujoco
from wbc.sim.plant import Plant, Sensed, no_numbers


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
        self._off: BoolArray = np.zeros(len(model.pad_geom), dtype=np.bool_)
        self._followed = None if model.plates is None else Followed(model.plates)
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
        """See `Plant.reset`; a fixture takes hold of the object there, a table is put below it."""
        where, data, robot = self._map, self.data, self._map.robot
        self._mj.mj_resetData(self.model, data)
        data.qpos[where.position] = robot.full(q)
        data.qvel[where.velocity] = robot.ratio * np.asarray(v, dtype=np.float64)[robot.master]
        at = where.object_position
        if where.plates is not None:
            angle = math.atan2(rotation[1, 0], rotation[0, 0])
            data.qpos[at : at + 3] = position[0], position[1], angle
        else:
            data.qpos[at : at + 3], data.qpos[at + 3 : at + 7] = position, wxyz(rotation)
        for body in (where.fixture_body, where.table_body):
            if body >= 0:
                data.mocap_pos[body], data.mocap_quat[body] = position, wxyz(rotation)
        data.eq_active[where.fixture] = self._fixture
        self._slip[:] = 0.0
        self._lost = False
        self.treat(np.full(len(self._hold), ContactMode.FIXED))
        self.disturb(np.zeros(3), np.zeros(len(self._hold), dtype=np.bool_))
        if self._followed is not None:
            self._followed.forget()
            self._followed.place(self._mj, self.model, data, where.object_body, self._off)
        self._mj.mj_forward(self.model, data)
        return self._sensed(0.0)

    def treat(self, mode: IntArray) -> None:
        """See `Plant.treat`."""
        self._hold = mode == ContactMode.FIXED
        mu = np.where(mode == ContactMode.SLIDING, self._map.sliding_friction, self._friction)
        if self._map.plates is not None:
            self.model.pair_friction[self._map.plates.pair, :2] = mu[:, None]
        else:
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
        self._off = np.array(lost)
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
            self._advance(steps)
            self._lost = bool(self.data.warning.number[self._fatal].any())
        if self._lost:
            return no_numbers(self._map.robot.nv, len(self._slip))
        return self._sensed(dt)

    def _advance(self, steps: int) -> None:
        if self._followed is None:
            self._mj.mj_step(self.model, self.data, nstep=steps)
            return
        for _ in range(steps):
            self._followed.place(self._mj, self.model, self.data, self._map.object_body, self._off)
            self._mj.mj_step(self.model, self.data)

    def _object(self) -> tuple[Array, Array]:
        """Its position (3,) and rotation (3, 3)."""
        where, qpos = self._map, self.data.qpos
        at = where.object_position
        if where.plates is not None:
            x, y, angle = qpos[at : at + 3]
            return np.array([x, y, 0.0]), exp_so3(np.array([0.0, 0.0, angle]))
        w, x, y, z = qpos[at + 3 : at + 7]
        turned: Array = pin.Quaternion(w, x, y, z).normalized().toRotationMatrix()
        return np.array(qpos[at : at + 3]), turned

    def _sensed(self, dt: float) -> Sensed:
        where, data = self._map, self.data
        own = where.robot.own
        force = self._contacts(dt)
        position, rotation = self._object()
        return Sensed(
            q=np.array(data.qpos[where.position[own]]),
            v=np.array(data.qvel[where.velocity[own]]),
            force=force,
            object_position=position,
            object_rotation=rotation,
            slip=np.array(self._slip),
        )

    def _contacts(self, dt: float) -> Array:
        """(N, 3) forces of the pads on the object; what slides adds to the slip."""
        where, data, contact = self._map, self.data, self.data.contact
        force = np.zeros((len(where.pad_geom), 3))
        if len(contact.dist):
            _gathered(
                contact.geom, contact.frame, contact.pos, contact.efc_address, data.efc_force,
                where.object_geom, where.pad_geom, where.pad_body, where.object_body,
                self.model.body_rootid, data.subtree_com, data.cvel, dt, self._hold, force,
                self._slip,
            )  # fmt: skip
        return force


@kernel
def _gathered(
    geom: Any, frame: Array, pos: Array, address: Any, solved: Array, thing: IntArray,
    pad_geom: IntArray, pad_body: IntArray, object_body: int, root: Any, com: Array, twist: Array,
    dt: float, hold: BoolArray, force: Array, slip: Array,
) -> None:  # fmt: skip
    """Add the forces of the pads on the object, and the way of those that slide.

    With elliptic cones the solver's forces of a contact are those along the axes of its frame, the
    normal first, on its second geom; the axes are the frame's rows.

    Args:
        geom, address: (n, 2) geoms of each contact, (n,) its first row in `solved`, below 0: none.
        frame, pos: (n, 9) axes, (n, 3) places of the contacts, world.
        solved: forces of all constraints.
        thing, pad_geom: (N,) geom of the object that each contact is on, and that of its pad.
        root, com, twist: MuJoCo's body_rootid, subtree_com and cvel.
        force, slip: (N, 3) [N] and (N,) [m], added to.
    """
    across, relative = np.empty(2), np.empty(3)
    for c in range(geom.shape[0]):
        row = address[c]
        for i in range(pad_geom.shape[0]):
            second = geom[c, 1] == thing[i]
            mine = geom[c, 0] if second else geom[c, 1]
            if row < 0 or mine != pad_geom[i] or not (second or geom[c, 0] == thing[i]):
                continue
            for r in range(3):
                on_second = (
                    frame[c, r] * solved[row]
                    + frame[c, 3 + r] * solved[row + 1]
                    + frame[c, 6 + r] * solved[row + 2]
                )
                force[i, r] += on_second if second else -on_second
            if hold[i] and solved[row] > 0.0:
                relative[:] = _velocity(pad_body[i], pos[c], root, com, twist)
                relative -= _velocity(object_body, pos[c], root, com, twist)
                for k in range(2):
                    across[k] = 0.0
                    for r in range(3):
                        across[k] += frame[c, 3 + 3 * k + r] * relative[r]
                slip[i] += dt * math.sqrt(across[0] * across[0] + across[1] * across[1])


@kernel
def _velocity(body: int, point: Array, root: Any, com: Array, twist: Array) -> Array:
    """(3,) velocity of a body's point in the world [m/s]."""
    return twist[body, 3:] + cross(twist[body, :3], point - com[root[body]])
