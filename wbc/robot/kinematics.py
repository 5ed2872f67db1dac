"""Kinematics of the robot at one configuration: computed once, then handed on as a token."""

from __future__ import annotations

from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray
from wbc.compiled import kernel
from wbc.errors import WbcError
from wbc.robot.model import RobotModel


def placements(poses: Any, *, writeable: bool = False) -> Array:
    """All placements of a Pinocchio vector of SE3 as one array that follows it, shape (n, 12).

    Columns: the rotation column by column, then the translation. Pinocchio keeps them in one block;
    a view of it spares two calls per placement and tick. The layout is verified here, address by
    address, so that a Pinocchio which changes it is refused at load rather than misread.

    Raises:
        WbcError: another layout than the one known.
    """
    first = poses[0].rotation
    base = first.__array_interface__["data"][0]
    for k in range(len(poses)):
        r, t = poses[k].rotation, poses[k].translation
        addresses = [x.__array_interface__["data"][0] for x in (r, t)]
        if addresses != [base + 96 * k, base + 96 * k + 72] or r.strides != (8, 24):
            raise WbcError("this version of pinocchio lays out its placements in an unknown way")
    return np.lib.stride_tricks.as_strided(first, (len(poses), 12), (96, 8), writeable=writeable)


@kernel
def _expand(
    q: Array, master: IntArray, ratio: Array, offset: Array, q_own: Array, q_full: Array
) -> None:
    """Keep q and the positions of all joints at it."""
    q_own[:] = q
    for k in range(master.shape[0]):
        q_full[k] = ratio[k] * q[master[k]] + offset[k]


@kernel
def _frames(
    poses: Array, ids: IntArray, joint_jacobian: Array, chains: IntArray, leads: BoolArray,
    master: IntArray, ratio: Array,
    position: Array, rotation: Array, linear: Array, angular: Array,
) -> None:  # fmt: skip
    """Placements and Jacobians of all tracked frames (25).

    A joint's column holds the velocity of the world's origin and the angular velocity; a frame at p
    moves with v + ω × p if the joint carries it. Columns of joints that do not carry a frame are
    never written.
    """
    for f in range(ids.shape[0]):
        pose = poses[ids[f]]
        for c in range(3):
            rotation[f, 0, c] = pose[3 * c]
            rotation[f, 1, c] = pose[3 * c + 1]
            rotation[f, 2, c] = pose[3 * c + 2]
        x, y, z = pose[9], pose[10], pose[11]
        position[f, 0], position[f, 1], position[f, 2] = x, y, z
        for i in range(chains.shape[1]):
            k = chains[f, i]
            if k < 0:
                break
            j, r = master[k], ratio[k]
            a, b, c = joint_jacobian[3, k], joint_jacobian[4, k], joint_jacobian[5, k]
            u = r * (joint_jacobian[0, k] + b * z - c * y)
            v = r * (joint_jacobian[1, k] + c * x - a * z)
            w = r * (joint_jacobian[2, k] + a * y - b * x)
            if leads[f, i]:
                linear[f, 0, j], linear[f, 1, j], linear[f, 2, j] = u, v, w
                angular[f, 0, j], angular[f, 1, j], angular[f, 2, j] = r * a, r * b, r * c
            else:
                linear[f, 0, j] += u
                linear[f, 1, j] += v
                linear[f, 2, j] += w
                angular[f, 0, j] += r * a
                angular[f, 1, j] += r * b
                angular[f, 2, j] += r * c


@kernel
def _gather(columns: Array, master: IntArray, ratio: Array, out: Array) -> None:
    """Columns by the independent joints from columns by all joints, (3, n_full) to (3, nv)."""
    out[:] = 0.0
    for k in range(master.shape[0]):
        for r in range(out.shape[0]):
            out[r, master[k]] += ratio[k] * columns[r, k]


def _listed(chains: list[list[int]], master: IntArray) -> tuple[IntArray, BoolArray]:
    """Chains as rows padded with -1, and where each is the first of its master's joints."""
    width = max(map(len, chains), default=0)
    rows = np.full((len(chains), width), -1, dtype=np.int64)
    leads = np.zeros((len(chains), width), dtype=np.bool_)
    for f, chain in enumerate(chains):
        rows[f, : len(chain)] = chain
        masters = master[chain].tolist()
        leads[f, : len(chain)] = [masters.index(m) == i for i, m in enumerate(masters)]
    return rows, leads


