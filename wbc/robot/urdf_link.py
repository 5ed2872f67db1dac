"""Check of one ``<link>`` of a URDF: inertia, shapes, materials."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import final

import numpy as np

from wbc.arrays import Array
from wbc.robot.strict_xml import Faults, Node, Scope, shown
from wbc.robot.urdf_joint import Frame, check_origin

_PARTS = ("inertial", "visual", "collision", "collision_checking", "self_collision_checking")
_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_DIAGONAL = ("ixx", "iyy", "izz")
_ROUNDING = 1e-12
"""Moments per kg [m^2] that files written by a program leave in place of zero."""
# Sizes by shape: name of the attribute, count of its numbers.
_SIZES: dict[str, tuple[tuple[str, int], ...]] = {
    "box": (("size", 3),),
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
}
_SHAPES = (*_SIZES, "mesh")


@final
@dataclass(frozen=True, eq=False)
class Link:
    """What the checks of the bodies and of the tree need to know of a link."""

    node: Node
    name: str | None
    mass: float = 0.0
    """kg; 0 where the file gives none."""
    frame: Frame = field(default_factory=Frame)
    """The frame of the inertia, at the centre of mass."""
    inertia: Array | None = None
    """3x3 in `frame` [kg m^2]; None where the file gives none."""
    faulty: bool = False
    """Whether the ``<inertial>`` has faults already reported."""

    @property
    def where(self) -> str:
        """How faults name this link."""
        return _where(self.name)

    @property
    def mass_line(self) -> int:
        """The line where the mass is or should be."""
        return _deepest(self.node, "inertial", "mass").line

    @property
    def inertia_line(self) -> int:
        """The line where the inertia is or should be."""
        return _deepest(self.node, "inertial", "inertia").line


def check_link(node: Node, faults: Faults) -> Link:
    """Note the faults of one link by itself."""
    name = Scope(faults, "a link").text(node, "name", "name the link")
    scope = Scope(faults, _where(name))
    scope.known(node, _PARTS)
    for tag in ("visual", "collision"):
        for shape in node.every(tag):
            _check_shape(shape, scope)
    _check_capsules(node, scope)
    inertial = scope.only(node, "inertial")
    return Link(node, name) if inertial is None else _check_inertial(inertial, node, name, scope)


def check_material(node: Node, scope: Scope, *, must_be_named: bool) -> str | None:
    """Check one ``<material>``; its name."""
    name: str | None = None
    if must_be_named or node.attributes.get("name") != "":
        name = scope.text(node, "name", "name the material")
    colour = scope.only(node, "color")
    if colour is not None:
        rgba = scope.vector(colour, "rgba", 4, 'write <color rgba="r g b a"/>')
        if rgba is not None and not all(0 <= part <= 1 for part in rgba):
            scope.fault(colour, "a colour outside 0..1 is not read", "write parts from 0 to 1")
    return name


def _where(name: str | None) -> str:
    return "a link without name" if name is None else f"link '{shown(name)}'"


def _deepest(node: Node, *tags: str) -> Node:
    """The element reached by following the first child of each tag as far as there is one."""
    for tag in tags:
        child = node.first(tag)
        if child is None:
            break
        node = child
    return node


def _check_inertial(node: Node, link: Node, name: str | None, scope: Scope) -> Link:
    before = len(scope.faults)
    scope.known(node, ("origin", "mass", "inertia"))
    frame = check_origin(node, scope)
    mass = 0.0
    mass_node = scope.only(node, "mass")
    if mass_node is None:
        scope.fault(node, "<inertial> has no <mass>", 'write <mass value="..."/> in kg')
    else:
        mass = scope.number(mass_node, "value", "write the mass in kg", largest=1e9) or 0.0
        if mass < 0:
            scope.fault(mass_node, f"mass {mass:g} is negative", "write the mass in kg")
    entries: list[float] = []
    inertia_node = scope.only(node, "inertia")
    if inertia_node is None:
        remedy = "write <inertia ixx=... iyy=... izz=... ixy=... ixz=... iyz=.../>"
        scope.fault(node, "<inertial> has no <inertia>", remedy)
    else:
        remedy = "write all six entries in kg m^2"
        for key in _ENTRIES:
            entries.append(scope.number(inertia_node, key, remedy, largest=1e9) or 0.0)
            if key in _DIAGONAL and entries[-1] < -_ROUNDING * abs(mass):
                what = f"{key} {entries[-1]:g} is negative"
                scope.fault(inertia_node, what, "no body has a negative moment of inertia")
    if len(scope.faults) > before:
        return Link(link, name, faulty=True)
    xx, xy, xz, yy, yz, zz = entries
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Link(link, name, mass, frame, inertia)


def _check_shape(node: Node, scope: Scope) -> None:
    scope.known(node, ("origin", "geometry", "material"))
    check_origin(node, scope)
    material = scope.only(node, "material")
    if material is not None:
        check_material(material, scope, must_be_named=False)
    geometry = scope.only(node, "geometry")
    shape = geometry.children[0] if geometry is not None and geometry.children else None
    if shape is None:
        what = f"<{node.tag}> has no shape"
        scope.fault(node, what, f"give its <geometry> one of {', '.join(_SHAPES)}")
    elif shape.tag == "mesh":
        scope.text(shape, "filename", "name the mesh file")
        scale = scope.vector(shape, "scale", 3)
        if scale is not None and 0.0 in scale:
            scope.fault(shape, "a scale of 0 leaves no mesh", 'write three factors, e.g. "1 1 1"')
    elif shape.tag in _SIZES:
        _check_sizes(shape, scope)
    else:
        what = f"unknown shape <{shown(shape.tag)}>{scope.faults.hint(shape.tag, _SHAPES)}"
        remedy = f"Pinocchio would leave it out: write one of {', '.join(_SHAPES)}"
        if shape.tag == "capsule":
            remedy = "write a <cylinder> and name its <collision> under <collision_checking>"
        scope.fault(shape, what, remedy)


def _check_sizes(shape: Node, scope: Scope) -> None:
    for name, count in _SIZES[shape.tag]:
        values = scope.vector(shape, name, count, f"write the {name} in metres")
        if values is not None and min(values) <= 0:
            what = f'{name}="{shown(shape.attributes[name])}" of <{shape.tag}> is not positive'
            scope.fault(shape, what, f"write the {name} in metres")


def _check_capsules(node: Node, scope: Scope) -> None:
    """Cylinders to be taken as capsules are named after a ``<collision>`` of the same link."""
    cylinders: set[str] = set()
    for collision in node.every("collision"):
        geometry = collision.first("geometry")
        if geometry is not None and geometry.first("cylinder") is not None:
            cylinders.add(collision.attributes.get("name", ""))
    marks = scope.only(node, "collision_checking")
    for mark in () if marks is None else marks.every("capsule"):
        name = scope.text(mark, "name", "name the <collision> to take as a capsule")
        if name is not None and name not in cylinders:
            hint = scope.faults.hint(name, sorted(cylinders))
            what = f"no <collision> with a <cylinder> is called '{shown(name)}'{hint}"
            scope.fault(mark, what, "Pinocchio would not make it a capsule: name the <collision>")
