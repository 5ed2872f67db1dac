"""Centre of mass of the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from wbc.arrays import Array, IntArray
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.errors import SetupError
from wbc.tasks.base import Task, TaskRows, coordinate_rows


@final
@dataclass(frozen=True)
class CenterOfMass(Task):
    """σ = some coordinates (x, y, z) of the robot's centre of mass in the world; a row each, [m].

    Needs a `Kinematics` that tracks the centre of mass.

    Attributes:
        axes: (m,) the coordinates, of 0, 1, 2.
        goal: (3,) position [m], or (6,) with its velocity [m/s]; all coordinates, chosen or not.
    """

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

    def check(self, kin: ExtendedKinematics) -> None:
        super().check(kin)
        if not kin.robot.track_com:
            raise SetupError(f"task '{self.name}' needs Kinematics(..., track_com=True)")

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        assert target is not None  # the stack hands on the task's own or its replacement
        coordinate_rows(
            kin.robot.com, kin.robot.com_jacobian, self.axes, target,
            out.error, out.jacobian, out.rate,
        )  # fmt: skip
