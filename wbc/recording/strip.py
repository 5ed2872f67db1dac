"""A run as a strip of pictures, like Figure 14 of the chapter.

Any robot can be drawn: bodies come as simple shapes with poses. The shapes are those that the live
view draws, but only what is read here is asked of them, so that neither room imports the other.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.patheffects import withStroke

from wbc.arrays import Array, IntArray
from wbc.errors import WbcError
from wbc.recording.figures import panels, save, style
from wbc.recording.force_marks import Arrows, draw_forces
from wbc.recording.log import Log
from wbc.recording.raycast import Picture
from wbc.recording.silhouette import View, matrices, outline
from wbc.recording.summary import phase_starts

_NOTHING = "no picture strip: no body has a finite pose"
_EDGE = "#3A3F47"
_NORMAL = "#B2182B"
_STATES = ("#9EA6B3", "#29AD59", "#2970EB")  # of a contact by its mode, as on the page
_WINDOW = (1.42, 0.9)  # half width and height of a picture in space, in extents of the camera
_PIXELS = 1440  # rendered across the page
_WIDTH = 9.6  # of the page, [inch]
_TITLE = 0.3  # height of a picture's title, [inch]


class Shape(Protocol):
    """A solid on a body, see `wbc.view.scene.SceneShape`."""

    @property
    def kind(self) -> str: ...
    @property
    def body(self) -> str | None: ...
    @property
    def size(self) -> tuple[float, ...]: ...
    @property
    def vertices(self) -> Array | None: ...
    @property
    def triangles(self) -> IntArray | None: ...
    @property
    def rgba(self) -> tuple[float, float, float, float]: ...
    @property
    def placement(self) -> Array: ...
    @property
    def finger(self) -> str | None: ...


class ObjectBody(Protocol):
    """The manipulated object, see `wbc.view.scene.ObjectShape`."""

    @property
    def vertices(self) -> Array: ...
    @property
    def triangles(self) -> IntArray: ...
    @property
    def rgba(self) -> tuple[float, float, float, float]: ...
    @property
    def outline(self) -> Array | None: ...


class Stage(Protocol):
    """What does not change during a run, see `wbc.view.scene.Scene`."""

    @property
    def shapes(self) -> Sequence[Shape]: ...
    @property
    def object(self) -> ObjectBody | None: ...
    @property
    def body_names(self) -> tuple[str, ...]: ...
    @property
    def contact_names(self) -> tuple[str, ...]: ...
    @property
    def phase_names(self) -> tuple[str, ...]: ...
    @property
    def planar(self) -> bool: ...
    @property
    def center(self) -> tuple[float, float, float]: ...
    @property
    def extent(self) -> float: ...
    @property
    def towards(self) -> tuple[float, float, float]: ...
    @property
    def friction_angles(self) -> tuple[float, ...]: ...


class Instant(Protocol):
    """One moment of a run, see `wbc.view.scene.Snapshot`."""

    @property
    def t(self) -> float: ...
    @property
    def bodies(self) -> Array: ...
    @property
    def object_pose(self) -> Array: ...
    @property
    def contact_points(self) -> Array: ...
    @property
    def contact_normals(self) -> Array: ...
    @property
    def contact_mode(self) -> IntArray: ...
    @property
    def phase(self) -> int: ...
    @property
    def forces(self) -> Arrows | None: ...


def moments(log: Log, count: int = 5) -> IntArray:
    """Ticks worth a picture, in this order until there are enough of them.

    The first and the last; where a finger touches or leaves as a phase begins; where other phases
    begin, each time the one in the widest gap; then the widest gaps halved.

    Returns:
        At most `count` increasing indices into the log's ticks, fewer for a shorter log.
    """
    if not log.ticks or count < 1:
        return np.zeros(0, dtype=np.int64)
    chosen = [0] if count == 1 else sorted({0, log.ticks - 1})
    starts = [int(k) for k in phase_starts(log)[1:] if int(k) not in chosen]
    touching = [k for k in starts if (log.in_contact[k] != log.in_contact[k - 1]).any()]
    for candidates in (touching, starts):
        while len(chosen) < count and (left := [k for k in candidates if k not in chosen]):
            apart = [int(np.min(np.abs(np.array(chosen) - k))) for k in left]
            chosen = sorted([*chosen, left[int(np.argmax(apart))]])
    while len(chosen) < min(count, log.ticks):
        gaps = np.diff(chosen)
        widest = int(np.argmax(gaps))
        chosen.insert(widest + 1, chosen[widest] + int(gaps[widest]) // 2)
    return np.array(chosen, dtype=np.int64)


def draw_strip(stage: Stage, instants: Sequence[Instant], path: str | os.PathLike[str]) -> Path:
    """Draw `instants` side by side as one PNG, all at one scale.

    Args:
        stage: a planar one is drawn in outlines, seen from +z; any other shaded, seen as by the
            camera of the stage.
        instants: from the first on the left to the last, each with poses for the stage's bodies.

    Raises:
        WbcError: there is nothing to draw, or the file cannot be written.
    """
    if not instants:
        raise WbcError("no picture strip: no instant was given")
    view = View.from_above() if stage.planar else View.along(stage.towards)
    with style(), np.errstate(all="ignore"):
        low, high = _frame(stage, instants, view) if stage.planar else _camera(stage, view)
        if not stage.planar and not any(_placed(stage, instant) for instant in instants):
            raise WbcError(_NOTHING)
        aspect = float((high[1] - low[1]) / (high[0] - low[0]))
        columns, rows = _layout(len(instants), aspect)
        height = _WIDTH / columns * aspect + _TITLE
        figure, axes_list = panels(rows, columns, height=min(max(height, 0.8), 9.0))
        for axes, instant in zip(axes_list, instants, strict=False):
            _head(axes, stage, instant)
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[1], high[1])
            if stage.planar:
                _draw(axes, stage, instant, view)
                _draw_contacts(axes, stage, instant, view)
            else:
                _shade(axes, stage, instant, view, (low, high), round(_PIXELS / columns))
                _mark_contacts(axes, stage, instant, view)
            if instant.forces is not None and stage.friction_angles:
                points, normals = instant.contact_points, instant.contact_normals
                draw_forces(axes, instant.forces, points, normals, stage.friction_angles, view)
        for axes in axes_list:
            axes.set_axis_off()
        return save(figure, Path(path))


def _frame(stage: Stage, instants: Sequence[Instant], view: View) -> tuple[Array, Array]:
    """Corners (2,) around all that moves, with a margin."""
    points = np.concatenate([_covered(stage, instant, view) for instant in instants])
    if not len(points):
        raise WbcError(_NOTHING)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.04 * float(np.max(high - low)) + 1e-6
    return low - margin, high + margin


def _camera(stage: Stage, view: View) -> tuple[Array, Array]:
    """Corners (2,) of what the stage's camera shows."""
    middle = view.flat(np.array(stage.center))
    half = stage.extent * np.array(_WINDOW)
    return middle - half, middle + half


