"""Pose, position and orientation of a frame of the robot in the world or in another of its frames.

The orientation's task function is the rotation vector from the reference to the frame,
σ = log(R R_refᵀ), in the axes of the world (or of the other frame) like the position's rows. Its
Jacobian carries the derivative of the logarithm: it is ∂σ/∂q̃ at any distance from the goal, |e| is
the angle that is missing, and at π, where σ changes its sign, all rows stay finite.

A planar task has the rows x, y and yaw: the joints turn about z alone, and so does σ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array, IntArray, read_only
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.rotations import log_jacobian, log_so3
from wbc.tasks.base import Task, TaskRows, coordinate_rows


@kernel
def _matrix(target: Array, start: int) -> Array:
    """The rotation stored row by row in target[start : start + 9]."""
    r = np.empty((3, 3))
    for k in range(9):
        r[k // 3, k % 3] = target[start + k]
    return r


@kernel
def _turn_rows(
    rotation: Array,
    angular: Array,
    reference: Array,
    spin: Array,
    planar: bool,
    error: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    """Rows of σ = log(R R_refᵀ), in the plane its z; R turns at `angular` q̇, R_ref at `spin`."""
    nv = angular.shape[1]
    if planar:
        e = reference @ rotation.T
        error[0] = np.arctan2(e[1, 0] - e[0, 1], e[0, 0] + e[1, 1])
        jacobian[0, :nv] = angular[2]
        rate[0] = spin[2]
        return
    sigma = log_so3(rotation @ reference.T)
    derivative = log_jacobian(sigma)
    error[:] = -sigma
    jacobian[:, :nv] = derivative @ angular
    # the reference turns under σ from the other side: ∂σ/∂t = −Λᵀ ω_ref
    rate[:] = derivative.T @ spin


@kernel
def _frame_pose_rows(
    position: Array,
    rotation: Array,
    linear: Array,
    angular: Array,
    frame: int,
    target: Array,
    planar: bool,
    error: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    k, nv = 2 if planar else 3, linear.shape[2]
    error[:k] = target[:k] - position[frame, :k]
    jacobian[:k, :nv] = linear[frame, :k]
    spin = np.zeros(3)
    if target.shape[0] == 18:
        rate[:k] = target[12 : 12 + k]
        spin[:] = target[15:]
    _turn_rows(
        rotation[frame], angular[frame], _matrix(target, 3), spin, planar,
        error[k:], jacobian[k:], rate[k:],
    )  # fmt: skip


@kernel
def _frame_orientation_rows(
    rotation: Array,
    angular: Array,
    frame: int,
    target: Array,
    planar: bool,
    error: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    spin = np.zeros(3)
    if target.shape[0] == 12:
        spin[:] = target[9:]
    _turn_rows(
        rotation[frame], angular[frame], _matrix(target, 0), spin, planar, error, jacobian, rate
    )


@kernel
def _relative_pose_rows(
    position: Array,
    rotation: Array,
    linear: Array,
    angular: Array,
    a: int,
    b: int,
    target: Array,
    planar: bool,
    error: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    k, nv = 2 if planar else 3, linear.shape[2]
    to_b = rotation[b].T.copy()
    offset = position[a] - position[b]
    # d/dt (R_Bᵀ d) = R_Bᵀ (ḋ − ω_B × d): B carries its axes along
    x, y, z = offset
    w = angular[b]
    velocity = linear[a] - linear[b]
    velocity[0] += w[2] * y - w[1] * z
    velocity[1] += w[0] * z - w[2] * x
    velocity[2] += w[1] * x - w[0] * y
    error[:k] = (target[:3] - to_b @ offset)[:k]
    jacobian[:k, :nv] = (to_b @ velocity)[:k]
    spin = np.zeros(3)
    if target.shape[0] == 18:
        rate[:k] = target[12 : 12 + k]
        spin[:] = target[15:]
    _turn_rows(
        to_b @ rotation[a], to_b @ (angular[a] - angular[b]), _matrix(target, 3), spin, planar,
        error[k:], jacobian[k:], rate[k:],
    )  # fmt: skip


def pose_target(
    position: Sequence[float] | Array, rotation: Array, twist: Sequence[float] | Array | None = None
) -> Array:
    """A target of `FramePose` or `RelativePose`: (12,), or (18,) with a feed-forward.

    Args:
        position: (3,) [m].
        rotation: (3, 3).
        twist: (6,) linear then angular velocity of the reference [m/s, rad/s], in the same axes.
    """
    parts = [np.asarray(position, dtype=np.float64), np.asarray(rotation, dtype=np.float64).ravel()]
    if twist is not None:
        parts.append(np.asarray(twist, dtype=np.float64))
    return read_only(np.concatenate(parts))


@final
@dataclass(frozen=True)
class FramePose(Task):
    """σ = position and orientation of a frame in the world; six rows [m, rad], three in the plane.

    Attributes:
        frame: place among the tracked frames.
        goal: (12,) position [m] and rotation row by row, or (18,) with the reference's linear and
            angular velocity [m/s, rad/s], all in the world's axes.
        planar: rows x, y, yaw.
    """

    frame: int
    goal: Array
    planar: bool

    @property
    def rows(self) -> int:
        return 3 if self.planar else 6

    @property
    def target(self) -> Array:
        return self.goal

    @property
    def target_sizes(self) -> tuple[int, ...]:
        return 12, 18

    def frames_used(self) -> tuple[int, ...]:
        return (self.frame,)

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        assert target is not None  # the stack hands on the task's own or its replacement
        robot = kin.robot
        _frame_pose_rows(
            robot.position, robot.rotation, robot.linear, robot.angular, self.frame, target,
            self.planar, out.error, out.jacobian, out.rate,
        )  # fmt: skip


@final
@dataclass(frozen=True)
class FramePosition(Task):
    """σ = some of the coordinates x, y, z of a frame's origin in the world; a row each, [m].

    Attributes:
        frame: place among the tracked frames.
        axes: (m,) the coordinates, of 0, 1, 2.
        goal: (3,) position [m], or (6,) with its velocity [m/s]; all coordinates, chosen or not.
    """

    frame: int
    axes: IntArray
    goal: Array

    @property
    def rows(self) -> int:
        return len(self.axes)

    @property
    def target(self) -> Array:
        return self.goal

    @property
    def target_sizes(self) -> tuple[int, ...]:
        return 3, 6

    def frames_used(self) -> tuple[int, ...]:
        return (self.frame,)

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        assert target is not None  # the stack hands on the task's own or its replacement
        coordinate_rows(
            kin.robot.position[self.frame], kin.robot.linear[self.frame], self.axes, target,
            out.error, out.jacobian, out.rate,
        )  # fmt: skip


@final
@dataclass(frozen=True)
class FrameOrientation(Task):
    """σ = orientation of a frame in the world; three rows [rad], one in the plane.

    Attributes:
        frame: place among the tracked frames.
        goal: (9,) rotation row by row, or (12,) with the reference's angular velocity [rad/s] in
            the world's axes.
        planar: the row yaw.
    """

    frame: int
    goal: Array
    planar: bool

    @property
    def rows(self) -> int:
        return 1 if self.planar else 3

    @property
    def target(self) -> Array:
        return self.goal

    @property
    def target_sizes(self) -> tuple[int, ...]:
        return 9, 12

    def frames_used(self) -> tuple[int, ...]:
        return (self.frame,)

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        assert target is not None  # the stack hands on the task's own or its replacement
        _frame_orientation_rows(
            kin.robot.rotation, kin.robot.angular, self.frame, target, self.planar,
            out.error, out.jacobian, out.rate,
        )  # fmt: skip


@final
@dataclass(frozen=True)
class RelativePose(Task):
    """σ = position and orientation of frame A in frame B; six rows [m, rad], three in the plane.

    In the plane B's z axis must be the plane's normal.

    Attributes:
        frame: place of A among the tracked frames.
        relative_to: place of B.
        goal: (12,) position [m] and rotation R_BA row by row, or (18,) with the reference's linear
            and angular velocity [m/s, rad/s], all in the axes of B.
        planar: rows x, y, yaw.
    """

    frame: int
    relative_to: int
    goal: Array
    planar: bool

    @property
    def rows(self) -> int:
        return 3 if self.planar else 6

    @property
    def target(self) -> Array:
        return self.goal

    @property
    def target_sizes(self) -> tuple[int, ...]:
        return 12, 18

    def frames_used(self) -> tuple[int, ...]:
        return (
            self.frame,
            self.relative_to,
        )

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        assert target is not None  # the stack hands on the task's own or its replacement
        robot = kin.robot
        _relative_pose_rows(
            robot.position, robot.rotation, robot.linear, robot.angular, self.frame,
            self.relative_to, target, self.planar, out.error, out.jacobian, out.rate,
        )  # fmt: skip
