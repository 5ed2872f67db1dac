"""Contact forces in the picture, after Figure 2 of the chapter.

At each contact an arrow, the planned force on the object from the contact point on, where forces
are measured a thicker one below it, and the friction cone (2) that they have to stay in; for the
object the weight at its centre of mass, and the wrench that the contacts supply at its origin.
Moments are arrows with two heads.

Every arrow is a mesh of unit length, sent once: its pose also scales it along z.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wbc.arrays import Array
from wbc.view.meshes import Mesh, revolved
from wbc.view.scene import ForceArrows, Rgba, Scene, contact_frames

Path = tuple[str, ...]
"""Names of a node and those above it."""

# not quite opaque: the page draws all that is opaque before, and so below, the cones
FORCE: Rgba = (0.05, 0.60, 0.20, 0.999)
"""Green: every joint of the finger keeps clear of its torque limits."""
LIMITED: Rgba = (0.98, 0.42, 0.0, 0.999)
"""Orange: a torque limit of the finger is active."""
MEASURED: Rgba = (0.60, 0.15, 0.75, 0.999)
"""Violet, and thicker: of the planned force on top of it both are seen, however near they are."""
CONE: Rgba = (1.0, 0.87, 0.0, 0.38)
WEIGHT: Rgba = (0.08, 0.08, 0.10, 1.0)
RESULTANT: Rgba = (0.85, 0.10, 0.12, 1.0)

_OBJECT: dict[str, tuple[Rgba, bool]] = {
    "weight": (WEIGHT, False),
    "weight_moment": (WEIGHT, True),
    "resultant": (RESULTANT, False),
    "resultant_moment": (RESULTANT, True),
}
_SLANT = 0.03  # of a cone, [m]
_RADIUS = 0.0016  # of a shaft, [m]
_PLANAR = 3.0  # a planar scene of this radius has marks as large as a hand's fingertips [1/m]
_SHORTEST = 5e-4  # arrow that is drawn, [m]
_LONGEST = 1.0  # longer ones are drawn so long: they leave the picture in any case, [m]


class Mark(NamedTuple):
    """What is sent once.

    Attributes:
        order: what has more is drawn over what has less; all over the solids.
    """

    mesh: Mesh
    rgba: Rgba
    order: int


def marks(scene: Scene) -> dict[Path, Mark]:
    """Cones and arrows of a scene that shows forces; nothing in any other."""
    if not scene.friction_angles:
        return {}
    found: dict[Path, Mark] = {}
    size = _PLANAR * scene.extent if scene.planar else 1.0
    radius = size * _RADIUS
    for name, angle in zip(scene.contact_names, scene.friction_angles, strict=True):
        found["forces", name, "cone"] = Mark(_cone(angle, size * _SLANT), CONE, 1)
        if scene.measured:
            found["forces", name, "measured"] = Mark(_arrow(1.7 * radius, False), MEASURED, 3)
        found["forces", name, "force"] = Mark(_arrow(radius, False), FORCE, 4)
    for part, (rgba, double) in _OBJECT.items():
        found["forces", part] = Mark(_arrow(1.5 * radius, double), rgba, 2)
    return found


def legend(scene: Scene) -> dict[str, Rgba]:
    """What each colour of the marks is."""
    if not scene.friction_angles:
        return {}
    measured = {"measured": MEASURED} if scene.measured else {}
    return {
        "planned": FORCE, **measured, "torque limit": LIMITED, "friction cone": CONE,
        "weight": WEIGHT, "resultant": RESULTANT,
    }  # fmt: skip


def _cone(angle: float, slant: float) -> Mesh:
    """Tip at the origin, opening along -z: into the object where z is the outward normal."""
    radius, depth = slant * math.sin(angle), slant * math.cos(angle)
    return revolved(np.array([0.0, radius, 0.0]), np.array([-depth, -depth, 0.0]), 40)


def _arrow(radius: float, double: bool) -> Mesh:
    """From the origin to (0, 0, 1), with one head or two."""
    r, head = radius, 2.8 * radius
    profile = [(0.0, 0.0), (r, 0.0)]
    for foot in (0.46, 0.72) if double else (0.72,):
        profile += [(r, foot), (head, foot), (0.0, foot + 0.28)]
    radii, heights = np.array(profile).T
    return revolved(radii, heights, 16)


def poses(scene: Scene, arrows: ForceArrows | None, contacts: Array) -> dict[Path, Array]:
    """(4, 4) pose of each mark, z scaled to an arrow's length; NaN where there is none.

    Args:
        contacts: (N, 4, 4) frames of the contacts that touch, z outward; NaN for the others.
    """
    nothing = np.full((4, 4), np.nan)
    if arrows is None or not scene.friction_angles:
        return dict.fromkeys(marks(scene), nothing)
    found: dict[Path, Array] = {}
    forces = _along(contacts[:, :3, 3], arrows.contact)
    measured = _along(contacts[:, :3, 3], arrows.measured)
    for i, name in enumerate(scene.contact_names):
        pressing = np.isfinite(forces[i]).all() or np.isfinite(measured[i]).all()
        found["forces", name, "cone"] = contacts[i] if pressing else nothing
        if scene.measured:
            found["forces", name, "measured"] = measured[i]
        found["forces", name, "force"] = forces[i]
    origin = arrows.origin
    starts = np.array([arrows.com, origin, origin, origin])
    vectors = np.concatenate((arrows.weight, arrows.resultant)).reshape(4, 3)
    for part, pose in zip(_OBJECT, _along(starts, vectors), strict=True):
        found["forces", part] = pose
    return found


def _along(points: Array, vectors: Array) -> Array:
    """(k, 4, 4) from a point along a vector, scaled to its length; NaN for what is not drawn."""
    size = np.abs(vectors).max(axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = vectors / size  # first: squares of what is huge would overflow
        lengths = size[:, 0] * np.linalg.norm(unit, axis=1)
    frames = contact_frames(points, np.where(lengths[:, None] > _SHORTEST, unit, np.nan))
    frames[:, :3, 2] *= np.minimum(lengths, _LONGEST)[:, None]
    return frames


def colors(scene: Scene, arrows: ForceArrows | None) -> dict[Path, Rgba]:
    """Colour of each contact's arrow."""
    if not scene.friction_angles:
        return {}
    limited = arrows.limited if arrows is not None else [False] * len(scene.contact_names)
    return {
        ("forces", name, "force"): LIMITED if tight else FORCE
        for name, tight in zip(scene.contact_names, limited, strict=True)
    }
