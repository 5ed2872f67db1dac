"""What the viewer draws, as plain data: a `Scene` once, then a stream of `Snapshot`.

Nothing here knows robots, Pinocchio or meshcat, so that the viewer process starts quickly and a
scene can be written by hand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.errors import UnknownNameError, WbcError

Rgba = tuple[float, float, float, float]
Kind = Literal["cylinder", "sphere", "box", "capsule", "mesh", "line"]

SIZES: dict[str, int] = {"cylinder": 2, "sphere": 1, "box": 3, "capsule": 2, "mesh": 0, "line": 0}
"""Entries of `SceneShape.size` per kind."""


def _identity() -> Array:
    return np.eye(4)


@dataclass(frozen=True, eq=False)
class SceneShape:
    """One solid, fixed to a body or (`body=None`) to the world.

    Attributes:
        name: its node below the body; unique there.
        size: metres; cylinder and capsule: radius and length along z (without the caps),
            sphere: radius, box: full edge lengths, mesh and line: nothing.
        vertices: (n, 3), meshes and lines only; `triangles`: (k, 3) indices, meshes only.
        placement: (4, 4) of the shape in its body.
        finger: the contact whose state its colour shows while that finger touches: a fingertip.
    """

    name: str
    kind: Kind
    body: str | None = None
    size: tuple[float, ...] = ()
    vertices: Array | None = None
    triangles: IntArray | None = None
    rgba: Rgba = (0.6, 0.62, 0.66, 1.0)
    placement: Array = field(default_factory=_identity)
    finger: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in SIZES:
            raise UnknownNameError("kind of shape", self.kind, SIZES)
        if len(self.size) != SIZES[self.kind]:
            raise WbcError(
                f"shape '{self.name}': a {self.kind} has {SIZES[self.kind]} sizes, "
                f"got {len(self.size)}"
            )
        if self.kind in ("mesh", "line") and self.vertices is None:
            raise WbcError(f"shape '{self.name}': a {self.kind} needs vertices")
        if self.kind == "mesh" and self.triangles is None:
            raise WbcError(f"shape '{self.name}': a mesh needs triangles")


@dataclass(frozen=True, eq=False)
class ObjectShape:
    """The manipulated object in its own frame: a mesh and, if it has one, its contour line."""

    vertices: Array
    triangles: IntArray
    rgba: Rgba = (0.95, 0.68, 0.24, 1.0)
    outline: Array | None = None
    """(n, 3) closed polyline, drawn on top of the mesh."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that does not change during a run.

    Attributes:
        extent: radius [m] about `center` that the camera shows.
        planar: looked at from +z with y up, as in a drawing.
        towards: from the center to the eye, of any length, z up in the picture; if not planar.
        floor: height [m] of the grid in space.
        friction_angles: (N,) half angle of the friction cone of each contact, [rad]; empty where
            no forces are planned, and none are shown.
        measured: forces are measured, too.
    """

    title: str
    shapes: tuple[SceneShape, ...]
    object: ObjectShape | None
    body_names: tuple[str, ...]
    contact_names: tuple[str, ...] = ()
    task_names: tuple[str, ...] = ()
    phase_names: tuple[str, ...] = ()
    planar: bool = False
    extent: float = 1.0
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    towards: tuple[float, float, float] = (0.62, -0.62, 0.48)
    floor: float = 0.0
    friction_angles: tuple[float, ...] = ()
    measured: bool = False

    def __post_init__(self) -> None:
        seen = set()
        for shape in self.shapes:
            if shape.body is not None and shape.body not in self.body_names:
                raise UnknownNameError("body", shape.body, self.body_names)
            if shape.finger is not None and shape.finger not in self.contact_names:
                raise UnknownNameError("contact", shape.finger, self.contact_names)
            if (shape.body, shape.name) in seen:
                raise WbcError(f"two shapes named '{shape.name}' on body '{shape.body}'")
            seen.add((shape.body, shape.name))
        if not (math.isfinite(self.extent) and self.extent > 0.0):
            raise WbcError(f"scene '{self.title}': extent must be positive, got {self.extent}")
        if len(self.friction_angles) not in (0, len(self.contact_names)):
            raise WbcError(
                f"scene '{self.title}': {len(self.friction_angles)} friction angles for "
                f"{len(self.contact_names)} contacts"
            )


class ForceArrows(NamedTuple):
    """Forces and moments of an instant as lengths in the picture, [m], world axes.

    Attributes:
        contact: (N, 3) planned force on the object at each contact; NaN where there is none.
        measured: (N, 3) measured force, likewise.
        limited: (N,) a torque limit of the contact's finger is active.
        com: (3,) centre of mass, where the weight begins.
        weight: (6,) force and moment of gravity about the object's origin.
        resultant: (6,) force and moment that the contacts supply, about the object's origin.
        origin: (3,) the object's origin.
    """

    contact: Array
    measured: Array
    limited: BoolArray
    com: Array
    weight: Array
    resultant: Array
    origin: Array


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One instant, in the order of the names of the scene.

    Attributes:
        bodies: world poses, (nb, 7) as x y z qx qy qz qw or (nb, 4, 4).
        object_pose: (7,), same order; ignored in a scene without object.
        contact_points, contact_normals: (N, 3) in the world; NaN hides a contact.
        contact_mode: (N,) 0 free, 1 fixed, 2 sliding.
        phase: index into the phase names, -1 before the first.
        error: position [m] and orientation [rad] error of the object; NaN where nobody holds it.
        distance: smallest of the watched pairs, [m]; not finite where none is watched.
        status: what gave way, in words; "" when nothing did.
        text: one line under the panel, e.g. the last stack event.
        forces: where the scene shows them; None before they are known.
    """

    t: float
    bodies: Array
    object_pose: Array
    contact_points: Array
    contact_normals: Array
    contact_mode: IntArray
    in_stack: BoolArray
    activation: Array
    phase: int = -1
    eps_f: float = math.nan
    eps_m: float = math.nan
    error: tuple[float, float] = (math.nan, math.nan)
    distance: float = math.nan
    status: str = ""
    text: str = ""
    forces: ForceArrows | None = None


