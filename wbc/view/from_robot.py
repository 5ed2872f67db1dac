"""A robot and its grasp as a scene, and the instants of a run as snapshots of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.grasp import Grasp
from wbc.contact.surfaces import Surface
from wbc.control.force_control import TorqueStatus
from wbc.control.state import Status, TickRecord
from wbc.forces import ForceStatus
from wbc.robot.model import RobotModel
from wbc.robot.prepare import prepared
from wbc.rotations import quaternion
from wbc.stack.supervisor import StackEvent
from wbc.view.creases import creased
from wbc.view.forces import ArrowMaker, Load
from wbc.view.framing import Place, frame, placements
from wbc.view.scene import ForceArrows, Kind, ObjectShape, Rgba, Scene, SceneShape, Snapshot

_GREY: Rgba = (0.6, 0.62, 0.66, 1.0)
_PALE: Rgba = (0.66, 0.76, 0.86, 1.0)  # of an object under arrows and cones, which are warmer
_STATUS = {
    Status.SCALED: "slowed by limits",
    Status.CLIPPED: "joints clipped",
    Status.NEAR_SINGULAR: "near singular",
    Status.BAD_MEASUREMENT: "bad measurement",
    Status.BAD_COMMAND: "bad command",
    Status.PHASE_TIMEOUT: "phase timed out",
    Status.DONE: "done",
    Status.AT_EDGE: "contact at an edge",
    Status.UNSUPPORTED: "waiting for who is to hold",
}
_ROUND = 240  # points of a contour: no corner is seen


def robot_scene(
    model: RobotModel,
    grasp: Grasp,
    *,
    title: str,
    tips: Sequence[str] = (),
    task_names: tuple[str, ...] = (),
    phase_names: tuple[str, ...] = (),
    shown: Iterable[Place] = (),
    friction: Sequence[float] = (),
    measured: bool = False,
) -> Scene:
    """The robot's visual shapes, the grasp's object and the names of what a run changes.

    Args:
        tips: frames of the grasp's fingertips, in its order; their shapes will show its state.
        task_names: of the panel, highest priority first.
        shown: what the camera has to take in; by default the robot's middle position.
        friction: coefficient μ of each contact, where forces are to be shown.
        measured: they are measured, too.
    """
    shapes = with_tips(model, robot_shapes(model), dict(zip(grasp.fingers, tips, strict=False)))
    body = object_shape(grasp.surface, _thickness(shapes)) if grasp.count else None
    if body is not None and len(friction):
        body = replace(body, rgba=_PALE)
    places = list(shown) or [(0.5 * (model.lower + model.upper), np.zeros(3))]
    framing = frame(model, shapes, body, tips, places)
    return Scene(
        title=title,
        shapes=shapes,
        object=body,
        body_names=model.full_names,
        contact_names=grasp.fingers,
        task_names=task_names,
        phase_names=phase_names,
        planar=model.planar,
        extent=framing.extent,
        center=framing.center,
        towards=framing.towards,
        floor=framing.floor,
        friction_angles=tuple(math.atan(mu) for mu in friction),
        measured=measured,
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


def with_tips(
    model: RobotModel, shapes: Sequence[SceneShape], tips: Mapping[str, str]
) -> tuple[SceneShape, ...]:
    """The shapes, those that make up a fingertip marked with its finger.

    A shape is part of a tip if it is on the same body and about as near to the tip frame as it is
    thick: a pad, but not a rod that only ends there.

    Args:
        tips: finger to the frame of its tip.
    """
    out = list(shapes)
    for finger, name in tips.items():
        at = model.pin_model.frames[model.frame(name)]
        body = str(model.pin_model.names[at.parentJoint]) if at.parentJoint else None
        for k, shape in enumerate(out):
            if shape.body != body or shape.kind == "line":
                continue
            away = float(np.linalg.norm(shape.placement[:3, 3] - at.placement.translation))
            if away <= 2.5 * _half_thickness(shape):
                out[k] = replace(shape, finger=finger)
    return tuple(out)


def _half_thickness(shape: SceneShape) -> float:
    """Of the slimmest way through a shape, [m]."""
    if shape.vertices is not None:
        return 0.5 * float(np.ptp(shape.vertices, axis=0).min())
    return 0.5 * min(shape.size) if shape.kind == "box" else shape.size[0]


def object_shape(surface: Surface, half_thickness: float) -> ObjectShape:
    """The object's body, and the contour where it is planar."""
    around = _ROUND if surface.planar else 64
    vertices, triangles = creased(*surface.mesh(around, half_thickness))
    outline = None
    if surface.planar:
        u = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
        outline = surface.charts(np.column_stack((u, np.zeros(_ROUND))))[:, 0]
    return ObjectShape(vertices, triangles, outline=outline)


