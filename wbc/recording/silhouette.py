"""Outlines of simple solids in a picture: parallel projection, no renderer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.rotations import rotation_from_quaternion

_ROUND = 24  # corners of a circle


@final
@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection.

    Attributes:
        right, up, towards: (3,) axes of the picture and the direction to the eye, in the world.
    """

    right: Array
    up: Array
    towards: Array

    @classmethod
    def from_above(cls) -> View:
        """Looking down on the x-y plane, y up in the picture."""
        return cls(*np.eye(3))

    @classmethod
    def along(cls, towards: Sequence[float]) -> View:
        """From the direction `towards` (3,), of any length but not vertical; z up."""
        eye = np.array(towards) / np.linalg.norm(towards)
        right = np.cross((0.0, 0.0, 1.0), eye)
        right /= np.linalg.norm(right)
        return cls(right, np.cross(eye, right), eye)

    def flat(self, points: Array) -> Array:
        """(n, 2) picture coordinates [m] of (n, 3) points in the world."""
        return np.stack((points @ self.right, points @ self.up), axis=-1)

    def depth(self, points: Array) -> Array:
        """How near the eye (…, 3) points are, [m]; larger is nearer."""
        nearness: Array = points @ self.towards
        return nearness


def matrices(poses: Array) -> Array:
    """(n, 4, 4) of (n, 7) or (7,) poses x y z qx qy qz qw, or of matrices; NaN where not finite."""
    poses = np.asarray(poses, dtype=np.float64)
    if poses.ndim == 3:
        return poses
    poses = poses.reshape(-1, 7)
    out = np.tile(np.eye(4), (len(poses), 1, 1))
    for k, pose in enumerate(poses):
        out[k, :3, :3] = rotation_from_quaternion(pose[3:])  # a zero one gives NaN
        out[k, :3, 3] = pose[:3]
    return out


def outline(
    kind: str,
    size: tuple[float, ...],
    vertices: Array | None,
    triangles: IntArray | None,
    pose: Array,
    view: View,
) -> list[Array]:
    """What a solid covers in the picture: closed (k, 2) polygons, for a line the line itself.

    Args:
        kind: ``"cylinder"``, ``"sphere"``, ``"box"``, ``"capsule"``, ``"mesh"`` or ``"line"``.
        size: as of `wbc.view.scene.SceneShape`.
        pose: (4, 4) in the world.
    """
    rotation, place = pose[:3, :3], pose[:3, 3]
    if kind in ("mesh", "line"):
        assert vertices is not None
        world = vertices @ rotation.T + place
        if kind == "line" or triangles is None:
            return [view.flat(world)]
        corners = world[triangles]
        order = np.argsort(view.depth(corners.mean(axis=1)))
        return list(view.flat(corners[order].reshape(-1, 3)).reshape(-1, 3, 2))
    if kind == "box":
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners = 0.5 * signs * np.array(size)
        return [convex_hull(view.flat(corners @ rotation.T + place))]
    radius, half = size[0], 0.5 * size[1] if len(size) > 1 else 0.0
    ends = np.array(((0.0, 0.0, -half), (0.0, 0.0, half)))
    circle = _circle()
    if kind == "cylinder":
        rim = np.column_stack((radius * circle, np.zeros(len(circle))))
        points = np.concatenate([rim + end for end in ends])
        return [convex_hull(view.flat(points @ rotation.T + place))]
    # a sphere looks the same from everywhere, and a capsule is all the spheres between its ends
    middle = view.flat(ends @ rotation.T + place)
    return [convex_hull(np.concatenate([centre + radius * circle for centre in middle]))]


def _circle() -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    return np.column_stack((np.cos(angle), np.sin(angle)))


def convex_hull(points: Array) -> Array:
    """(k, 2) corners of the hull of (n, 2) points, counter-clockwise (Andrew's monotone chain)."""
    ordered = [(float(x), float(y)) for x, y in points[np.lexsort((points[:, 1], points[:, 0]))]]

    def chain(sequence: list[tuple[float, float]]) -> list[tuple[float, float]]:
        corners: list[tuple[float, float]] = []
        for p in sequence:
            while len(corners) > 1 and _turn(corners[-2], corners[-1], p) <= 0.0:
                corners.pop()
            corners.append(p)
        return corners[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1])).reshape(-1, 2)


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
