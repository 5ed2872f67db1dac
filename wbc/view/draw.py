"""A scene and its snapshots as meshcat commands.

Nodes of the page's scene tree, each a stable path:

    /wbc/grid                         lines for scale, 1, 2 or 5 times a power of ten apart
    /wbc/world/<shape>                what belongs to no body
    /wbc/robot/<body>/<shape>         the pose is that of /wbc/robot/<body>
    /wbc/object                       pose; below it /wbc/object/mesh and /wbc/object/outline
    /wbc/contacts/<name>/point        sphere at the contact, its colour that of the contact's state
    /wbc/contacts/<name>/normal       arrow along z, the outward normal; while the finger touches,
                                      in a scene without forces
    /wbc/forces/<name>/cone, force    of a contact, where forces are planned; where they are
                                      measured, also .../measured; the rest of them are
                                      /wbc/forces/weight, weight_moment, resultant and
                                      resultant_moment (see `wbc.view.arrows`)

A shape with a finger takes the colour of that contact's state while it touches, and that of a
torque limit while one of its finger is active.

The text panel is no node: meshcat has no fixed overlay, so it is #wbc-panel of the page.

Commands are bytes in meshcat's own protocol, keyed by what they set. A page is up to date once it
has had the latest bytes of every key, in the order of the keys; that is all the server keeps.
"""

from __future__ import annotations

import math
import uuid
from typing import Any, NamedTuple

import numpy as np
import umsgpack
from meshcat import geometry as g

from wbc.arrays import Array, IntArray
from wbc.view import arrows
from wbc.view.meshes import capsule, ribbon
from wbc.view.scene import (
    ObjectShape,
    Scene,
    SceneShape,
    Snapshot,
    body_matrices,
    contact_frames,
    pose_matrices,
)

Commands = dict[tuple[str, str], bytes]
"""(path, property) -> encoded command."""

FREE = (0.62, 0.65, 0.70, 1.0)
FIXED = (0.16, 0.68, 0.35, 1.0)
SLIDING = (0.16, 0.44, 0.92, 1.0)
STATES = (FREE, FIXED, SLIDING)
"""Colour of a contact by its mode."""

GRID = (0.80, 0.835, 0.875, 1.0)
OUTLINE = (0.16, 0.18, 0.23, 1.0)
OUTLINE_WIDTH = 0.010


class Marks(NamedTuple):
    """Sizes of the marks of a contact, as parts of the extent of the scene."""

    point: float
    length: float
    radius: float


PLANAR_MARKS = Marks(0.016, 0.13, 0.0055)
SPATIAL_MARKS = Marks(0.0095, 0.13, 0.0028)
"""Slimmer: a hand's fingertips are close together."""


_ABOVE = {"depthTest": False, "transparent": True}
_BACKGROUND = {"top_color": [1.0, 1.0, 1.0], "bottom_color": [0.90, 0.925, 0.95]}
# three.js lays cylinders along y; the convention of robot descriptions is z.
_Z_FROM_Y = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


def node(*names: str) -> str:
    """The path of a node; a slash inside a name would open another level, so it is replaced."""
    return "/wbc/" + "/".join(name.replace("/", "|") or "_" for name in names)


def shape_node(shape: SceneShape) -> str:
    """The path of a shape."""
    place = ("world",) if shape.body is None else ("robot", shape.body)
    return node(*place, shape.name)


def pack(command: dict[str, Any]) -> bytes:
    """One command in meshcat's protocol."""
    data: bytes = umsgpack.packb(command)
    return data


def set_transform(path: str, matrix: Array) -> bytes:
    column_major = matrix.T.ravel().tolist()
    return pack({"type": "set_transform", "path": path, "matrix": column_major})


def set_property(path: str, key: str, value: Any) -> bytes:
    return pack({"type": "set_property", "path": path, "property": key, "value": value})


def _set_object(path: str, shape: Any, material: Any, **more: Any) -> bytes:
    solid = g.Mesh(shape, material) if isinstance(shape, g.Geometry) else shape
    # meshcat's own identifiers hold the machine's network address and the time; ours only the path.
    for part, element in (("s", shape), ("g", solid.geometry), ("m", material), ("o", solid)):
        element.uuid = str(uuid.uuid5(uuid.NAMESPACE_URL, f"{path}#{part}"))
    lowered = solid.lower()
    lowered["object"].update(more)
    for described in lowered["geometries"]:
        if described["type"] == "SphereGeometry":
            described.update(widthSegments=40, heightSegments=28)  # meshcat's 20 show corners
    return pack({"type": "set_object", "path": path, "object": lowered})


