"""Which shapes of the robot and the object are watched for collision, fixed before the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray, read_only
from wbc.robot.model import RobotModel
from wbc.robot.rounding import corners

OBJECT = "object"
"""Body name of the grasped object's shapes."""
_TURNS = np.linspace(0.0, np.pi, 12, endpoint=False)
PLANES = np.concatenate(
    [
        sign * np.stack([np.cos(_TURNS), np.sin(_TURNS), 0.0 * _TURNS])[list(axes)].T
        for axes in ((0, 1, 2), (2, 0, 1), (1, 2, 0))
        for sign in (1.0, -1.0)
    ]
)
"""Normals (K, 3) of the planes about a shape that is not round."""


@dataclass(frozen=True)
class CollisionScene:
    """The robot's shapes plus the object's convex pieces, and the pairs that matter.

    Attributes:
        model: the robot.
        geometry: pin.GeometryModel with the object's pieces last; its pairs are the kept ones.
        pieces: indices of the object's pieces.
        pair_names: (link, link) of every pair.
        pairs: (P, 2) indices of the shapes of each pair.
        relative_support: (P, n_full), +1 where a joint carries only the second shape, -1 where
            only the first.
        joint: (S,) joint that carries each shape, -1 for the object's.
        ends: (S, 6) ends of the segment about which each shape is round, in its joint's (or the
            object's) frame, [m].
        radius: (S,) its radius about the segment, [m].
        support: (S, K) distance from the frame's origin to the planes about each shape that is not
            round, [m].
        reach: (nv,) no point of a shape moves further than this per unit of joint motion,
            [m] or [1], joints that follow it included.
        round_shape: (S,) capsules and spheres: segment and radius are the shape itself.
        exact: (P,) both shapes are round.
    """

    model: RobotModel
    geometry: Any
    pieces: tuple[int, ...]
    pair_names: tuple[tuple[str, str], ...]
    pairs: IntArray
    relative_support: Array
    joint: IntArray
    ends: Array
    radius: Array
    support: Array
    reach: Array
    round_shape: BoolArray
    exact: BoolArray


def body_name(model: RobotModel, geometry_object: Any) -> str:
    """Link that carries a shape (``object`` for the object's pieces)."""
    if geometry_object.name.startswith(f"{OBJECT}/"):
        return OBJECT
    return str(model.pin_model.frames[geometry_object.parentFrame].name)


def with_object(model: RobotModel, pieces: Sequence[Array]) -> tuple[Any, tuple[int, ...]]:
    """A copy of the robot's geometry with convex pieces of the object added.

    Args:
        pieces: vertices (k, 3) of each convex piece in the object frame, [m].

    Returns:
        The geometry model without pairs, and the indices of the pieces.
    """
    geometry = model.geometry.copy()
    geometry.removeAllCollisionPairs()
    added = []
    for k, vertices in enumerate(pieces):
        points = coal.StdVec_Vec3s()
        points.extend([np.asarray(v, dtype=np.float64) for v in vertices])
        hull = coal.Convex.convexHull(points, True, None)
        shape = pin.GeometryObject(f"{OBJECT}/{k}", 0, 0, pin.SE3.Identity(), hull)
        added.append(int(geometry.addGeometryObject(shape)))
    return geometry, tuple(added)


