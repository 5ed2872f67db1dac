"""Distance between a palm and the object: the palm stays outside a surface around the object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.surfaces import Surface
from wbc.rotations import cross, rotate
from wbc.tasks.base import Task, TaskRows, fade


@kernel
def _in_object(point: Array, position: Array, rotation: Array) -> Array:
    out = np.empty(3)
    rotate(rotation.T, point - position, out)
    return out


@final
@dataclass(frozen=True)
class PalmDistance(Task):
    """σ = F(p_c^o) while the palm is inside F = 0, else no row (48); one row, [m] at the surface.

    The row fades in over `band` inside the surface.

    Attributes:
        frame: place of the palm among the tracked frames.
        region: the surface F = 0, in the object frame.
        band: width of the fade, in the units of F.
    """

    frame: int
    region: Surface
    band: float

    @property
    def rows(self) -> int:
        return 1

    def frames_used(self) -> tuple[int, ...]:
        return (self.frame,)

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        palm = kin.robot.position[self.frame]
        point = _in_object(palm, kin.object_position, kin.object_rotation)
        level = self.region.level(point)
        if level >= 0.0:
            out.activation[0] = 0.0
            return
        gradient = kin.object_rotation @ self.region.level_gradient(point)
        out.error[0] = -level
        out.jacobian[0, : kin.robot.model.nv] = gradient @ kin.robot.linear[self.frame]
        # ∂σ/∂t: the object carries the surface along
        v, w = kin.reference.twist[:3], kin.reference.twist[3:]
        out.rate[0] = gradient @ v + gradient @ cross(w, palm - kin.object_position)
        out.activation[0] = fade(-level, self.band)
