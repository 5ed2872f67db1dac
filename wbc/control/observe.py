"""What a tick sees before it commands; the sequence of phases reads it too."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.control.law import Law
from wbc.rotations import cross, rotate


@kernel
def _observe(
    mode: IntArray, charts: Array, frame: Array, share: Array, position: Array, rotation: Array,
    error: Array, task_first: IntArray, task_last: IntArray, rows: Array, points: Array,
    normals: Array, object_error: Array, task_error: Array,
) -> tuple[float, float]:  # fmt: skip
    f, m = np.zeros(3), np.zeros(3)
    for i in range(mode.shape[0]):
        point, normal = charts[i, 0], frame[i, :, 2]
        rotate(rotation, point, points[i])
        points[i] += position
        rotate(rotation, normal, normals[i])
        f += share[i] * normal
        m += share[i] * cross(point, normal)
        if mode[i] == 0:
            object_error[i] = np.nan
        else:
            object_error[i, 0] = np.sqrt(np.sum(error[i, :3] * error[i, :3]))
            object_error[i, 1] = np.sqrt(np.sum(error[i, 3:] * error[i, 3:]))
    for k in range(task_first.shape[0]):
        e = rows[task_first[k] : task_last[k]]
        task_error[k] = np.sqrt(np.sum(e * e))
    return 0.5 * np.sum(f * f), 0.5 * np.sum(m * m)


class Seen(NamedTuple):
    """The situation at a tick, copied out of the workspaces.

    Attributes:
        object_position, object_rotation: object pose as the fingers in contact hold it.
        reference_position, reference_rotation: where it should be.
        points, normals: (N, 3) contact points [m] and outward normals in the world.
        object_error: (N, 2) position [m] and orientation [rad] error by each finger, NaN if free.
        task_error: (M,) norm of each task's error.
        residuals: (ε_f, ε_m) of (44)-(45) over all fingers of the grasp at their chart coordinates:
            the planned ones before they touch, the last ones after they have left.
        cost: C_Σ.
        min_distance: smallest distance of the watched pairs, [m]; inf where there are none.
    """

    object_position: Array
    object_rotation: Array
    reference_position: Array
    reference_rotation: Array
    points: Array
    normals: Array
    object_error: Array
    task_error: Array
    residuals: tuple[float, float]
    cost: float
    min_distance: float


def observe(law: Law) -> Seen:
    """The law's last evaluation."""
    kin, stack = law.kin, law.stack
    n = kin.grasp.count
    points, normals = np.empty((n, 3)), np.empty((n, 3))
    object_error, task_error = np.empty((n, 2)), np.empty(len(stack.tasks))
    residuals = _observe(
        kin.state.mode, kin.charts, kin.frame, kin.grasp.share, kin.object_position,
        kin.object_rotation, kin.error, stack.task_first, stack.task_last, stack.error, points,
        normals, object_error, task_error,
    )  # fmt: skip
    nearest = np.inf if law.distances is None else law.distances.smallest()
    return Seen(
        kin.object_position.copy(), kin.object_rotation.copy(), kin.reference.position.copy(),
        kin.reference.rotation.copy(), points, normals, object_error, task_error, residuals,
        law.cost, nearest,
    )  # fmt: skip
