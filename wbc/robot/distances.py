"""Signed distances between collision shapes: every pair at once, details where asked for.

Capsules and spheres, which is what robots should be made of here, are measured by one kernel; so
is a lower bound for pairs with another shape, from planes about it. coal measures those that the
bound does not clear, and gives witness points and normals of the pairs that are near.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import coal
import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray, read_only
from wbc.compiled import kernel
from wbc.robot.kinematics import Kinematics, placements
from wbc.robot.model import RobotModel

OBJECT = "object"
"""Body name of the grasped object's shapes."""
_TOLERANCE = 1e-12  # of coal's iterations; its default of 1e-6 shows in the gradients
_TURNS = np.linspace(0.0, np.pi, 12, endpoint=False)
_PLANES = np.concatenate(
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
        relative_support: (P, nv), +1 where a joint carries only the second shape, -1 where only the
            first.
        joint: (S,) joint that carries each shape, -1 for the object's.
        ends: (S, 6) ends of the segment about which each shape is round, in its joint's (or the
            object's) frame, [m].
        radius: (S,) its radius about the segment, [m].
        support: (S, K) distance from the frame's origin to the planes about each shape that is not
            round, [m].
        reach: (nv,) no point of a shape moves further than this per unit of joint motion,
            [m] or [1].
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
    carried = np.array([_carried(model, o) for o in objects]).reshape(len(objects), model.nv)
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
    mask = np.zeros(model.nv)
    joint = geometry_object.parentJoint
    while joint > 0:
        mask[model.pin_model.joints[joint].idx_v] = 1.0
        joint = model.pin_model.parents[joint]
    return mask


def _reach(model: RobotModel, objects: Sequence[Any]) -> Array:
    """(nv,) longest way from a joint along the robot to the far side of a shape; 1 for a slide."""
    joints = model.pin_model
    way = np.zeros(joints.njoints)
    for o in objects:
        ends, radius, _ = round_about(o)
        far = max(np.linalg.norm(ends[:3]), np.linalg.norm(ends[3:])) + radius
        way[o.parentJoint] = max(way[o.parentJoint], far)
    for j in range(joints.njoints - 1, 0, -1):  # children come after their parents
        step = np.linalg.norm(joints.jointPlacements[j].translation)
        parent = joints.parents[j]
        slide = 0.0
        if "JointModelP" in joints.joints[j].shortname():
            index = joints.joints[j].idx_v
            slide = max(abs(model.lower[index]), abs(model.upper[index]))
        way[parent] = max(way[parent], way[j] + step + slide)
    reach = np.zeros(model.nv)
    for j in range(1, joints.njoints):
        prismatic = "JointModelP" in joints.joints[j].shortname()
        reach[joints.joints[j].idx_v] = 1.0 if prismatic else way[j]
    return read_only(reach)


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
    shape, placement = geometry_object.geometry, geometry_object.placement
    if isinstance(shape, coal.ConvexBase):
        corners = np.array(shape.points())
    elif isinstance(shape, coal.BVHModelBase):
        corners = np.array(shape.vertices())
    else:
        shape.computeLocalAABB()
        low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
        corners = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T
    corners = corners.reshape(-1, 3) @ placement.rotation.T + placement.translation
    farthest: Array = (corners @ _PLANES.T).max(axis=0)
    return farthest


@kernel
def _bounds(
    poses: Array, joint: IntArray, ends: Array, radius: Array, support: Array, planes: Array,
    pairs: IntArray, exact: BoolArray, round_shape: BoolArray, position: Array, rotation: Array,
    near: float, value: Array, clear: BoolArray,
) -> bool:  # fmt: skip
    """Distances of the round pairs, lower bounds of the others; whether one of these is near."""
    world = np.empty(ends.shape)
    for k in range(joint.shape[0]):
        for e in range(0, 6, 3):
            x, y, z = ends[k, e], ends[k, e + 1], ends[k, e + 2]
            for r in range(3):
                if joint[k] < 0:
                    world[k, e + r] = (
                        position[r] + rotation[r, 0] * x + rotation[r, 1] * y + rotation[r, 2] * z
                    )
                else:
                    pose = poses[joint[k]]
                    world[k, e + r] = pose[9 + r] + pose[r] * x + pose[3 + r] * y + pose[6 + r] * z
    least = np.inf
    for k in range(pairs.shape[0]):
        a, b = pairs[k, 0], pairs[k, 1]
        gap = _segment_distance(world[a, :3], world[a, 3:], world[b, :3], world[b, 3:])
        value[k] = gap - radius[a] - radius[b]
        clear[k] = exact[k]
        if exact[k]:
            least = min(least, value[k])
    unclear = False
    for k in range(pairs.shape[0]):
        a, b = pairs[k, 0], pairs[k, 1]
        if exact[k] or value[k] > max(least, near):
            continue  # neither near nor the smallest: the coarse bound will do
        if round_shape[a] or round_shape[b]:
            if round_shape[b]:
                a, b = b, a
            beyond = _plane_gap(world[a], joint[b], poses, position, rotation, support[b], planes)
            value[k] = max(value[k], beyond - radius[a])
        unclear = unclear or not value[k] > near
    return unclear


@kernel
def _plane_gap(
    ends: Array, joint: int, poses: Array, position: Array, rotation: Array, support: Array,
    planes: Array,
) -> float:  # fmt: skip
    """Largest distance of a segment (6,) outside one of the planes about a shape."""
    local = np.empty(6)
    for e in range(0, 6, 3):
        for r in range(3):
            total = 0.0
            for c in range(3):
                if joint < 0:
                    total += rotation[c, r] * (ends[e + c] - position[c])
                else:
                    total += poses[joint, 3 * r + c] * (ends[e + c] - poses[joint, 9 + c])
            local[e + r] = total
    best = -np.inf
    for p in range(planes.shape[0]):
        x, y, z = planes[p, 0], planes[p, 1], planes[p, 2]
        first = x * local[0] + y * local[1] + z * local[2]
        second = x * local[3] + y * local[4] + z * local[5]
        best = max(best, min(first, second) - support[p])
    return best


@kernel
def _segment_distance(a0: Array, a1: Array, b0: Array, b1: Array) -> float:
    """Distance of two segments given by their ends; either may be a point."""
    aa = bb = ab = ar = br = 0.0
    for r in range(3):
        da, db, gap = a1[r] - a0[r], b1[r] - b0[r], a0[r] - b0[r]
        aa += da * da
        bb += db * db
        ab += da * db
        ar += da * gap
        br += db * gap
    det = aa * bb - ab * ab
    s = min(max((ab * br - ar * bb) / det, 0.0), 1.0) if det > 1e-14 * aa * bb else 0.0
    t = min(max((ab * s + br) / bb, 0.0), 1.0) if bb > 0.0 else 0.0
    s = min(max((ab * t - ar) / aa, 0.0), 1.0) if aa > 0.0 else 0.0
    total = 0.0
    for r in range(3):
        d = a0[r] - b0[r] + s * (a1[r] - a0[r]) - t * (b1[r] - b0[r])
        total += d * d
    return math.sqrt(total)


@kernel
def _least_after(value: Array, reach: Array, q_now: Array, q: Array) -> float:
    least = np.inf
    for k in range(value.shape[0]):
        least = min(least, value[k])
    for j in range(q.shape[0]):
        least -= reach[j] * abs(q[j] - q_now[j])
    return least


@kernel
def _put(poses: Array, shapes: IntArray, position: Array, rotation: Array) -> None:
    for k in shapes:
        for c in range(3):
            for r in range(3):
                poses[k, 3 * c + r] = rotation[r, c]
            poses[k, 9 + c] = position[c]


@final
class Distances:
    """Distances of all pairs of a scene at one configuration; a workspace like `Kinematics`.

    Attributes:
        scene: what is measured.
        near: distances above this need not be exact, [m].
        value: (P,) signed distances, negative in penetration, [m]; for pairs of shapes that are not
            round a lower bound where it is above `near`.
    """

    def __init__(self, scene: CollisionScene, near: float = np.inf) -> None:
        self.scene = scene
        self.near = near
        self._data: Any = pin.GeometryData(scene.geometry)
        for request in self._data.distanceRequests:
            request.gjk_tolerance = _TOLERANCE
        self._results = [self._data.distanceResults[k] for k in range(len(scene.pair_names))]
        self._pieces: IntArray = np.array(scene.pieces, dtype=np.int64)
        self._poses = placements(self._data.oMg, writeable=True)
        self._clear: BoolArray = np.ones(len(self._results), dtype=np.bool_)
        self._placed = False
        self._pose = (np.zeros(3), np.eye(3))
        self._kin: Kinematics | None = None
        self.value: Array = np.full(len(self._results), np.inf)

    def update(self, kin: Kinematics, position: Array, rotation: Array) -> Distances:
        """Measure at `kin`, with the object at p_WO, R_WO. What is no number becomes -inf."""
        scene = self.scene
        self._placed, self._pose, self._kin = False, (position, rotation), kin
        unclear = _bounds(
            kin.joint_poses, scene.joint, scene.ends, scene.radius, scene.support, _PLANES,
            scene.pairs, scene.exact, scene.round_shape, position, rotation, self.near, self.value,
            self._clear,
        )  # fmt: skip
        if unclear:
            for k in np.flatnonzero(~self._clear & ~(self.value > self.near)).tolist():
                self._settle(k)
        if not self.value.size or math.isfinite(self.value.min()):
            return self
        self.value[~np.isfinite(self.value)] = -np.inf
        return self

    def least_after(self, q_now: Array, q: Array) -> float:
        """What no distance is below after a motion from q_now, where they were measured, to q."""
        return float(_least_after(self.value, self.scene.reach, q_now, q))

    def smallest(self) -> float:
        """The least distance, exact, [m]; inf where there are no pairs."""
        if not self.value.size:
            return math.inf
        while True:  # the least of bounds and distances: once it is a distance, it is the smallest
            k = int(self.value.argmin())
            if self._clear[k]:
                return float(self.value[k])
            self._settle(k)

    def _settle(self, pair: int) -> None:
        distance = self._measure(pair)
        self.value[pair] = distance if math.isfinite(distance) else -math.inf
        self._clear[pair] = True

    def _measure(self, pair: int) -> float:
        """One pair by coal; its witness points and normal are in its result then."""
        if not self._placed:
            self._place()
        pin.computeDistance(self.scene.geometry, self._data, pair)
        return float(self._results[pair].min_distance)

    def _place(self) -> None:
        kin, (position, rotation) = self._kin, self._pose
        assert kin is not None
        pin.updateGeometryPlacements(kin.model.pin_model, kin.data, self.scene.geometry, self._data)
        _put(self._poses, self._pieces, position, rotation)
        self._placed = True

    def gradient(self, pair: int, kin: Kinematics) -> Array:
        """∂d/∂q of one pair, shape (nv,): coal's normal points from the first shape to the second.

        Both witness points lie on one line along the normal, so one wrench serves both bodies. For
        shapes whose normal is undefined (coincident axes) it is zero.
        """
        self._measure(pair)
        result = self._results[pair]
        n = result.normal
        if not np.isfinite(n).all() or not n @ n > 0.25:
            return np.zeros(kin.model.nv)
        p = result.getNearestPoint1()
        moment = np.array(
            (p[1] * n[2] - p[2] * n[1], p[2] * n[0] - p[0] * n[2], p[0] * n[1] - p[1] * n[0])
        )
        jacobian = kin.data.J
        row: Array = (n @ jacobian[:3] + moment @ jacobian[3:]) * self.scene.relative_support[pair]
        return row