def pose_matrices(poses: Array) -> Array:
    """(n, 4, 4) of (n, 7) poses x y z qx qy qz qw; quaternions need not be of unit length.

    A zero or non-finite pose gives NaN, which hides the node: nothing is drawn at a place that
    was not computed.
    """
    poses = np.asarray(poses, dtype=np.float64).reshape(-1, 7)
    quaternion = poses[:, 3:]
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y, z, w = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    out = np.zeros((len(poses), 4, 4))
    out[:, 0, :3] = np.stack((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)), 1)
    out[:, 1, :3] = np.stack((2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)), 1)
    out[:, 2, :3] = np.stack((2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)), 1)
    out[:, :3, 3] = poses[:, :3]
    out[:, 3, 3] = 1.0
    return out


def contact_frames(points: Array, normals: Array) -> Array:
    """(N, 4, 4) frames at the points with z along the normals; NaN where a normal is missing."""
    with np.errstate(invalid="ignore", divide="ignore"):
        z = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    helper = np.where(np.abs(z[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frames = np.zeros((len(points), 4, 4))
    frames[:, :3, 0], frames[:, :3, 1], frames[:, :3, 2] = x, np.cross(z, x), z
    frames[:, :3, 3], frames[:, 3, 3] = points, 1.0
    return frames


def body_matrices(snapshot: Snapshot) -> Array:
    """The world poses of the bodies as (nb, 4, 4), whichever form they came in."""
    bodies = np.asarray(snapshot.bodies, dtype=np.float64)
    return bodies if bodies.ndim == 3 else pose_matrices(bodies)


def quaternions(matrices: Array) -> Array:
    """(n, 4) x y z w of (n, 4, 4) poses; of the two signs the one nearer to the row before."""
    r = matrices[:, :3, :3]
    xx, yy, zz = r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]
    # Every row of 4 q qᵀ is a multiple of q; the one with the largest diagonal is well scaled.
    outer = np.empty((len(r), 4, 4))
    diagonal = (1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz)
    for i, d in enumerate(diagonal):
        outer[:, i, i] = d
    for i, j in ((0, 1), (0, 2), (1, 2)):
        outer[:, i, j] = outer[:, j, i] = r[:, j, i] + r[:, i, j]
    for i, (a, b) in enumerate(((2, 1), (0, 2), (1, 0))):
        outer[:, i, 3] = outer[:, 3, i] = r[:, a, b] - r[:, b, a]
    best = np.argmax(np.stack(diagonal, axis=1), axis=1)
    q: Array = outer[np.arange(len(r)), best]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    agree = np.sum(q[1:] * q[:-1], axis=1)
    q[1:] *= np.cumprod(np.where(agree < 0.0, -1.0, 1.0))[:, None]
    return q
