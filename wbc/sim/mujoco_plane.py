"""Planar contours in MuJoCo, which has no shape for them: each pad presses on a plate of its own.

The plate is the surface's tangent at the closest point below the tip, put there anew before every
physics step. MuJoCo looks for contacts once a step, and what it finds on the plate is what the
exact contour would give: gap, normal and place of the closest point. The contact's force, stick and
slip and the motion are MuJoCo's.

The pad is the chapter's: a spring of rest length l with a damper along the normal, which turns
freely about the tip. So the ball at the tip is small and the plate lies l less its radius outside
the surface. A soft constraint has f = (s_0 r − s_1 ṙ − a d)/((1 − d) Â), with r how far the pad is
pressed in, a the relative acceleration, Â the inverse inertia that MuJoCo estimates and d its
impedance; with d small a does not count, and s_0 = (1 − d) Â k makes it a spring of k.

What sticks has no spring: its velocity is to vanish. MuJoCo's constraint on accelerations leaves
out J̇ q̇, so that it slips by what that makes in the time in which velocities are brought to rest;
at the fastest that is stable, nearly a step, the slip goes to zero with the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.base import D_U, D_V, POINT
from wbc.rotations import cross
from wbc.sim.compliant import FreeBody
from wbc.sim.feet import Feet
from wbc.sim.pads import Pads

BALL = 2e-4
"""Radius of a pad's ball. MuJoCo's contact acts half way between ball and plate: at 20 N, which
press the chapter's pads in by 0.4 mm, on the tip, about which the pad turns without rolling."""
_HALF = (0.05, 0.05, 0.01)  # of a plate, [m]
_AWAY = (0.0, 0.0, 10.0)  # of a plate below no tip, in the object's frame
_IMPEDANCE = 0.01
_STOPS = 0.9  # of the velocity across a contact that sticks, what a step takes away
_EDGE = float(np.sqrt(0.5))


def plate_name(tip: str) -> str:
    """The geom below a tip."""
    return f"plate {tip}"


def add_contour(mj: Any, spec: Any, name: str, body: FreeBody) -> None:
    """The object as a body that slides along x and y, its joint `name`, and turns about z."""
    thing = spec.worldbody.add_body(name=name)
    joints = mj.mjtJoint
    thing.add_joint(name=name, type=joints.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    thing.add_joint(name=f"{name} y", type=joints.mjJNT_SLIDE, axis=[0.0, 1.0, 0.0])
    thing.add_joint(name=f"{name} turn", type=joints.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
    thing.explicitinertial = True
    thing.mass, thing.ipos = body.mass, body.com
    about_z = float(body.inertia[2])
    # beside the one that counts, any that a body can have
    thing.inertia = np.where(body.inertia > 0.0, body.inertia, about_z)


def add_plates(mj: Any, spec: Any, name: str, tips: Sequence[str], friction: Array) -> None:
    """A plate for every tip, and the pair that it makes with the tip's pad."""
    thing = spec.body(name)
    for i, tip in enumerate(tips):
        if tip in tips[:i]:
            continue
        plate = thing.add_geom(name=plate_name(tip), type=mj.mjtGeom.mjGEOM_BOX)
        plate.size, plate.pos, plate.quat = _HALF, _AWAY, [_EDGE, _EDGE, 0.0, 0.0]
        plate.contype = plate.conaffinity = 0
        mu = float(friction[i])
        pair = spec.add_pair(name=plate_name(tip), geomname1=f"pad {tip}")
        pair.geomname2, pair.condim = plate_name(tip), 3
        pair.friction = [mu, mu, 0.0, 0.0, 0.0]
        pair.solimp = [_IMPEDANCE, _IMPEDANCE, 1e-3, 0.5, 2.0]
        pair.solreffriction = [-1.0, -_STOPS * _IMPEDANCE / spec.option.timestep]


@final
@dataclass(frozen=True)
class Plates:
    """Where the plates of a model are.

    Attributes:
        surface: the contour.
        pads: (N,) of the contacts.
        ball, plate: (N,) geoms of each contact's pad and plate; contacts on one tip share both.
        pair: (N,) their pairs.
    """

    surface: Surface
    pads: Pads
    ball: IntArray
    plate: IntArray
    pair: IntArray


def found(
    mj: Any, model: Any, surface: Surface, pads: Pads, tips: Sequence[str], ball: IntArray
) -> Plates:
    """The plates of a compiled model, whose springs are set here."""
    kinds = mj.mjtObj
    plate, pair = (
        np.array([mj.mj_name2id(model, kind, plate_name(tip)) for tip in tips], dtype=np.int64)
        for kind in (kinds.mjOBJ_GEOM, kinds.mjOBJ_PAIR)
    )
    model.geom_sameframe[plate] = 0  # else MuJoCo takes them to stay where they are
    weight = model.body_invweight0[:, 0]
    seen = weight[model.geom_bodyid[ball]] + weight[model.geom_bodyid[plate]]
    share = (1.0 - _IMPEDANCE) * seen
    model.pair_solref[pair] = -np.column_stack([share * pads.stiffness, share * pads.damping])
    return Plates(surface, pads, ball, plate, pair)


@final
class Followed:
    """The plates of one plant, kept below the tips."""

    def __init__(self, plates: Plates) -> None:
        self._plates = plates
        self._feet = Feet(plates.surface, plates.pads.rest_length)

    def forget(self) -> None:
        """Begin anew: the tips may be anywhere."""
        self._feet.forget()

    def place(self, mj: Any, model: Any, data: Any, body: int, off: BoolArray) -> None:
        """Put the plates below the tips, before a physics step.

        Args:
            body: the object's.
            off: (N,) contacts that bear nothing.
        """
        where, feet = self._plates, self._feet
        mj.mj_kinematics(model, data)
        tips = (data.geom_xpos[where.ball] - data.xpos[body]) @ data.xmat[body].reshape(3, 3)
        feet.begin(tips)
        below = where.pads.rest_length - BALL - _HALF[2]
        for i, plate in enumerate(where.plate):
            if off[i] or not feet.near[i]:
                model.geom_pos[plate] = _AWAY
                continue
            record = feet.records[i]
            normal = cross(record[D_U], record[D_V])
            normal /= np.sqrt(normal @ normal)
            model.geom_pos[plate] = record[POINT] + below[i] * normal
            # the plate's z axis turned onto the normal, about what is across both
            model.geom_quat[plate] = _EDGE, -_EDGE * normal[1], _EDGE * normal[0], 0.0
