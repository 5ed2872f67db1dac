"""Signed distances between collision shapes: every pair at once, details where asked for.

Capsules and spheres, which is what robots should be made of here, are measured by one kernel; so
is a lower bound for pairs with another shape, from planes about it. coal measures those that the
bound does not clear, and gives witness points and normals of the pairs that are near.
"""

from __future__ import annotations

import math
from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray
from wbc.compiled import kernel
from wbc.robot.collision_scene import PLANES, CollisionScene
from wbc.robot.kinematics import Kinematics, placements

_TOLERANCE = 1e-12  # of coal's iterations; its default of 1e-6 shows in the gradients


@kernel
def _bounds(
    poses: Array, joint: IntArray, ends: Array, radius: Array, support: Array, planes: Array,
    pairs: IntArray, exact: BoolArray, round_shape: BoolArray, position: Array, rotation: Array,
    near: float, value: Array, clear: BoolArray,
) -> bool:  # fmt: skip
    """Distances of the round pairs, lower bounds of the others; whether one of these is near."""
    world, along, length2 = np.empty(ends.shape), np.empty((len(ends), 3)), np.zeros(len(ends))
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
        for r in range(3):
            along[k, r] = world[k, 3 + r] - world[k, r]
            length2[k] += along[k, r] * along[k, r]
    least = np.inf
    for k in range(pairs.shape[0]):
        a, b = pairs[k, 0], pairs[k, 1]
        gap = _segment_distance(world, along, length2, a, b)
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
def _segment_distance(start: Array, along: Array, length2: Array, i: int, j: int) -> float:
    """Distance of two segments; either may be a point. Every sum is written out, for speed.

    Args:
        start: (S, >= 3), from here the segments go.
        along: (S, 3), to their ends.
        length2: (S,) their squared lengths.
        i, j: which two.
    """
    ax, ay, az = along[i, 0], along[i, 1], along[i, 2]
    bx, by, bz = along[j, 0], along[j, 1], along[j, 2]
    x, y, z = start[i, 0] - start[j, 0], start[i, 1] - start[j, 1], start[i, 2] - start[j, 2]
    aa, bb = length2[i], length2[j]
    ab, ar, br = ax * bx + ay * by + az * bz, ax * x + ay * y + az * z, bx * x + by * y + bz * z
    det = aa * bb - ab * ab
    s = min(max((ab * br - ar * bb) / det, 0.0), 1.0) if det > 1e-14 * aa * bb else 0.0
    t = min(max((ab * s + br) / bb, 0.0), 1.0) if bb > 0.0 else 0.0
    s = min(max((ab * t - ar) / aa, 0.0), 1.0) if aa > 0.0 else 0.0
    x += s * ax - t * bx
    y += s * ay - t * by
    z += s * az - t * bz
    return math.sqrt(x * x + y * y + z * z)


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


@kernel
def _pair_row(
    joint_jacobian: Array, n: Array, p: Array, relative_support: Array, master: IntArray,
    ratio: Array, row: Array,
) -> None:  # fmt: skip
    """Adds to row (nv,) how fast a point at p moves along n with the joints that carry one body."""
    a, b, c = p[1] * n[2] - p[2] * n[1], p[2] * n[0] - p[0] * n[2], p[0] * n[1] - p[1] * n[0]
    for k in range(master.shape[0]):
        if relative_support[k] != 0.0:
            along = (
                n[0] * joint_jacobian[0, k]
                + n[1] * joint_jacobian[1, k]
                + n[2] * joint_jacobian[2, k]
            )
            turning = a * joint_jacobian[3, k] + b * joint_jacobian[4, k] + c * joint_jacobian[5, k]
            row[master[k]] += relative_support[k] * ratio[k] * (along + turning)


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
            kin.joint_poses, scene.joint, scene.ends, scene.radius, scene.support, PLANES,
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
        row = np.zeros(kin.model.nv)
        _pair_row(
            kin.joint_jacobian, n, result.getNearestPoint1(), self.scene.relative_support[pair],
            kin.model.master, kin.model.ratio, row,
        )  # fmt: skip
        return row
