"""One robot out of several URDFs: an arm on a torso, a hand on an arm.

Works on the text of the files, so that what comes out is a plain URDF for any reader. Every name
of a part gets the part's prefix: the same hand can be attached twice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

from lxml import etree

from wbc.errors import UrdfError, WbcError, did_you_mean
from wbc.robot.packages import locate
from wbc.robot.strict_xml import safe_parser, shown
from wbc.robot.urdf import load_urdf_text

Vector = tuple[float, float, float]

# Elements of a robot's children that hold a name of the robot: path below the child, attribute.
_NAMED = {
    "link": (
        (".", "name"),
        ("visual", "name"),
        ("collision", "name"),
        ("visual/material", "name"),
        ("collision/material", "name"),
        ("collision_checking/capsule", "name"),
        ("self_collision_checking/*", "name"),
    ),
    "joint": ((".", "name"), ("parent", "link"), ("child", "link"), ("mimic", "joint")),
    "material": ((".", "name"),),
    "transmission": ((".", "name"), ("joint", "name"), ("actuator", "name")),
    "gazebo": ((".", "reference"),),
}


@final
@dataclass(frozen=True)
class Part:
    """A URDF and where it goes.

    Attributes:
        urdf: the file.
        prefix: put before every name of the part.
        parent: link of an earlier part, as it is called in the result, that carries this part's
            root link; empty for the first part.
        xyz: position of the part's root link in `parent`, [m].
        rpy: its roll, pitch and yaw about the fixed axes of `parent`, [rad].
    """

    urdf: Path
    prefix: str = ""
    parent: str = ""
    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    def __str__(self) -> str:
        """How faults name the part."""
        return f"{self.urdf} as '{self.prefix}'" if self.prefix else str(self.urdf)


def assemble(name: str, parts: Sequence[Part]) -> str:
    """The text of the URDF `name` made of `parts`, each fixed to a link of an earlier one.

    The fixed joint is called like the part's root link with ``_mount`` behind it. Comments are
    not kept.

    Raises:
        UrdfError: a part that fails the strict check, an unknown parent, a name that two parts
            share, a mesh that is not there, a name or prefix that XML cannot hold; one line per
            fault.
    """
    if misnamed := _misnamed(name, parts):
        raise UrdfError("\n".join(misnamed))
    robot = etree.Element("robot", name=name)
    taken: dict[tuple[str, str], str] = {}
    faults: list[str] = [] if parts else ["no parts: a robot has at least one"]
    for number, part in enumerate(parts):
        parser = safe_parser(elements_only=True, indented=False)
        element = etree.fromstring(load_urdf_text(part.urdf).encode("utf-8"), parser)
        root = _root(element)
        links = [key for kind, key in taken if kind == "link"]
        faults += _misplaced(part, number, links)
        faults += _resolve_meshes(element, part)
        _prefix(element, part.prefix)
        faults += _move(element, robot, part, taken)
        if number > 0 and part.parent in links:
            mount = _mount(part, f"{part.prefix}{root}")
            faults += _claim(mount, part, taken)
            robot.append(mount)
    if faults:
        raise UrdfError("\n".join(dict.fromkeys(faults)))
    etree.indent(robot, space="  ")
    return etree.tostring(robot, encoding="unicode") + "\n"


def _root(robot: etree._Element) -> str:
    """The link without parent; the strict check made sure that there is exactly one."""
    children = {child.get("link") for child in robot.iterfind("joint/child")}
    return next(
        str(n) for n in (e.get("name") for e in robot.iterfind("link")) if n not in children
    )


def _misnamed(name: str, parts: Sequence[Part]) -> list[str]:
    """Which names cannot be written into a URDF."""
    faults = []
    if not name.strip() or not name.isprintable():
        faults.append(f"the robot's name '{shown(name)}' is empty or has control characters in it")
    for prefix, urdf in dict.fromkeys((part.prefix, part.urdf) for part in parts):
        if prefix != "".join(prefix.split()) or not prefix.isprintable():
            what = f"the prefix '{shown(prefix)}' has white space or control characters in it"
            faults.append(f"{urdf}: {what}")
    return faults


def _misplaced(part: Part, number: int, links: Sequence[str]) -> list[str]:
    """What is wrong with where a part goes."""
    faults = []
    if number == 0 and part.parent:
        faults.append(f"{part}: the first part has no parent, but '{part.parent}' is named")
    elif number > 0 and not part.parent:
        faults.append(f"{part}: no parent: name the link of an earlier part that carries it")
    elif number > 0 and part.parent not in links:
        hint = did_you_mean(part.parent, links)
        faults.append(f"{part}: unknown parent link '{part.parent}'{hint}")
    if not all(math.isfinite(x) for x in (*part.xyz, *part.rpy)):
        faults.append(f"{part}: xyz and rpy must be finite numbers")
    return faults


def _resolve_meshes(robot: etree._Element, part: Part) -> list[str]:
    """Make mesh files absolute that are found from the part alone: the result may lie elsewhere."""
    faults = []
    for mesh in robot.iterfind(".//geometry/mesh"):
        name = mesh.get("filename", "")
        package = "://" in name
        try:
            if not (package and _exists(name)):
                mesh.set("filename", str(locate(name, part.urdf.parent).resolve()))
        except WbcError as error:
            if not package:
                faults.append(f"{part}: the mesh '{name}' is not there; {error}")
    return faults


def _exists(name: str) -> bool:
    """Whether a file is found from anywhere."""
    try:
        locate(name, Path("/"))
    except WbcError:
        return False
    return True


def _prefix(robot: etree._Element, prefix: str) -> None:
    """Put `prefix` before every name, and before every mention of one."""
    for child in robot:
        for path, attribute in _NAMED.get(str(child.tag), ()):
            for element in child.iterfind(path):
                if element.get(attribute):
                    element.set(attribute, prefix + element.get(attribute, ""))


def _move(
    source: etree._Element,
    robot: etree._Element,
    part: Part,
    taken: dict[tuple[str, str], str],
) -> list[str]:
    """Move the children of `source` to `robot`; materials that are already there stay out."""
    faults = []
    known = {m.get("name"): etree.tostring(m) for m in robot.iterfind("material")}
    for child in list(source):
        if child.tag == "material" and etree.tostring(child) == known.get(child.get("name")):
            continue
        faults += _claim(child, part, taken)
        robot.append(child)
    return faults


def _claim(element: etree._Element, part: Part, taken: dict[tuple[str, str], str]) -> list[str]:
    """Note the element's name as taken by `part`, or say who has it already."""
    kind, name = str(element.tag), element.get("name")
    if name is None:
        return []
    if (kind, name) in taken:
        other = taken[kind, name]
        return [f"{part}: {kind} '{name}' is already in {other}; give the part a prefix"]
    taken[kind, name] = str(part)
    return []


def _mount(part: Part, root: str) -> etree._Element:
    joint = etree.Element("joint", name=f"{root}_mount", type="fixed")
    etree.SubElement(joint, "parent", link=part.parent)
    etree.SubElement(joint, "child", link=root)
    xyz, rpy = (" ".join(f"{x:.12g}" for x in v) for v in (part.xyz, part.rpy))
    etree.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    return joint