@final
class Kinematics:
    """Frames, Jacobians and (where asked for) the centre of mass at one q.

    The arrays are this object's workspace: `update` overwrites them and returns the object, and
    what is read until the next `update` belongs to that q. Frames are known by their place in
    `frames`. Jacobians are by the independent joints, the motion of those that follow included.

    Attributes:
        model: the robot.
        frames: names of the tracked frames, F of them.
        q: (nv,) the configuration, [rad] or [m].
        position: (F, 3) origins in the world, [m].
        rotation: (F, 3, 3) orientations in the world.
        linear, angular: (F, 3, nv) Jacobians of the origins' velocity and of the angular velocity,
            in the world's axes (25).
        chains: (F, L) the joints (k of n_full) that carry each frame, from the root, padded with
            -1.
        leads: (F, L) where in its chain an independent joint is met for the first time, by itself
            or by one that follows it.
        com, com_jacobian: (3,) [m] and (3, nv), fresh only if `track_com`.
        joint_poses: (njoints, 12) placements of all joints, as from `placements`.
        joint_jacobian: (6, n_full) a view of Pinocchio's: column k is what joint k alone gives, the
            velocity of the point of the body that is at the world's origin, then the angular
            velocity, in the world's axes; the columns are contiguous.
    """

    def __init__(
        self, model: RobotModel, frames: tuple[str, ...], *, track_com: bool = False
    ) -> None:
        self.model = model
        self.frames = frames
        self.track_com = track_com
        self.data: Any = model.pin_model.createData()
        count, nv = len(frames), model.nv
        self._coupled = model.n_full > nv
        self.q: Array = np.zeros(nv)
        self._q_full: Array = model.full(self.q) if self._coupled else self.q
        self.position: Array = np.zeros((count, 3))
        self.rotation: Array = np.zeros((count, 3, 3))
        self.linear: Array = np.zeros((count, 3, nv))
        self.angular: Array = np.zeros((count, 3, nv))
        self.com: Array = np.zeros(3)
        self.com_jacobian: Array = np.zeros((3, nv))
        ids = [model.frame(name) for name in frames]
        self.chains, self.leads = _listed([model.frame_chain(i) for i in ids], model.master)
        self._ids = np.array(ids, dtype=np.int64)
        self._frame_poses = placements(self.data.oMf)
        self.joint_poses = placements(self.data.oMi)
        # of a robot with one joint, Pinocchio's matrices arrive with one dimension
        self.joint_jacobian: Array = self.data.J.reshape(6, model.n_full, order="F")
        self._com_jacobian: Array = self.data.Jcom.reshape(3, model.n_full, order="F")

    def update(self, q: Array) -> Kinematics:
        """Bring everything to q, shape (nv,), finite."""
        self._take(q)
        model = self.model
        pin.computeJointJacobians(model.pin_model, self.data, self._q_full)
        pin.updateFramePlacements(model.pin_model, self.data)
        _frames(
            self._frame_poses, self._ids, self.joint_jacobian, self.chains, self.leads,
            model.master, model.ratio, self.position, self.rotation, self.linear, self.angular,
        )  # fmt: skip
        if self.track_com:
            # without q it takes the joints' placements as they are, and subtrees need no centres
            pin.jacobianCenterOfMass(model.pin_model, self.data, False)
            _gather(self._com_jacobian, model.master, model.ratio, self.com_jacobian)
            self.com[:] = self.data.com[0]
        return self

    def update_placements(self, q: Array) -> Kinematics:
        """Bring only the joint placements to q (for predicted costs); Jacobians stay behind."""
        self._take(q)
        pin.forwardKinematics(self.model.pin_model, self.data, self._q_full)
        return self

    def _take(self, q: Array) -> None:
        if self._coupled:
            model = self.model
            _expand(q, model.master, model.ratio, model.offset, self.q, self._q_full)
        else:
            self.q[:] = q

    def index(self, frame: str) -> int:
        """Place of a tracked frame."""
        return self.frames.index(frame)
