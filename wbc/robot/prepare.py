"""From a checked URDF to one that Pinocchio reads as meant: meshes found, no endless joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lxml import etree

from wbc.errors import UrdfError, WbcError
from wbc.robot.packages import locate
from wbc.robot.strict_xml import safe_parser, shown
from wbc.robot.urdf_joint import TURNS, UNLIMITED

MAX_MESH_BYTES = 200_000_000
"""A larger collision mesh is refused before it costs memory: no distance is computed of one."""


def prepared(text: str, path: Path) -> str:
    """The URDF `text` with continuous joints made revolute and mesh files by absolute path.

    A mesh for the eye that is not found is left as it is.

    Args:
        text: checked by `load_urdf_text`.
        path: where it came from, which relative mesh files are seen from.

    Raises:
        UrdfError: a collision mesh that is not found, or larger than any that is of use.
    """
    robot = etree.fromstring(text.encode("utf-8"), safe_parser())
    _turn_endless(robot)
    _find_meshes(robot, path)
    return etree.tostring(robot, encoding="unicode")


def _turn_endless(robot: etree._Element) -> None:
    for joint in robot.findall("joint"):
        if joint.get("type") != "continuous":
            continue
        joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = etree.SubElement(
                joint, "limit", velocity=f"{UNLIMITED:g}", effort=f"{UNLIMITED:g}"
            )
        limit.set("lower", repr(-TURNS))
        limit.set("upper", repr(TURNS))


def _line(node: Any) -> int:
    """Where an element is written; its stubs know no type for it."""
    return int(node.sourceline or 1)


def _find_meshes(robot: etree._Element, path: Path) -> None:
    missing: list[tuple[int, str, str]] = []
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename", "")
        try:
            file = locate(name, path.parent).resolve()
            mesh.set("filename", str(file))
        except WbcError as error:
            if _collides(mesh):
                missing.append((_line(mesh), name, str(error)))
            continue
        if _collides(mesh) and file.stat().st_size > MAX_MESH_BYTES:
            what = f"collision mesh '{shown(name)}' is larger than {MAX_MESH_BYTES // 10**6} MB"
            raise UrdfError(f"{path}:{_line(mesh)}: {what}; take a coarser one")
    if missing:
        line, name, reason = missing[0]
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        what = f"collision mesh '{shown(name)}'{more}"
        raise UrdfError(f"{path}:{line}: {what} is not found: {reason}")


def _collides(mesh: etree._Element) -> bool:
    shape = mesh.getparent()
    owner = None if shape is None else shape.getparent()
    return owner is not None and owner.tag == "collision"