def _thickness(shapes: Sequence[SceneShape]) -> float:
    """Half the thickness of a contour: that of the slimmest rod, so that fingertips are seen."""
    radii = [s.size[0] for s in shapes if s.kind in ("cylinder", "capsule")]
    return 0.8 * min(radii, default=0.05)


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
    def contact_mode(self) -> IntArray: ...
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
    @property
    def object_error(self) -> Array: ...
    @property
    def min_distance(self) -> Array: ...
    @property
    def status(self) -> IntArray: ...
    @property
    def contact_force_plan(self) -> Array: ...
    @property
    def torque_margin(self) -> Array: ...
    @property
    def wrench_plan(self) -> Array: ...
    @property
    def object_mass(self) -> Array: ...
    @property
    def object_com(self) -> Array: ...
    @property
    def force_status(self) -> IntArray: ...
    @property
    def tau(self) -> Array: ...
    @property
    def contact_force_meas(self) -> Array: ...
    @property
    def torque_status(self) -> IntArray: ...


@final
class SnapshotMaker:
    """Turns instants of a run into snapshots, with kinematics data of its own.

    Attributes:
        text: the line under the panel of snapshots made from here on.
    """

    def __init__(
        self,
        model: RobotModel,
        task_names: Sequence[str] = (),
        shown: int = 0,
        main: bool = False,
        arrows: ArrowMaker | None = None,
    ) -> None:
        """
        Args:
            task_names: of the records' arrays; the first `shown` of them are in the scene.
            main: the scene names a main task before them.
            arrows: where the scene shows forces.
        """
        self.text = ""
        self._arrows = arrows
        self._model = model
        self._data: Any = model.pin_model.createData()
        self._names, self._shown = tuple(task_names), shown
        self._lead = [1.0] if main else []

    def note(self, t: float, event: StackEvent) -> None:
        """Show a decision of the supervisor from here on."""
        self.text = event_text(t, self._names[event.task], event.inserted)

    def at_rest(self, q: Array, position: Array, rotation: Array, fingers: int) -> Snapshot:
        """The robot at q, (nv,), and the object before anything is known of a run."""
        nothing = np.full((fingers, 3), np.nan)
        tasks = len(self._lead) + self._shown
        return Snapshot(
            t=0.0,
            bodies=placements(self._model, self._data, q),
            object_pose=np.concatenate((position, quaternion(rotation))),
            contact_points=nothing,
            contact_normals=nothing,
            contact_mode=np.zeros(fingers, dtype=np.int64),
            in_stack=np.zeros(tasks, dtype=np.bool_),
            activation=np.zeros(tasks),
            text=self.text,
        )

    def of_record(self, record: TickRecord) -> Snapshot:
        """A tick of a run that goes on."""
        pose = np.concatenate((record.object_position, quaternion(record.object_rotation)))
        lead, shown = self._lead, self._shown
        verdict = 0 if record.forces is None else record.forces.status
        torques = 0 if record.dynamics is None else record.dynamics.status
        return Snapshot(
            t=record.t,
            bodies=placements(self._model, self._data, record.q),
            object_pose=pose,
            contact_points=record.contact_points,
            contact_normals=record.contact_normals,
            contact_mode=record.mode,
            in_stack=np.array([*lead, *record.within[:shown]], dtype=np.bool_),
            activation=np.array([*lead, *record.activation[:shown]]),
            phase=record.phase,
            eps_f=record.residuals[0],
            eps_m=record.residuals[1],
            error=_largest(record.object_error),
            distance=record.min_distance,
            status=status_text(int(record.status), verdict, torques),
            text=self.text,
            forces=self._forces_of_record(record, pose),
        )

    def of_row(self, rows: Rows, k: int) -> Snapshot:
        """Tick k of a recorded run."""
        verdict = int(rows.force_status[k]) if len(rows.force_status) else 0
        torques = int(rows.torque_status[k]) if len(rows.torque_status) else 0
        return Snapshot(
            t=float(rows.t[k]),
            bodies=placements(self._model, self._data, rows.q[k]),
            object_pose=rows.object_pose[k],
            contact_points=rows.contact_points[k],
            contact_normals=rows.contact_normals[k],
            contact_mode=rows.contact_mode[k],
            in_stack=rows.in_stack[k],
            activation=rows.activation[k],
            phase=int(rows.phase[k]),
            eps_f=float(rows.eps_f[k]),
            eps_m=float(rows.eps_m[k]),
            error=_largest(rows.object_error[k]),
            distance=float(rows.min_distance[k]),
            status=status_text(int(rows.status[k]), verdict, torques),
            text=self.text,
            forces=self._forces_of_row(rows, k),
        )

    def _forces_of_record(self, record: TickRecord, pose: Array) -> ForceArrows | None:
        plan, found = record.forces, record.dynamics
        if self._arrows is None:
            return None
        load = None if plan is None else Load(plan.mass, plan.com, plan.wrench)
        if found is not None:
            points = record.contact_points
            return self._arrows.driven(found.plan, found.force, found.tau, points, pose, load)
        if plan is None or load is None:
            return None
        return self._arrows.planned(plan.force, plan.torque_margin, load, pose[:3])

    def _forces_of_row(self, rows: Rows, k: int) -> ForceArrows | None:
        if self._arrows is None:
            return None
        load, pose = None, rows.object_pose[k]
        if len(rows.force_status):
            load = Load(float(rows.object_mass[k]), rows.object_com[k], rows.wrench_plan[k])
        if len(rows.tau):
            force, points = rows.contact_force_plan[k], rows.contact_points[k]
            measured, tau = rows.contact_force_meas[k], rows.tau[k]
            return self._arrows.driven(force, measured, tau, points, pose, load)
        if load is None:
            return None
        plan, margin = rows.contact_force_plan[k], rows.torque_margin[k]
        return self._arrows.planned(plan, margin, load, pose[:3])


def event_text(t: float, task: str, inserted: bool) -> str:
    """A decision of the supervisor in words."""
    return f"{t:.2f} s: '{task}' {'back in' if inserted else 'out of'} the stack"


def status_text(status: int, forces: int = 0, torques: int = 0) -> str:
    """The bits of a `Status` in words, and forces that could not be planned; "" when all is well.

    Args:
        forces: index into the members of `ForceStatus`.
        torques: bits of `TorqueStatus`.
    """
    words = [words for bit, words in _STATUS.items() if status & bit]
    verdict = tuple(ForceStatus)[forces]
    if not verdict.usable:
        words.append(f"forces: {verdict.value.replace('_', ' ')}")
    names = [str(bit.name).lower().replace("_", " ") for bit in TorqueStatus if torques & bit]
    if names:
        words.append(f"torques: {', '.join(names)}")
    return ", ".join(words)


def _largest(error: Array) -> tuple[float, float]:
    """Position and orientation error (N, 2) of the finger that is furthest off; NaN without one."""
    known = error[np.isfinite(error).all(axis=1)]
    if not len(known):
        return math.nan, math.nan
    position, orientation = known.max(axis=0)
    return float(position), float(orientation)
