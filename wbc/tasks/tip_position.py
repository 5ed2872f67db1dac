"""Position of a fingertip in the object frame: how a free finger approaches, leaves and is held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.rotations import cross
from wbc.tasks.base import Task, TaskRows


@kernel
def _tip_rows(
    tip, linear, axes, object_position, object_rotation, twist, target, planar, nv, error, jacobian, rate
):  # type: ignore[no-untyped-def]
    arm = object_rotation @ target[:3]
    gap = object_position + arm - tip
    velocity = twist[:3] + cross(twist[3:], arm) + object_rotation @ target[3:]
    for r in range(error.shape[0]):
        # tangent(s) first, normal last; the planar frame's second tangent is out of the plane
        column = (2 if r == 1 else 0) if planar else r
        axis = object_rotation @ axes[:, column]
        error[r] = axis @ gap
        jacobian[r, :nv] = axis @ linear
        rate[r] = axis @ velocity


@final
@dataclass(frozen=True)
class TipPosition(Task):
    """σ = tip of one finger along the axes of its contact frame, in the object frame; [m].

    The rows are levels of their own: where the contact already fixes the tip along its normal, that
    row finds no freedom left and the tangential ones still act.

    The target is (6,): point in the object frame [m], and its velocity there [m/s]. The object is
    taken as it moves by its reference, so the Jacobian is over the joints alone.

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

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        _tip_rows(
            kin.robot.position[self.finger], kin.robot.linear[self.finger], kin.frame[self.finger],
            kin.object_position, kin.object_rotation, kin.reference.twist, target, self.planar,
            kin.robot.model.nv, out.error, out.jacobian, out.rate,
        )  # fmt: skip
