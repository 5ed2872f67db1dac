"""Signed distances between collision shapes, from coal: every pair at once, details where asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import coal
import numpy as np
import pinocchio as pin

from wbc.arrays import Array, read_only
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel

OBJECT = "object"
"""Body name of the grasped object's shapes."""


@dataclass(frozen=True)
class CollisionScene:
    """The robot's shapes plus the object's convex pieces, and the pairs that matter.

    Attributes:
        model: the robot.
        geometry: pin.GeometryModel with the object's pieces last; its pairs are the kept ones.
        pieces: indices of the object's pieces.
        pair_names: (link, link) of every pair.
        relative_support: (P, nv), +1 where a joint carries only the second shape, -1 only the first.
    """

    model: RobotModel
    geometry: Any
    pieces: tuple[int, ...]
    pair_names: tuple[tuple[str, str], ...]
    relative_support: Array


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
    names, support = [], []
    for a, b in pairs:
        geometry.addCollisionPair(pin.CollisionPair(a, b))
        first, second = geometry.geometryObjects[a], geometry.geometryObjects[b]
        names.append((body_name(model, first), body_name(model, second)))
        support.append(_carried(model, second) - _carried(model, first))
    return CollisionScene(
        model, geometry, pieces, tuple(names),
        read_only(np.array(support).reshape(len(names), model.nv)),
    )  # fmt: skip


def _carried(model: RobotModel, geometry_object: Any) -> Array:
    mask = np.zeros(model.nv)
    joint = geometry_object.parentJoint
    while joint > 0:
        mask[model.pin_model.joints[joint].idx_v] = 1.0
        joint = model.pin_model.parents[joint]
    return mask


@final
class Distances:
    """Distances of all pairs of a scene at one configuration; a workspace like `Kinematics`.

    Attributes:
        scene: what is measured.
        value: (P,) signed distances, negative in penetration, [m].
    """

    def __init__(self, scene: CollisionScene) -> None:
        self.scene = scene
        self._data: Any = pin.GeometryData(scene.geometry)
        self._results = [self._data.distanceResults[k] for k in range(len(scene.pair_names))]
        self._pieces = [self._data.oMg[k] for k in scene.pieces]
        self.value: Array = np.full(len(self._results), np.inf)

    def update(self, kin: Kinematics, position: Array, rotation: Array) -> Distances:
        """Measure at `kin`, with the object at p_WO, R_WO. A distance that is no number becomes -inf."""
        geometry = self.scene.geometry
        pin.updateGeometryPlacements(kin.model.pin_model, kin.data, geometry, self._data)
        for piece in self._pieces:
            piece.translation[...] = position
            piece.rotation[...] = rotation
        pin.computeDistances(geometry, self._data)
        self.value[:] = [r.min_distance for r in self._results]
        if not self.value.size or np.isfinite(self.value.sum()):
            return self
        self.value[~np.isfinite(self.value)] = -np.inf
        return self

    @property
    def smallest(self) -> float:
        """Smallest distance over the pairs, [m]; inf where there are none."""
        return float(self.value.min()) if self.value.size else float("inf")

    def gradient(self, pair: int, kin: Kinematics) -> Array:
        """∂d/∂q of one pair, shape (nv,): coal's normal points from the first shape to the second.

        Both witness points lie on one line along the normal, so one wrench serves both bodies. For
        shapes whose normal is undefined (coincident axes) it is zero.
        """
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