def _layout(count: int, aspect: float) -> tuple[int, int]:
    """Columns and rows: one row where pictures are tall, else as large as a page's width allows."""
    if aspect > 0.7 and count <= 5:
        return count, 1
    for columns in range(1, count):
        rows = -(-count // columns)
        if rows * (_WIDTH / columns * aspect + _TITLE) <= 0.65 * _WIDTH:
            return columns, rows
    columns = min(count, 5)
    return columns, -(-count // columns)


def _placed(stage: Stage, instant: Instant) -> list[tuple[Shape, Array]]:
    """Shapes with their (4, 4) pose in the world; those without a finite pose are left out."""
    poses = dict(zip(stage.body_names, matrices(instant.bodies), strict=True))
    poses_of = [
        (s, np.asarray(s.placement) if s.body is None else poses[s.body] @ s.placement)
        for s in stage.shapes
    ]
    return [(s, pose) for s, pose in poses_of if np.isfinite(pose).all()]


def _covered(stage: Stage, instant: Instant, view: View) -> Array:
    """(n, 2) picture coordinates of all that moves, [m]; the world's own shapes do not count."""
    drawn = [
        piece
        for shape, pose in _placed(stage, instant)
        if shape.body is not None
        for piece in outline(shape.kind, shape.size, shape.vertices, shape.triangles, pose, view)
    ]
    if stage.object is not None:
        pose = matrices(instant.object_pose)[0]
        drawn.append(view.flat(stage.object.vertices @ pose[:3, :3].T + pose[:3, 3]))
    points = np.concatenate([np.empty((0, 2)), *drawn])
    finite: Array = points[np.isfinite(points).all(axis=1)]
    return finite


def _head(axes: Axes, stage: Stage, instant: Instant) -> None:
    axes.set_aspect("equal")
    name = stage.phase_names[instant.phase] if instant.phase >= 0 and stage.phase_names else ""
    axes.set_title(
        f"{instant.t:.2f} s  {name.replace('_', ' ')}", pad=4.0, fontsize=8.0, loc="center",
        fontweight="normal",
    )  # fmt: skip


def _shade(
    axes: Axes,
    stage: Stage,
    instant: Instant,
    view: View,
    corners: tuple[Array, Array],
    width: int,
) -> None:
    """All solids with light and shadow, what is in front before what is behind."""
    low, high = corners
    picture = Picture(view, low, high, width)
    modes = dict(zip(stage.contact_names, instant.contact_mode, strict=True))
    for shape, pose in _placed(stage, instant):
        mode = int(modes[shape.finger]) if shape.finger is not None else 0
        rgb = to_rgb(_STATES[mode]) if mode else shape.rgba[:3]
        if shape.kind == "mesh":
            assert shape.vertices is not None and shape.triangles is not None
            picture.mesh(shape.vertices, shape.triangles, pose, rgb)
        elif shape.kind != "line":
            picture.solid(shape.kind, shape.size, pose, rgb)
    if stage.object is not None:
        item = matrices(instant.object_pose)[0]
        if np.isfinite(item).all():
            body = stage.object
            picture.mesh(body.vertices, body.triangles, item, body.rgba[:3])
    axes.imshow(
        picture.image(), extent=(low[0], high[0], low[1], high[1]), interpolation="antialiased"
    )


def _mark_contacts(axes: Axes, stage: Stage, instant: Instant, view: View) -> None:
    """As on the page: dot and outward normal in the colour of the contact's state."""
    if stage.friction_angles:
        return  # forces and cones say more, and there is no room for both
    for point, normal, mode in zip(
        instant.contact_points, instant.contact_normals, instant.contact_mode, strict=True
    ):
        if not mode or not np.isfinite([point, normal]).all():
            continue
        start, end = view.flat(np.stack((point, point + 0.13 * stage.extent * normal)))
        axes.annotate(
            "", xy=(float(end[0]), float(end[1])), xytext=(float(start[0]), float(start[1])),
            arrowprops={"arrowstyle": "-|>", "color": _STATES[mode], "linewidth": 0.8,
                        "shrinkA": 0, "shrinkB": 0, "mutation_scale": 4},
        )  # fmt: skip
        axes.plot(*start, "o", color=_STATES[mode], markersize=1.8)


def _draw(axes: Axes, stage: Stage, instant: Instant, view: View) -> None:
    """Outlines, flat and filled."""
    # the world's own shapes are the background, the rest goes from the back to the front; in the
    # plane, where all are level, fingers are drawn over the object
    order = [
        (shape.body is not None, float(view.depth(pose[:3, 3])), shape, pose)
        for shape, pose in _placed(stage, instant)
    ]
    item = matrices(instant.object_pose)[0] if stage.object is not None else np.full((4, 4), np.nan)
    if stage.object is not None and np.isfinite(item).all():
        _draw_object(axes, stage.object, item, view, 1.0)
    front = -np.inf if stage.planar else float(view.depth(item[:3, 3]))
    for moves, depth, shape, pose in sorted(order, key=lambda entry: entry[:2]):
        layer = 2.0 if depth >= front or np.isnan(front) else 0.5
        _draw_shape(axes, shape, pose, view, layer if moves else 0.0)


def _draw_shape(axes: Axes, shape: Shape, pose: Array, view: View, layer: float) -> None:
    pieces = outline(shape.kind, shape.size, shape.vertices, shape.triangles, pose, view)
    if shape.kind == "line":
        for piece in pieces:
            axes.plot(*piece.T, color=shape.rgba[:3], linewidth=1.0, zorder=layer)
        return
    edge = "none" if shape.kind == "mesh" else _EDGE  # a mesh would drown in its edges
    axes.add_collection(
        PolyCollection(
            [p.tolist() for p in pieces], facecolors=[shape.rgba], edgecolors=edge, linewidths=0.5,
            zorder=layer,
        ),
        autolim=False,
    )  # fmt: skip


def _draw_object(axes: Axes, body: ObjectBody, pose: Array, view: View, layer: float) -> None:
    """Its mesh, shaded by the slope of its faces, and its true contour on top."""
    world = body.vertices @ pose[:3, :3].T + pose[:3, 3]
    corners = world[body.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    facing = normal @ view.towards / np.where(length > 0.0, length, 1.0)
    seen = np.flatnonzero(facing > 0.0)
    seen = seen[np.argsort(view.depth(corners[seen].mean(axis=1)))]
    light = (0.55 + 0.45 * facing[seen])[:, None]
    color = np.clip(light * np.array(to_rgb(body.rgba[:3])), 0.0, 1.0)
    faces = view.flat(corners[seen].reshape(-1, 3)).reshape(-1, 3, 2)
    # edges in the faces' own colour close the hair lines between them
    axes.add_collection(
        PolyCollection(
            faces.tolist(), facecolors=color, edgecolors=color, linewidths=0.3, zorder=layer
        )
    )
    if body.outline is not None and len(body.outline):
        line = view.flat(body.outline @ pose[:3, :3].T + pose[:3, 3])
        axes.plot(*np.vstack((line, line[:1])).T, color=_EDGE, linewidth=0.9, zorder=layer + 0.1)


def _draw_contacts(axes: Axes, stage: Stage, instant: Instant, view: View) -> None:
    """A dot and the outward normal where a finger touches."""
    size = 0.08 * _extent(stage, instant, view)
    for i, name in enumerate(stage.contact_names):
        point, normal = instant.contact_points[i], instant.contact_normals[i]
        if not instant.contact_mode[i] or not np.isfinite([point, normal]).all():
            continue
        start, end = view.flat(np.stack((point, point + size * normal)))
        axes.annotate(
            "", xy=(float(end[0]), float(end[1])), xytext=(float(start[0]), float(start[1])),
            arrowprops={"arrowstyle": "-|>", "color": _NORMAL, "linewidth": 1.0, "shrinkA": 0,
                        "shrinkB": 0, "mutation_scale": 6}, zorder=6,
        )  # fmt: skip
        axes.plot(*start, "o", color=_NORMAL, markersize=2.6, zorder=7)
        beyond = end + 0.5 * (end - start)
        axes.annotate(
            name, (float(beyond[0]), float(beyond[1])), fontsize=6.0, color=_NORMAL, ha="center",
            va="center", zorder=8, annotation_clip=False,
            path_effects=[withStroke(linewidth=1.5, foreground="white")],
        )  # fmt: skip


def _extent(stage: Stage, instant: Instant, view: View) -> float:
    points = _covered(stage, instant, view)
    return float(np.ptp(points, axis=0).max(initial=0.0)) if len(points) else 0.0
