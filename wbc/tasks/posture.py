"""Posture: some joints at given values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.errors import SetupError
from wbc.tasks.base import Task, TaskRows


@kernel
def _posture_rows(
    q: Array, joints: IntArray, target: Array, error: Array, jacobian: Array, rate: Array
) -> None:
    m = joints.shape[0]
    for r in range(m):
        error[r] = target[r] - q[joints[r]]
        jacobian[r, joints[r]] = 1.0
        if target.shape[0] == 2 * m:
            rate[r] = target[m + r]


@final
@dataclass(frozen=True)
class Posture(Task):
    """σ = values of a subset of the joints; a row each, [rad] or [m].

    Attributes:
        joints: (m,) places in q, each once.
        goal: (m,) values [rad] or [m], or (2m,) with their velocities.
    """

    joints: IntArray
    goal: Array

    @property
    def rows(self) -> int:
        return len(self.joints)

    @property
    def target(self) -> Array:
        return self.goal

    @property
    def target_sizes(self) -> tuple[int, ...]:
        return len(self.joints), 2 * len(self.joints)

    def check(self, kin: ExtendedKinematics) -> None:
        super().check(kin)
        nv = kin.robot.model.nv
        if len(self.joints) and not (self.joints.min() >= 0 and self.joints.max() < nv):
            raise SetupError(f"task '{self.name}': joints must be places in q, 0 to {nv - 1}")

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        assert target is not None  # the stack hands on the task's own or its replacement
        _posture_rows(kin.robot.q, self.joints, target, out.error, out.jacobian, out.rate)
