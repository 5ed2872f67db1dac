"""Position of a fingertip in the object frame: how a free finger approaches, leaves and is held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.errors import SetupError
from wbc.rotations import cross, multiply, rotate
from wbc.tasks.base import Task, TaskRows


@kernel
def _tip_rows(
    tip: Array,
    linear: Array,
    finger: int,
    axes: Array,
    spin: Array,
    object_position: Array,
    object_rotation: Array,
    twist: Array,
    target: Array,
    planar: bool,
    error: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    nv = linear.shape[1]
    start = nv + 2 * finger
    offset, moving = np.empty(3), np.empty(3)
    rotate(object_rotation, target[:3], offset)
    rotate(object_rotation, target[3:], moving)
    gap = object_position + offset - tip
    # the target's velocity less what the object's motion gives the tip where it is now
    velocity = twist[:3] + cross(twist[3:], tip - object_position) + moving
    world_axes = np.empty((3, 3))
    multiply(object_rotation, axes, world_axes)
    gap_c = np.empty(3)
    rotate(world_axes.T, gap, gap_c)
    for r in range(error.shape[0]):
        # tangent(s) first, normal last; the planar frame's second tangent is out of the plane
        column = (2 if r == 1 else 0) if planar else r
        x, y, z = world_axes[0, column], world_axes[1, column], world_axes[2, column]
        error[r] = gap_c[column]
        jacobian[r, :nv] = x * linear[0] + y * linear[1] + z * linear[2]
        rate[r] = x * velocity[0] + y * velocity[1] + z * velocity[2]
        # the axes turn with the chart coordinates: ∂(axis · gap) = (spin × axis) · gap
        before, after = (column + 2) % 3, (column + 1) % 3
        jacobian[r, start : start + 2] = spin[after] * gap_c[before] - spin[before] * gap_c[after]


@final
@dataclass(frozen=True)
class TipPosition(Task):
    """σ = tip less target, in the object frame along the axes of the contact frame; [m].

    The rows are levels of their own: where the contact already fixes the tip along its normal, that
    row finds no freedom left and the tangential ones still act.

    The target is (6,): point in the object frame [m], and its velocity there [m/s]. The object is
    taken as it moves by its reference: the Jacobian is for an object at rest, over the joints and
    the finger's chart coordinates, with which the axes turn.

    Attributes:
        finger: index in the grasp.
        planar: two rows (tangent, normal) instead of three.
    """

    finger: int
    planar: bool

    @property
    def rows(self) -> int:
        return 2 if self.planar else 3

    @property
    def separate(self) -> bool:
        return True

    @property
    def exact_share(self) -> float:
        """Held like the main task, of which its rows are the free fingers' part."""
        return 1e-3

    def check(self, kin: ExtendedKinematics) -> None:
        super().check(kin)
        if not 0 <= self.finger < kin.grasp.count:
            raise SetupError(f"task '{self.name}': the grasp has no finger {self.finger}")

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        assert target is not None  # the stack hands on the task's own or its replacement
        _tip_rows(
            kin.robot.position[self.finger], kin.robot.linear[self.finger], self.finger,
            kin.frame[self.finger], kin.spin[self.finger], kin.object_position,
            kin.object_rotation, kin.reference.twist, target, self.planar,
            out.error, out.jacobian, out.rate,
        )  # fmt: skip