def collision_scene(
    model: RobotModel, geometry: Any, pieces: tuple[int, ...], pairs: Sequence[tuple[int, int]]
) -> CollisionScene:
    """Fix the pairs of shapes (by index) that are watched."""
    geometry = geometry.copy()
    geometry.removeAllCollisionPairs()
    objects = list(geometry.geometryObjects)
    for a, b in pairs:
        geometry.addCollisionPair(pin.CollisionPair(a, b))
    carried = np.array([_carried(model, o) for o in objects]).reshape(len(objects), model.n_full)
    index = np.array(pairs, dtype=np.int64).reshape(len(pairs), 2)
    rounds = [round_about(o) for o in objects]
    is_round = np.array([r[2] for r in rounds], dtype=np.bool_)
    return CollisionScene(
        model=model,
        geometry=geometry,
        pieces=pieces,
        pair_names=tuple(
            (body_name(model, objects[a]), body_name(model, objects[b])) for a, b in pairs
        ),
        pairs=index,
        relative_support=read_only(carried[index[:, 1]] - carried[index[:, 0]]),
        joint=np.array([-1 if k in pieces else o.parentJoint for k, o in enumerate(objects)]),
        ends=read_only(np.array([r[0] for r in rounds]).reshape(len(objects), 6)),
        radius=read_only([r[1] for r in rounds]),
        support=read_only(np.array([_support(o) for o in objects]).reshape(len(objects), -1)),
        reach=_reach(model, objects),
        round_shape=is_round,
        exact=is_round[index[:, 0]] & is_round[index[:, 1]],
    )


def _carried(model: RobotModel, geometry_object: Any) -> Array:
    mask = np.zeros(model.n_full)
    mask[model.chain(geometry_object.parentJoint)] = 1.0
    return mask


def _reach(model: RobotModel, objects: Sequence[Any]) -> Array:
    """(nv,) longest way from a joint along the robot to the far side of a shape; 1 for a slide.

    What joints that follow others add to it counts with their ratio.
    """
    joints = model.pin_model
    way = np.zeros(joints.njoints)
    for o in objects:
        ends, radius, _ = round_about(o)
        far = max(np.linalg.norm(ends[:3]), np.linalg.norm(ends[3:])) + radius
        way[o.parentJoint] = max(way[o.parentJoint], far)
    for j in range(joints.njoints - 1, 0, -1):  # children come after their parents
        parent = joints.parents[j]
        step = np.linalg.norm(joints.jointPlacements[j].translation) + slide(model, j - 1)
        way[parent] = max(way[parent], way[j] + step)
    reach = np.zeros(model.nv)
    for k in range(model.n_full):
        motion = 1.0 if model.is_prismatic(k) else way[k + 1]
        reach[model.master[k]] += abs(model.ratio[k]) * motion
    return read_only(reach)


def slide(model: RobotModel, joint: int) -> float:
    """How far a joint of all (k of n_full) carries what is behind it, [m]; 0 for one that turns."""
    if not model.is_prismatic(joint):
        return 0.0
    ends = (model.pin_model.lowerPositionLimit[joint], model.pin_model.upperPositionLimit[joint])
    return float(max(map(abs, ends)))


def round_about(geometry_object: Any) -> tuple[Array, float, bool]:
    """Segment (6,) and radius that hold a shape, and whether they are the shape."""
    shape, placement = geometry_object.geometry, geometry_object.placement
    if isinstance(shape, coal.Capsule | coal.Sphere):
        half = shape.halfLength if isinstance(shape, coal.Capsule) else 0.0
        ends = [placement.act(np.array((0.0, 0.0, z))) for z in (-half, half)]
        return np.concatenate(ends), float(shape.radius), True
    shape.computeLocalAABB()
    half = 0.5 * (np.array(shape.aabb_local.max_) - np.array(shape.aabb_local.min_))
    axis = int(np.argmax(half))  # round about the longest side of its box
    along = np.zeros(3)
    along[axis] = half[axis]
    ends = [placement.act(shape.aabb_center + sign * along) for sign in (-1.0, 1.0)]
    return np.concatenate(ends), float(np.linalg.norm(np.delete(half, axis))), False


def _support(geometry_object: Any) -> Array:
    """(K,) how far a shape goes along each of the planes' normals, in its joint's frame."""
    placement = geometry_object.placement
    points = corners(geometry_object.geometry) @ placement.rotation.T + placement.translation
    farthest: Array = (points @ PLANES.T).max(axis=0)
    return farthest
