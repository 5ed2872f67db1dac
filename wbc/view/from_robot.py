"""A robot and its grasp as a scene, and the instants of a run as snapshots of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.grasp import Grasp
from wbc.contact.surfaces import Surface
from wbc.control.state import TickRecord
from wbc.robot.model import RobotModel
from wbc.robot.prepare import prepared
from wbc.rotations import quaternion
from wbc.stack.supervisor import StackEvent
from wbc.view.scene import Kind, ObjectShape, Rgba, Scene, SceneShape, Snapshot

_GREY: Rgba = (0.6, 0.62, 0.66, 1.0)
_ROUND = 240  # points of a contour: no corner is seen
_WINDOW = 1.2  # width over height of a window's free part
_LEAST_EXTENT = 1e-3  # [m]


def robot_scene(
    model: RobotModel,
    grasp: Grasp,
    *,
    title: str,
    task_names: tuple[str, ...] = (),
    phase_names: tuple[str, ...] = (),
    shown: Iterable[tuple[Array, Array]] = (),
) -> Scene:
    """The robot's visual shapes, the grasp's object and the names of what a run changes.

    Args:
        task_names: of the panel, highest priority first.
        shown: pairs of q (nv,) and the object's position (3,) that the camera has to take in; by
            default the robot's middle position.
    """
    shapes = robot_shapes(model)
    body = object_shape(grasp.surface, _thickness(shapes)) if grasp.count else None
    places = list(shown) or [(0.5 * (model.lower + model.upper), np.zeros(3))]
    center, extent = _camera(model, shapes, body, places)
    return Scene(
        title=title,
        shapes=shapes,
        object=body,
        body_names=model.full_names,
        contact_names=grasp.fingers,
        task_names=task_names,
        phase_names=phase_names,
        planar=model.planar,
        extent=extent,
        center=center,
    )


def robot_shapes(model: RobotModel) -> tuple[SceneShape, ...]:
    """What the URDF says the robot looks like; its collision shapes where it says nothing."""
    geometry = model.geometry
    try:
        visual = pin.buildGeomFromUrdfString(
            model.pin_model, prepared(model.text, model.path), pin.GeometryType.VISUAL
        )  # fmt: skip
        geometry = visual if len(visual.geometryObjects) else geometry
    except (ValueError, RuntimeError):
        pass  # meshes that are not on this machine: the collision shapes are drawn instead
    names = model.pin_model.names
    found = []
    for o in geometry.geometryObjects:
        body = None if o.parentJoint == 0 else str(names[o.parentJoint])
        shape = _shape(o, body)
        if shape is not None:
            found.append(shape)
    return tuple(found)


def _shape(o: Any, body: str | None) -> SceneShape | None:
    """One of Pinocchio's geometry objects; None for a kind that cannot be drawn."""
    solid = o.geometry
    rgba = tuple(float(c) for c in o.meshColor) if o.overrideMaterial else _GREY
    size: tuple[float, ...] = ()
    vertices: Array | None = None
    triangles: IntArray | None = None
    kind: Kind = "mesh"
    name = type(solid).__name__
    if name in ("Cylinder", "Capsule"):
        kind = "cylinder" if name == "Cylinder" else "capsule"
        size = (float(solid.radius), 2.0 * float(solid.halfLength))
    elif name == "Sphere":
        kind, size = "sphere", (float(solid.radius),)
    elif name == "Box":
        kind, size = "box", tuple(2.0 * float(x) for x in solid.halfSide)
    elif hasattr(solid, "tri_indices"):  # coal's meshes of every bounding-volume type
        vertices = np.array(solid.vertices(), dtype=np.float64).reshape(-1, 3)
        triangles = np.array(
            [[t[0], t[1], t[2]] for t in map(solid.tri_indices, range(solid.num_tris))],
            dtype=np.int64,
        ).reshape(-1, 3)
    else:
        return None
    placement = np.array(o.placement.homogeneous, dtype=np.float64)
    return SceneShape(
        str(o.name), kind, body, size, vertices, triangles, (rgba[0], rgba[1], rgba[2], rgba[3]),
        placement,
    )  # fmt: skip


def object_shape(surface: Surface, half_thickness: float) -> ObjectShape:
    """The object's body, and the contour where it is planar."""
    vertices, triangles = surface.mesh(_ROUND if surface.planar else 64, half_thickness)
    outline = None
    if surface.planar:
        u = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
        outline = surface.charts(np.column_stack((u, np.zeros(_ROUND))))[:, 0]
    return ObjectShape(vertices, triangles, outline=outline)


def _thickness(shapes: Sequence[SceneShape]) -> float:
    """Half the thickness of a contour: that of the slimmest rod, so that fingertips are seen."""
    radii = [s.size[0] for s in shapes if s.kind in ("cylinder", "capsule")]
    return 0.8 * min(radii, default=0.05)


