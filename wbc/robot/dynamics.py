"""Joint torques of a motion without contact: inverse dynamics of all joints, by the independent
ones."""

from __future__ import annotations

from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.robot.model import RobotModel


@kernel
def _expand(
    q: Array, v: Array, a: Array, master: IntArray, ratio: Array, offset: Array, full: Array
) -> None:
    for k in range(master.shape[0]):
        j, r = master[k], ratio[k]
        full[0, k] = r * q[j] + offset[k]
        full[1, k] = r * v[j]
        full[2, k] = r * a[j]


@kernel
def _collect(tau: Array, master: IntArray, ratio: Array, out: Array) -> None:
    out[:] = 0.0
    for k in range(master.shape[0]):
        out[master[k]] += ratio[k] * tau[k]


@final
class InverseDynamics:
    """Workspace for one robot.

    Attributes:
        gravity: (3,) of the model, world axes [m/s²].
    """

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._data: Any = model.pin_model.createData()
        self._full: Array = np.zeros((3, model.n_full))
        self.gravity: Array = np.array(model.pin_model.gravity.linear)

    def torques(self, q: Array, v: Array, a: Array) -> Array:
        """(nv,) τ with which the robot moves so, touching nothing [Nm], [N].

        A joint that follows another adds to the torque of its master what its ratio carries over:
        by virtual work τ_j = Σ_k ratio_k τ_k over the joints k that j drives.

        Args:
            q, v, a: (nv,) of the independent joints.
        """
        m = self._model
        _expand(q, v, a, m.master, m.ratio, m.offset, self._full)
        tau = pin.rnea(m.pin_model, self._data, *self._full)
        out = np.empty(m.nv)
        _collect(tau, m.master, m.ratio, out)
        return out
