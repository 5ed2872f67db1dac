"""Contact forces to be had where no optimizer plans them: the pads' references, made consistent.

A pad that is to be pressed by Δl is to bear k Δl (text after (35)). Set-points chosen finger by
finger need not balance, and integrators that act on what cannot be had walk the object. So the
fingers that hold take up what is left of the object's balance: along their normals as far as those
reach, and across them by friction.
"""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.grasp import ContactMode, Grasp
from wbc.control.payload import Payload, wrench_to_supply
from wbc.control.references import Motion, References, object_acceleration
from wbc.control.state import TickRecord
from wbc.rotations import cross

_RANK = 1e-6  # share of the largest singular value below which a direction of balance is none


@kernel
def _to_balance(
    points: Array, press: Array, borne: Array, holds: IntArray, width: int, grasp: Array,
    left: Array,
) -> None:  # fmt: skip
    """Wrenches of forces in proportion to the presses, and what is left to be supplied.

    Moments are in newtons, at the distance of the furthest contact.

    Args:
        borne: (N, 3) forces that are there [N].
        holds: (h,) fingers whose forces may change, in `width` directions each.
        grasp: (6, h width) filled; left: (6,) the wrench to be supplied, what is borne taken off.
    """
    length = 1e-9
    for i in range(points.shape[0]):
        length = max(length, np.sqrt(np.sum(points[i] * points[i])))
        left[:3] -= borne[i]
        left[3:] -= cross(points[i], borne[i])
    left[3:] /= length
    axis = np.zeros(3)
    for k in range(holds.shape[0]):
        for r in range(width):
            axis[:] = 0.0
            axis[r] = press[holds[k]]
            grasp[:3, k * width + r] = axis
            grasp[3:, k * width + r] = cross(points[holds[k]], axis) / length


def balanced(
    press: Array, mode: IntArray, points: Array, normals: Array, wrench: Array, planar: bool,
    found: Array | None = None,
) -> Array:  # fmt: skip
    """Forces on the object (N, 3) nearest to the presses that supply a wrench.

    Only fingers that hold (`ContactMode.FIXED`) give way, each in proportion to its press: the sum
    of |Δf_i|²/p_i² is least, so that a finger about to leave is asked for nothing. What they cannot
    balance, as one finger alone could not, stays open.

    Args:
        press: (N,) normal forces [N]; those of free fingers do not count.
        points: (N, 3) contact points from the object's origin [m], normals outward, world axes.
        wrench: (6,) to be supplied, force [N] and moment about the object's origin [Nm].
        planar: forces in the plane, moment about z.
        found: (N, 3) forces as measured; those that hold then bear what the others do press and
            drag, not what they should ("on the basis of the current value of the forces",
            text of 2.4). None: what they should.
    """
    press = np.where(mode == ContactMode.FREE, 0.0, press)
    force: Array = -press[:, None] * normals
    holds = np.flatnonzero((mode == ContactMode.FIXED) & (press > 0.0))
    if not len(holds):
        return force
    rows, width = ([0, 1, 5], 2) if planar else ([0, 1, 2, 3, 4, 5], 3)
    holding = (mode == ContactMode.FIXED)[:, None]
    borne = force if found is None else np.where(holding, force, found)
    grasp, left = np.zeros((6, len(holds) * width)), np.array(wrench)
    _to_balance(points, press, borne, holds, width, grasp, left)
    share = np.linalg.lstsq(grasp[rows], left[rows], rcond=_RANK)[0]
    force[holds, :width] += press[holds, None] * share.reshape(-1, width)
    return force


@final
class SetPoints:
    """The forces of a scenario's pads, tick by tick; holds no state."""

    def __init__(self, grasp: Grasp, payload: Payload | None, gravity: Array) -> None:
        """
        Args:
            payload: what the fingers carry; None: unknown, its weight and inertia are left out.
            gravity: (3,) world axes [m/s²].
        """
        self._grasp = grasp
        self._payload = payload
        self._gravity = gravity
        self._references = References(grasp.count)

    def at(self, record: TickRecord, motion: Motion, found: Array | None = None) -> Array:
        """(N, 3) planned force of each contact on the object, world axes [N].

        Args:
            motion: the references of the tick.
            found: (N, 3) measured forces, for what tips do that do not hold; left out unless
                finite.
        """
        grasp, reference = self._grasp, self._references.at(record.t, motion)
        press = grasp.stiffness * np.maximum(grasp.rest_length - reference.reach, 0.0)
        wrench = np.zeros(6)
        if self._payload is not None:
            body = self._payload.body(record.object_rotation, self._gravity, 0.0)
            wrench, _ = wrench_to_supply(
                body, record.object_rotation, reference.twist,
                object_acceleration(record.t, motion), self._gravity,
            )  # fmt: skip
        arms = record.contact_points - record.object_position
        if found is not None and not np.isfinite(found).all():
            found = None
        normals, mode = record.contact_normals, record.mode
        return balanced(press, mode, arms, normals, wrench, grasp.planar, found)
