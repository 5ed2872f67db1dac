"""From a checked URDF to one that Pinocchio reads as meant: meshes found, no endless joints."""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from wbc.errors import UrdfError, WbcError
from wbc.robot.packages import locate
from wbc.robot.urdf_joint import TURNS


def prepared(text: str, path: Path) -> str:
    """The URDF `text` with continuous joints made revolute and mesh files by absolute path.

    A mesh for the eye that is not found is left as it is.

    Args:
        text: checked by `load_urdf_text`.
        path: where it came from, which relative mesh files are seen from.

    Raises:
        UrdfError: a collision mesh that is not found, a continuous joint without a velocity limit.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    robot = etree.fromstring(text.encode("utf-8"), parser)
    faults = [*_turn_endless(robot, path), *_find_meshes(robot, path)]
    if faults:
        raise UrdfError("\n".join(faults))
    return etree.tostring(robot, encoding="unicode")


def _turn_endless(robot: etree._Element, path: Path) -> list[str]:
    faults = []
    for joint in robot.findall("joint"):
        if joint.get("type") != "continuous":
            continue
        limit = joint.find("limit")
        if limit is None:
            faults.append(
                f"{path}:{joint.sourceline}: continuous joint '{joint.get('name')}' has no speed; "
                'write <limit effort="..." velocity="..."/>'
            )
            continue
        joint.set("type", "revolute")
        limit.set("lower", repr(-TURNS))
        limit.set("upper", repr(TURNS))
    return faults


def _find_meshes(robot: etree._Element, path: Path) -> list[str]:
    missing: list[tuple[int, str, str]] = []
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename", "")
        try:
            mesh.set("filename", str(locate(name, path.parent).resolve()))
        except WbcError as error:
            shape = mesh.getparent()
            owner = None if shape is None else shape.getparent()
            if owner is not None and owner.tag == "collision":
                missing.append((mesh.sourceline or 1, name, str(error)))
    if not missing:
        return []
    line, name, reason = missing[0]
    more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
    return [f"{path}:{line}: collision mesh '{name}'{more} is not found: {reason}"]