def _material(rgba: tuple[float, ...], kind: Any = g.MeshLambertMaterial, **more: Any) -> Any:
    red, green, blue = (round(255 * min(max(c, 0.0), 1.0)) for c in rgba[:3])
    return kind(color=(red << 16) + (green << 8) + blue, opacity=float(rgba[3]), **more)


def _mesh(vertices: Array, triangles: Any) -> Any:
    return g.TriangularMeshGeometry(vertices, triangles)


def _geometry(shape: SceneShape) -> Any:
    size = [float(s) for s in shape.size]
    if shape.kind == "sphere":
        return g.Sphere(size[0])
    if shape.kind == "box":
        return g.Box(size)
    if shape.kind == "cylinder":
        return g.Cylinder(size[1], size[0])
    if shape.kind == "capsule":
        return _mesh(*capsule(size[0], size[1]))
    assert shape.vertices is not None
    if shape.kind == "line":
        return g.PointsGeometry(np.asarray(shape.vertices, dtype=np.float32).T)
    return _mesh(shape.vertices, shape.triangles)


def _shape(out: Commands, path: str, shape: SceneShape) -> None:
    geometry = _geometry(shape)
    if shape.kind == "line":
        material = _material(shape.rgba, g.LineBasicMaterial)
        out[path, "object"] = _set_object(path, g.Line(geometry, material), material)
    else:
        out[path, "object"] = _set_object(path, geometry, _material(shape.rgba))
    placement = np.asarray(shape.placement, dtype=np.float64)
    if shape.kind == "cylinder":
        placement = placement @ _Z_FROM_Y
    out[path, "transform"] = set_transform(path, placement)


def _object(out: Commands, scene: Scene, shape: ObjectShape) -> None:
    path = node("object", "mesh")
    out[path, "object"] = _set_object(
        path, _mesh(shape.vertices, shape.triangles), _material(shape.rgba)
    )
    if shape.outline is None:
        return
    path, outline = node("object", "outline"), np.asarray(shape.outline, dtype=np.float64)
    if scene.planar:
        top = float(np.max(shape.vertices[:, 2])) + 1e-3 * scene.extent
        band = ribbon(outline, OUTLINE_WIDTH * scene.extent, top)
        material = _material(OUTLINE, g.MeshBasicMaterial)
        out[path, "object"] = _set_object(path, _mesh(*band), material)
    else:
        material = _material(OUTLINE, g.LineBasicMaterial)
        points = g.PointsGeometry(outline.astype(np.float32).T)
        out[path, "object"] = _set_object(path, g.LineLoop(points, material), material)


def _contact(out: Commands, scene: Scene, name: str) -> None:
    """Marks drawn over everything else: a contact lies between two solids and would be hidden."""
    marks = PLANAR_MARKS if scene.planar else SPATIAL_MARKS
    path = node("contacts", name, "normal")
    length, radius = marks.length * scene.extent, marks.radius * scene.extent
    head = 0.32 * length
    parts = (
        ("shaft", g.Cylinder(length - head, radius), 0.5 * (length - head)),
        ("head", g.Cylinder(head, radiusTop=0.0, radiusBottom=2.8 * radius), length - 0.5 * head),
    )
    for part, solid, height in parts:
        place = _Z_FROM_Y.copy()
        place[2, 3] = height
        below, material = f"{path}/{part}", _material(FREE, g.MeshBasicMaterial, **_ABOVE)
        out[below, "object"] = _set_object(below, solid, material, renderOrder=2)
        out[below, "transform"] = set_transform(below, place)
    path = node("contacts", name, "point")
    material = _material(FREE, g.MeshBasicMaterial, **_ABOVE)
    ball = g.Sphere(marks.point * scene.extent)
    out[path, "object"] = _set_object(path, ball, material, renderOrder=3)


def _grid(out: Commands, scene: Scene) -> None:
    """A grid of the scene's own size in place of meshcat's, whose cells are half a metre."""
    x, y, z = scene.center
    step = _grid_step(scene.extent)
    half = step * math.ceil((3.2 if scene.planar else 2.4) * scene.extent / step)
    x, y = step * round(x / step), step * round(y / step)
    # Behind a planar scene: seen from afar its depth makes no difference.
    z = z - 0.5 * scene.extent if scene.planar else scene.floor
    ticks = np.arange(-half, half + 0.5 * step, step)
    ends = [(t, s * half, 0.0) for t in ticks for s in (-1, 1)]
    lines = np.array([*ends, *((b, a, c) for a, b, c in ends)])
    lines += (x, y, z)
    material = _material(GRID, g.LineBasicMaterial)
    points = g.PointsGeometry(lines.astype(np.float32).T)
    path = node("grid")
    out[path, "object"] = _set_object(path, g.LineSegments(points, material), material)