def _camera(
    model: RobotModel,
    shapes: Sequence[SceneShape],
    body: ObjectShape | None,
    places: Iterable[tuple[Array, Array]],
) -> tuple[tuple[float, float, float], float]:
    """Centre and radius of a ball around everything at the given places."""
    data, points = model.pin_model.createData(), []
    own = [s for s in shapes if s.body is not None] or list(shapes)
    for q, position in places:
        poses = dict(zip(model.full_names, _placements(model, data, q), strict=True))
        for shape in own:
            pose = shape.placement if shape.body is None else poses[shape.body] @ shape.placement
            points.append(pose[:3, 3])
            if shape.kind in ("cylinder", "capsule"):
                half = 0.5 * shape.size[1] * pose[:3, 2]
                points += [pose[:3, 3] - half, pose[:3, 3] + half]
        if body is not None:
            reach = float(np.linalg.norm(body.vertices, axis=1).max())
            points += [position - reach, position + reach]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    x, y, z = (float(c) for c in 0.5 * (low + high))
    size = high - low
    # In the plane the camera looks from above: only x and y count, and windows are wide.
    across = max(float(size[0]) / _WINDOW, float(size[1]))
    extent = 0.5 * (across if model.planar else float(np.linalg.norm(size)))
    return (x, y, 0.0 if model.planar else z), max(extent, _LEAST_EXTENT)


def _placements(model: RobotModel, data: Any, q: Array) -> Array:
    """(n_full, 4, 4) poses of the bodies of all joints in the world, at q (nv,)."""
    pin.forwardKinematics(model.pin_model, data, model.full(q))
    out = np.zeros((model.n_full, 4, 4))
    for j in range(model.n_full):
        placement = data.oMi[j + 1]
        out[j, :3, :3], out[j, :3, 3], out[j, 3, 3] = placement.rotation, placement.translation, 1.0
    return out


class Rows(Protocol):
    """The arrays of a run that a picture needs, see `wbc.recording.Log`."""

    @property
    def t(self) -> Array: ...
    @property
    def q(self) -> Array: ...
    @property
    def object_pose(self) -> Array: ...
    @property
    def contact_points(self) -> Array: ...
    @property
    def contact_normals(self) -> Array: ...
    @property
    def in_contact(self) -> BoolArray: ...
    @property
    def in_stack(self) -> BoolArray: ...
    @property
    def activation(self) -> Array: ...
    @property
    def phase(self) -> IntArray: ...
    @property
    def eps_f(self) -> Array: ...
    @property
    def eps_m(self) -> Array: ...


@final
class SnapshotMaker:
    """Turns instants of a run into snapshots, with kinematics data of its own.

    Attributes:
        text: the line under the panel of snapshots made from here on.
    """

    def __init__(
        self, model: RobotModel, task_names: Sequence[str] = (), shown: int = 0, main: bool = False
    ) -> None:
        """
        Args:
            task_names: of the records' arrays; the first `shown` of them are in the scene.
            main: the scene names a main task before them.
        """
        self.text = ""
        self._model = model
        self._data: Any = model.pin_model.createData()
        self._names, self._shown = tuple(task_names), shown
        self._lead = [1.0] if main else []

    def note(self, t: float, event: StackEvent) -> None:
        """Show a decision of the supervisor from here on."""
        self.text = event_text(t, self._names[event.task], event.inserted)

    def of_record(self, record: TickRecord) -> Snapshot:
        """A tick of a run that goes on."""
        pose = np.concatenate((record.object_position, quaternion(record.object_rotation)))
        lead, shown = self._lead, self._shown
        return Snapshot(
            t=record.t,
            bodies=_placements(self._model, self._data, record.q),
            object_pose=pose,
            contact_points=record.contact_points,
            contact_normals=record.contact_normals,
            in_contact=np.asarray(record.mode != 0),
            in_stack=np.array([*lead, *record.within[:shown]], dtype=np.bool_),
            activation=np.array([*lead, *record.activation[:shown]]),
            phase=record.phase,
            eps_f=record.residuals[0],
            eps_m=record.residuals[1],
            text=self.text,
        )

    def of_row(self, rows: Rows, k: int) -> Snapshot:
        """Tick k of a recorded run."""
        return Snapshot(
            t=float(rows.t[k]),
            bodies=_placements(self._model, self._data, rows.q[k]),
            object_pose=rows.object_pose[k],
            contact_points=rows.contact_points[k],
            contact_normals=rows.contact_normals[k],
            in_contact=rows.in_contact[k],
            in_stack=rows.in_stack[k],
            activation=rows.activation[k],
            phase=int(rows.phase[k]),
            eps_f=float(rows.eps_f[k]),
            eps_m=float(rows.eps_m[k]),
            text=self.text,
        )


def event_text(t: float, task: str, inserted: bool) -> str:
    """A decision of the supervisor in words."""
    return f"{t:.2f} s: '{task}' {'back in' if inserted else 'out of'} the stack"
