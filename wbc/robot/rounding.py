"""Capsules about shapes that are not round, and hulls for meshes.

At the edges of a box, a cylinder or a mesh the direction to the nearest body jumps, and coal
iterates for its distance; a capsule's is smooth and one formula. A shape is therefore taken as the
capsule about it where that is not much larger.
"""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from wbc.arrays import Array
from wbc.errors import WbcError

EXCESS = 0.01
"""How far a capsule may stand out of its shape, [m]; a tenth of its diagonal, if that is more."""
_RELATIVE = 0.1
_WIDER = np.linspace(1.0, 1.8, 17)  # radii tried, as multiples of the least one
_AROUND = 32  # sides of the prism about a cylinder
_DIRECTIONS: Array = np.array([d for d in product((-1.0, -0.5, 0.0, 0.5, 1.0), repeat=3) if any(d)])
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1)[:, None]


class Capsule(NamedTuple):
    """All points within `radius` of a segment.

    Attributes:
        ends: (2, 3) ends of the segment, [m].
        radius: [m].
        excess: how far the capsule stands out of the hull of what it holds, [m].
    """

    ends: Array
    radius: float
    excess: float


def rounded(geometry: Any, *, capsules: bool = True) -> Any:
    """A copy of a pin.GeometryModel in which every shape is convex.

    Args:
        capsules: a shape that a capsule fits to within `EXCESS`, or a tenth of its diagonal,
            becomes that capsule, which holds all of it. Of the others, and of all without this, a
            mesh becomes its convex hull and the rest stays.

    Raises:
        WbcError: a mesh of which no hull can be made, with the name of its shape.
    """
    out = pin.GeometryModel()
    for o in geometry.geometryObjects:
        shape = o.geometry
        if isinstance(shape, coal.Capsule | coal.Sphere):
            out.addGeometryObject(o)
            continue
        points = corners(shape)
        if not np.isfinite(points).all():
            raise WbcError(f"the mesh of '{o.name}' has corners that are no numbers; repair it")
        capsule = capsule_about(points) if capsules else None
        allowed = max(EXCESS, _RELATIVE * float(np.linalg.norm(np.ptp(points, axis=0))))
        if capsule is not None and capsule.excess <= allowed:
            out.addGeometryObject(_as_object(o, capsule))
        elif isinstance(shape, coal.BVHModelBase):
            out.addGeometryObject(_replaced(o, o.placement, _convex(points, o.name)))
        else:
            out.addGeometryObject(o)
    return out


def corners(shape: Any) -> Array:
    """(n, 3) points whose convex hull holds a coal shape, in its own frame, [m]."""
    if isinstance(shape, coal.ConvexBase):
        return np.array(shape.points(), dtype=np.float64).reshape(-1, 3)
    if isinstance(shape, coal.BVHModelBase):
        return np.array(shape.vertices(), dtype=np.float64).reshape(-1, 3)
    if isinstance(shape, coal.Cylinder):
        turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
        wide = shape.radius / np.cos(np.pi / _AROUND)
        ring = wide * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        heights = (-shape.halfLength, shape.halfLength)
        return np.vstack([np.column_stack([ring, np.full(_AROUND, z)]) for z in heights])
    shape.computeLocalAABB()
    low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
    grid: Array = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T
    return grid


def capsule_about(points: Array) -> Capsule:
    """The capsule of least excess about (n, 3) points [m], along one of six axes.

    The axes are those of the frame and the principal ones of the hull's vertices.
    """
    hull = points[_hull(points)]
    principal = np.linalg.svd(hull - hull.mean(axis=0), full_matrices=True)[2]
    support = (hull @ _DIRECTIONS.T).max(axis=0)
    frames = [np.roll(frame, -k, axis=0) for frame in (np.eye(3), principal) for k in range(3)]
    return min((_along(hull, support, axes) for axes in frames), key=lambda c: c.excess)


def _hull(points: Array) -> Any:
    """Indices of the corners of the convex hull; of all points where it is flat."""
    try:
        return ConvexHull(points).vertices
    except (QhullError, ValueError):
        return slice(None)


def _along(hull: Array, support: Array, axes: Array) -> Capsule:
    """The capsule of least excess along axes[0]; `support` is the hull's along _DIRECTIONS."""
    along, flat = hull @ axes[0], hull @ axes[1:].T
    middle = _middle(flat)
    off = np.linalg.norm(flat - middle, axis=1)
    found = []
    for radius in max(float(off.max()), 1e-6) * _WIDER:
        # at each end the ball may begin as far in as it still holds every point
        room = np.sqrt(np.maximum(radius**2 - off**2, 0.0))
        low, high = float((along + room).min()), float((along - room).max())
        if low > high:
            low = high = 0.5 * (low + high)  # wider than long: a ball
        ends = np.outer([low, high], axes[0]) + middle @ axes[1:]
        excess = float(((ends @ _DIRECTIONS.T).max(axis=0) + radius - support).max())
        found.append(Capsule(ends, float(radius), excess))
    return min(found, key=lambda c: c.excess)


def _middle(points: Array) -> Array:
    """Centre of nearly the least circle about points (n, 2): drawn to the farthest, ever less.

    Badoiu and Clarkson, Smaller core-sets for balls, SODA 2003.
    """
    center: Array = 0.5 * (points.min(axis=0) + points.max(axis=0))
    best, least = center, np.inf
    for k in range(1, 60):
        off = np.linalg.norm(points - center, axis=1)
        far = int(np.argmax(off))
        if off[far] < least:
            best, least = center, float(off[far])
        center = center + (points[far] - center) / (k + 1.0)
    return best


def _convex(points: Array, name: str) -> Any:
    cloud = coal.StdVec_Vec3s()
    cloud.extend([point for point in points[_hull(points)]])
    try:
        return coal.Convex.convexHull(cloud, True, None)
    except (ValueError, RuntimeError):  # what coal raises differs between its versions
        remedy = "give it one, or take a thin <box>"
        raise WbcError(f"the mesh of '{name}' is flat, it has no thickness; {remedy}") from None


def _as_object(source: Any, capsule: Capsule) -> Any:
    low, high = (source.placement.act(end) for end in capsule.ends)
    length = float(np.linalg.norm(high - low))
    if length < 1e-9:
        return _replaced(source, pin.SE3(np.eye(3), low), coal.Sphere(capsule.radius))
    upward = np.array((0.0, 0.0, 1.0))
    turn = pin.Quaternion.FromTwoVectors(upward, (high - low) / length).toRotationMatrix()
    shape = coal.Capsule(capsule.radius, length)
    return _replaced(source, pin.SE3(turn, 0.5 * (low + high)), shape)


def _replaced(source: Any, placement: Any, shape: Any) -> Any:
    return pin.GeometryObject(source.name, source.parentJoint, source.parentFrame, placement, shape)