def _grid_step(extent: float) -> float:
    """1, 2 or 5 times a power of ten, about a fifth of `extent`."""
    power = 10.0 ** math.floor(math.log10(extent / 5.0))
    return power * max(k for k in (1.0, 2.0, 5.0) if k * power <= extent / 5.0 * (1 + 1e-9))


def fixed_commands(scene: Scene) -> Commands:
    """What is sent once: background, grid, shapes."""
    out: Commands = {}
    for key, value in _BACKGROUND.items():
        out["/Background", key] = set_property("/Background", key, value)
    out["/Axes", "visible"] = set_property("/Axes", "visible", False)
    out["/Grid", "visible"] = set_property("/Grid", "visible", False)
    _grid(out, scene)
    for shape in scene.shapes:
        _shape(out, shape_node(shape), shape)
    if scene.object is not None:
        _object(out, scene, scene.object)
    for name in scene.contact_names:
        _contact(out, scene, name)
    for names, mark in arrows.marks(scene).items():
        path = node(*names)
        material = _material(mark.rgba, g.MeshBasicMaterial, **_ABOVE)
        out[path, "object"] = _set_object(path, _mesh(*mark.mesh), material, renderOrder=mark.order)
    return out


def poses(scene: Scene, snapshot: Snapshot) -> dict[str, Array]:
    """The pose of every moving node, that of an arrow with its length; NaN where there is none."""
    out: dict[str, Array] = {}
    for name, matrix in zip(scene.body_names, body_matrices(snapshot), strict=True):
        out[node("robot", name)] = matrix
    if scene.object is not None:
        out[node("object")] = pose_matrices(snapshot.object_pose)[0]
    frames = contact_frames(
        np.asarray(snapshot.contact_points, dtype=np.float64).reshape(-1, 3),
        np.asarray(snapshot.contact_normals, dtype=np.float64).reshape(-1, 3),
    )
    touching = np.where((np.asarray(snapshot.contact_mode) != 0)[:, None, None], frames, np.nan)
    for name, frame, normal in zip(scene.contact_names, frames, touching, strict=True):
        at_point = np.eye(4)
        at_point[:3, 3] = frame[:3, 3]
        out[node("contacts", name, "point")] = at_point
        # a cone says where the normal is, and stands where its arrow would
        hidden = bool(scene.friction_angles)
        out[node("contacts", name, "normal")] = np.full((4, 4), np.nan) if hidden else normal
    for names, matrix in arrows.poses(scene, snapshot.forces, touching).items():
        out[node(*names)] = matrix
    return out


def moving_commands(scene: Scene, snapshot: Snapshot) -> Commands:
    """What a snapshot sets; a node without a finite pose is hidden."""
    out: Commands = {}
    for path, matrix in poses(scene, snapshot).items():
        known = bool(np.isfinite(matrix).all())
        out[path, "visible"] = set_property(path, "visible", known)
        if known:
            out[path, "transform"] = set_transform(path, matrix)
    modes = dict(zip(scene.contact_names, snapshot.contact_mode, strict=True))
    for name, mode in modes.items():
        for part in ("point", "normal"):
            path = node("contacts", name, part)
            out[path, "color"] = set_property(path, "color", list(STATES[mode]))
    states = dict(zip(scene.contact_names, tip_states(snapshot).tolist(), strict=True))
    for path, shape in tips(scene).items():
        color = tip_colors(shape)[states[shape.finger or ""]]
        out[path, "color"] = set_property(path, "color", list(color))
    for names, rgba in arrows.colors(scene, snapshot.forces).items():
        path = node(*names)
        out[path, "color"] = set_property(path, "color", list(rgba))
    return out


def tips(scene: Scene) -> dict[str, SceneShape]:
    """Path to shape of the fingertips that show a contact's state."""
    return {shape_node(s): s for s in scene.shapes if s.finger is not None}


def tip_colors(shape: SceneShape) -> tuple[tuple[float, ...], ...]:
    """Colours of a fingertip by `tip_states`: its own while it is free."""
    return (shape.rgba, *STATES[1:], arrows.LIMITED)


def tip_states(snapshot: Snapshot) -> IntArray:
    """(N,) mode of each contact; 3 where a torque limit of its finger is active."""
    mode = np.asarray(snapshot.contact_mode, dtype=np.int64)
    if snapshot.forces is None:
        return mode
    return np.where(snapshot.forces.limited, len(STATES), mode)
