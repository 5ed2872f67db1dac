"""What the fingertips feel: when a finger touches, and where the object's surface then is.

A finger that closes on an object stops where it feels it, not where the object is believed. The
contact point becomes the measured one: the place of the tip, seen from the object's believed pose,
on the surface as all fingers that touch together have found it.
"""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactState, Grasp
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.base import POINT
from wbc.contact.surfaces.foot import outward
from wbc.control.numbers import finite_reading, given
from wbc.control.state import Measurement
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel

_PRIOR, _SENSED = 5e-3, 1e-3
"""Standard deviations of where the object is believed and of a measured tip [m]."""

_FURTHEST = 3.0 * _PRIOR
"""No displacement of the object is taken for larger [m]."""

_ROUNDS = 5
"""Gauss-Newton steps of `displacement`: it is nearly linear."""


class Felt(NamedTuple):
    """What the fingertips report in a tick.

    Attributes:
        press: (N,) measured normal force [N]; +inf where no force is measured and the tip is at or
            inside the believed surface, NaN where the sensors give no number.
        tips: (N, 3) measured places of the tips, in the object's believed frame [m].
        gap: (N,) between pad and believed surface, negative inside [m].
    """

    press: Array
    tips: Array
    gap: Array


@final
class TouchSense:
    """The fingertips of a robot as sensors; holds no state between ticks."""

    def __init__(self, model: RobotModel, tips: tuple[str, ...], own: BoolArray) -> None:
        """
        Args:
            tips: (N,) frames of the fingertips.
            own: (nv,) joints whose measured positions tell where a tip is; the others are taken to
                be where they are commanded. Where a tip is held about its palm, these are the
                fingers' joints: what its arm lacks moves palm, tip and contact point together.
        """
        self._kin = Kinematics(model, tips)
        self._own = own

    def read(self, kin: ExtendedKinematics, measured: Measurement | None) -> Felt:
        """What is felt where `kin` has been updated."""
        q, n = kin.robot.q, kin.grasp.count
        seen = finite_reading(measured, "q", q.shape)
        if seen is not None:
            q = np.where(self._own, seen, q)
        tips = (self._kin.update(q).position[:n] - kin.object_position) @ kin.object_rotation
        level = np.array([kin.grasp.surface.level(tip) for tip in tips]) - kin.grasp.rest_length
        if given(measured, "force") is None:
            return Felt(np.where(level <= 0.0, np.inf, 0.0), tips, level)
        force = finite_reading(measured, "force", (n, 3))
        if force is None:
            return Felt(np.full(n, np.nan), tips, level)
        normals = kin.frame[:, :, 2] @ kin.object_rotation.T
        return Felt(-np.einsum("ir,ir->i", normals, force), tips, level)


def displacement(surface: Surface, tips: Array, reach: Array) -> Array:
    """Where the object is beside where it is believed, (3,) [m], object frame.

    The displacement d after which the tips are at their distance from the surface, by least
    squares: Σ (F(p_i − d) − l_i)²/σ_s² + |d|²/σ_d². What the touches do not tell, as along the axis
    of a cylinder, stays as it is believed.

    Args:
        tips: (n, 3) centres of the pads that touch [m]; reach: (n,) their radii [m].
    """
    d = np.zeros(3)
    prior = (_SENSED / _PRIOR) ** 2
    for _ in range(_ROUNDS):
        slope = np.array([surface.level_gradient(p - d) for p in tips]).reshape(-1, 3)
        gap = np.array([surface.level(p - d) for p in tips]) - reach
        d = d + np.linalg.solve(slope.T @ slope + prior * np.eye(3), slope.T @ gap - prior * d)
        d *= min(1.0, _FURTHEST / max(float(np.linalg.norm(d)), 1e-12))
    return d


def found(grasp: Grasp, contact: ContactState, tips: Array, touching: BoolArray) -> ContactState:
    """Contact points of the fingers that touch, as measured; free fingers learn where it is, too.

    Args:
        tips: (N, 3) measured places of the tips, object frame [m].
        touching: (N,) fingers that have come to touch.
    """
    surface, new = grasp.surface, np.flatnonzero(touching)
    d = displacement(surface, tips[new], grasp.rest_length[new])
    xi, shift = np.array(contact.xi), np.array(contact.shift)
    shift[contact.mode == 0] = d
    for i in new:
        xi[i], face = surface.project(tips[i] - d, int(contact.face[i]))
        records = surface.charts(xi[i : i + 1], face)
        shift[i] = tips[i] - grasp.rest_length[i] * outward(records)[0] - records[0, POINT]
    return contact._replace(xi=xi, shift=shift)
