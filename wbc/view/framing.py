"""Where the camera stands, so that the picture shows what a run is about."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from wbc.arrays import Array
from wbc.robot.model import RobotModel
from wbc.view.scene import ObjectShape, SceneShape

Place = tuple[Array, Array]
"""q (nv,) and the object's position (3,)."""

_WINDOW = 1.2  # width over height of a window's free part
_LEAST = 1e-3  # [m]
_ASIDE, _ABOVE = np.deg2rad(18.0), np.deg2rad(24.0)  # of the eye, seen from the object
_MOVES = 1.25  # of a robot without an object, of which only the start is known
_ROOM = 1.8  # of the hands behind the fingertips, and of where they go


class Framing(NamedTuple):
    """Where the camera looks, and the floor, as in `wbc.view.scene.Scene`."""

    center: tuple[float, float, float]
    extent: float
    towards: tuple[float, float, float]
    floor: float


def frame(
    model: RobotModel,
    shapes: Sequence[SceneShape],
    body: ObjectShape | None,
    tips: Sequence[str],
    places: Iterable[Place],
) -> Framing:
    """A ball around everything at the given places; in space around what the hands do.

    With an object and fingertips in space the ball is around these alone: the arms reach into the
    picture from its sides, as in a photograph. The eye is on the object's far side, looking back
    at the robot.

    Args:
        tips: frames of the fingertips.
    """
    data, points, objects = model.pin_model.createData(), [], []
    own = [s for s in shapes if s.body is not None] or list(shapes)
    floor = 0.0
    close = body is not None and len(tips) > 0 and not model.planar
    for q, position in places:
        poses = dict(zip(model.full_names, placements(model, data, q), strict=True))
        floor = min([floor, *(_lowest(shape, poses) for shape in shapes)])
        if close:
            pin.updateFramePlacements(model.pin_model, data)
            points += [np.array(data.oMf[model.frame(tip)].translation) for tip in tips]
        else:
            points += [p for shape in own for p in _spread(shape, poses)]
        if body is not None:
            reach = float(np.linalg.norm(body.vertices, axis=1).max())
            points += [position - reach, position + reach]
            objects.append(position)
    base = [s.placement[:3, 3] for s in shapes if s.body is None] or [np.zeros(3)]
    ahead = np.mean(objects, axis=0) - np.mean(base, axis=0) if objects else np.zeros(3)
    towards = _towards(ahead)
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    x, y, z = (float(c) for c in 0.5 * (low + high))
    if model.planar:  # seen from above: only x and y count
        return Framing((x, y, 0.0), _filling(high[:2] - low[:2]), towards, floor)
    if not close:
        extent = max(_MOVES * 0.5 * float(np.linalg.norm(high - low)), _LEAST)
        return Framing((x, y, z), extent, towards, floor)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    seen = np.array(points) @ np.column_stack((right, np.cross(towards, right)))
    return Framing((x, y, z), _ROOM * _filling(np.ptp(seen, axis=0)), towards, floor)


def _filling(size: Array) -> float:
    """Extent at which (width, height) fills a window, which is wider than it is high."""
    return max(0.5 * max(float(size[0]) / _WINDOW, float(size[1])), _LEAST)


def _towards(ahead: Array) -> tuple[float, float, float]:
    """From in front of a robot whose work lies `ahead` of it, to its right, from above."""
    angle = float(np.arctan2(ahead[1], ahead[0])) if np.hypot(ahead[0], ahead[1]) > 1e-6 else 0.0
    angle -= _ASIDE
    return (
        float(np.cos(_ABOVE) * np.cos(angle)),
        float(np.cos(_ABOVE) * np.sin(angle)),
        float(np.sin(_ABOVE)),
    )


def _pose(shape: SceneShape, poses: dict[str, Array]) -> Array:
    return shape.placement if shape.body is None else poses[shape.body] @ shape.placement


def _spread(shape: SceneShape, poses: dict[str, Array]) -> list[Array]:
    """The middle of a shape in the world, and of rods the ends."""
    pose = _pose(shape, poses)
    middle = pose[:3, 3]
    if shape.kind not in ("cylinder", "capsule"):
        return [middle]
    half = 0.5 * shape.size[1] * pose[:3, 2]
    return [middle, middle - half, middle + half]


def _lowest(shape: SceneShape, poses: dict[str, Array]) -> float:
    """z of the lowest point of a shape in the world."""
    pose, size = _pose(shape, poses), shape.size
    if shape.vertices is not None:
        return float(np.min(shape.vertices @ pose[2, :3], initial=0.0)) + float(pose[2, 3])
    if shape.kind == "box":
        return float(pose[2, 3] - 0.5 * np.abs(pose[2, :3]) @ np.array(size))
    across = size[0] * (1.0 if shape.kind != "cylinder" else float(np.hypot(*pose[2, :2])))
    along = 0.5 * size[1] * abs(float(pose[2, 2])) if len(size) > 1 else 0.0
    return float(pose[2, 3]) - across - along


def placements(model: RobotModel, data: Any, q: Array) -> Array:
    """(n_full, 4, 4) poses of the bodies of all joints in the world, at q (nv,)."""
    pin.forwardKinematics(model.pin_model, data, model.full(q))
    out = np.zeros((model.n_full, 4, 4))
    for j in range(model.n_full):
        placement = data.oMi[j + 1]
        out[j, :3, :3], out[j, :3, 3], out[j, 3, 3] = placement.rotation, placement.translation, 1.0
    return out
