"""What the object lies on at the start: a table top, posts that stand on it, or both.

They are one body, which `reset` of the plant puts where the object truly is: a table bears its
object wherever the object was misplaced to. Hands collide with a table top and the posts on it.
Posts without a top bear the object and meet nothing else: a hand may reach round from below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc.arrays import Array
from wbc.contact.surfaces import Surface
from wbc.errors import WbcError

TABLE = "table"
TABLE_BIT = 2
"""What a geom is, as a bit; hands collide with it."""
_HEAD, _STALK = 4e-3, 3e-3  # radii of a post
_THICK = 0.02


@final
@dataclass(frozen=True)
class Table:
    """A table, by where the object is believed to lie on it.

    Attributes:
        position, rotation: (3,) [m], (3, 3) of the object there.
        top: height of the table top in the world, [m]; None: posts alone.
        size: (2,) of the top, about the object, [m].
        posts: (P, 2) where the object touches the round heads of the posts, from its position along
            the world's x and y, [m]; each is as high as the object's underside there.
    """

    position: Array
    rotation: Array
    top: float | None
    size: Array
    posts: Array


def underside(surface: Surface, rotation: Array, across: Array) -> tuple[Array, Array]:
    """Point (3,) [m] and outward normal (3,), object frame, where a surface begins above a place.

    Args:
        across: (2,) the place, from the object's origin along the world's x and y [m].

    Raises:
        WbcError: no part of the object is there.
    """
    reach = float(np.linalg.norm(surface.mesh()[0], axis=1).max())

    def at(height: float) -> Array:
        out: Array = np.array([*across, height]) @ rotation
        return out

    heights = np.linspace(-reach, reach, 2001)
    inside = np.flatnonzero([surface.level(at(z)) < 0.0 for z in heights])
    if not len(inside):
        x, y = 1e3 * across
        raise WbcError(f"simulation.physics.table.posts: nothing of the object is above [{x:.4g} "
                       f"mm, {y:.4g} mm] from its position")  # fmt: skip
    high = float(heights[inside[0]])
    low = high - 2.0 * reach / 2000.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if surface.level(at(middle)) < 0.0 else (middle, high)
    return at(high), surface.level_gradient(at(high))


def add_table(
    mj: Any, spec: Any, table: Table, surface: Surface, friction: float, solref: Sequence[float],
    solimp: Sequence[float], object_bit: int,
) -> None:  # fmt: skip
    """Add it as a body that does not move by itself, in the object's frame.

    Raises:
        WbcError: a post without object above it.
    """
    body = spec.worldbody.add_body(name=TABLE, mocap=True)

    def add(name: str, kind: Any, bit: int) -> Any:
        geom = body.add_geom(name=name, type=kind, contype=TABLE_BIT, conaffinity=bit)
        geom.friction, geom.priority = [friction, 0.005, 1e-4], 1
        geom.solref, geom.solimp = solref, solimp
        return geom

    up, kinds = table.rotation[2], mj.mjtGeom
    for k, across in enumerate(table.posts):
        point, normal = underside(surface, table.rotation, across)
        centre = point + _HEAD * normal
        head = add(f"{TABLE} head {k}", kinds.mjGEOM_SPHERE, object_bit)
        head.pos, head.size[0] = centre, _HEAD
        if table.top is None:
            head.contype = 0
            continue
        long = max(float(table.position[2] + up @ centre) - table.top, 1e-3)
        stalk = add(f"{TABLE} post {k}", kinds.mjGEOM_CAPSULE, 0)
        stalk.fromto, stalk.size[0] = [*centre, *(centre - long * up)], _STALK
    if table.top is not None:
        top = add(TABLE, kinds.mjGEOM_BOX, object_bit)
        top.size = [*(0.5 * table.size), 0.5 * _THICK]
        top.pos = (table.top - 0.5 * _THICK - table.position[2]) * up
        mj.mju_mat2Quat(top.quat, np.ascontiguousarray(table.rotation.T).ravel())
