"""Shapes of the robot and the object as MuJoCo's geoms, and the package itself."""

from __future__ import annotations

import importlib
from typing import Any, Final

import coal
import numpy as np
import pinocchio as pin

from wbc.arrays import Array
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.box import Box
from wbc.contact.surfaces.cylinder import Cylinder
from wbc.contact.surfaces.sphere import Sphere
from wbc.contact.surfaces.spheroid import Spheroid
from wbc.errors import WbcError
from wbc.robot.rounding import corners
from wbc.sim.compliant import FreeBody

MISSING: Final = (
    "the engine 'mujoco' needs the package mujoco: pip install -e '.[mujoco]' (of a wheel: "
    "pip install 'wbc[mujoco]')"
)
_MESH = 96
"""Divisions of the full turn of an object that has to be a mesh: 0.05 % of its radius."""


def mujoco() -> Any:
    """The package mujoco, kept from writing warnings into a file MUJOCO_LOG.TXT where it runs.

    Raises:
        WbcError: it is not installed.
    """
    try:
        mj = importlib.import_module("mujoco")
    except ImportError:
        raise WbcError(MISSING) from None
    if mj.get_mju_user_warning() is None:
        mj.set_mju_user_warning(_unheard)  # plants look at the counts of warnings instead
    return mj


def _unheard(_: str) -> None:
    pass


def add_shape(mj: Any, spec: Any, body: Any, shape: Any) -> Any:
    """One of the robot's shapes (pin.GeometryObject) as a geom of `body`; what MuJoCo does not have
    as its convex hull."""
    geom = body.add_geom(name=shape.name)
    placement, solid = shape.placement, shape.geometry
    geom.pos = placement.translation
    x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
    geom.quat = [w, x, y, z]
    kinds = mj.mjtGeom
    if isinstance(solid, coal.Sphere):
        geom.type, geom.size = kinds.mjGEOM_SPHERE, [solid.radius, 0.0, 0.0]
    elif isinstance(solid, coal.Capsule):
        geom.type, geom.size = kinds.mjGEOM_CAPSULE, [solid.radius, solid.halfLength, 0.0]
    elif isinstance(solid, coal.Cylinder):
        geom.type, geom.size = kinds.mjGEOM_CYLINDER, [solid.radius, solid.halfLength, 0.0]
    elif isinstance(solid, coal.Box):
        geom.type, geom.size = kinds.mjGEOM_BOX, np.array(solid.halfSide)
    else:
        _as_mesh(mj, spec, geom, corners(solid))
    return geom


def _as_mesh(mj: Any, spec: Any, geom: Any, points: Array) -> None:
    spec.add_mesh(name=geom.name, uservert=np.asarray(points, dtype=np.float64).ravel())
    geom.type, geom.meshname = mj.mjtGeom.mjGEOM_MESH, geom.name


def add_object(mj: Any, spec: Any, name: str, surface: Surface, body: FreeBody, bit: int) -> None:
    """The object, no contour, as a free body, `bit` being what hands collide with."""
    thing = spec.worldbody.add_body(name=name)
    thing.add_freejoint(name=name)
    geom = thing.add_geom(name=name, contype=bit, conaffinity=0, condim=4)
    geom.rgba = [0.93, 0.6, 0.2, 1.0]
    kinds = mj.mjtGeom
    if isinstance(surface, Box):
        geom.type, geom.size = kinds.mjGEOM_BOX, surface.half
    elif isinstance(surface, Cylinder):
        geom.type, geom.size = kinds.mjGEOM_CYLINDER, [*surface.sizes, 0.0]
    elif isinstance(surface, Sphere):
        geom.type, geom.size = kinds.mjGEOM_SPHERE, [surface.radius, 0.0, 0.0]
    elif isinstance(surface, Spheroid):
        geom.type, geom.size = kinds.mjGEOM_ELLIPSOID, surface.half_axes
    else:
        _as_mesh(mj, spec, geom, surface.mesh(_MESH)[0])
    thing.explicitinertial = True
    thing.mass, thing.ipos = body.mass, body.com
    given = np.any(body.inertia)
    thing.inertia = body.inertia if given else even_inertia(surface, body.mass)


def even_inertia(surface: Surface, mass: float) -> Array:
    """(3,) moments of a body of even density about the axes of the object frame, [kg m²]."""
    if isinstance(surface, Box):
        second = surface.half**2 / 3.0
    elif isinstance(surface, Cylinder):
        radius, half = surface.sizes
        second = np.array([radius**2 / 4.0, radius**2 / 4.0, half**2 / 3.0])
    else:
        second = _second_moments(surface)
    out: Array = mass * (np.sum(second) - second)
    return out


def _second_moments(surface: Surface) -> Array:
    """(3,) means of x², y², z² over the body, by tetrahedra from the origin to its triangles."""
    vertices, triangles = surface.mesh(_MESH)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    # mean of x² over a tetrahedron with one corner at 0: (Σ x_i² + (Σ x_i)²)/20
    mean = (a**2 + b**2 + c**2 + (a + b + c) ** 2) / 20.0
    out: Array = (volume @ mean) / volume.sum()
    return out
