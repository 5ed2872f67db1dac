"""Writes the URDFs of the dual-arm robot and of its parts from dual_arm.yaml.

python urdf/generate.py            write them
python urdf/generate.py --check    exit 1, with one line per file that is not as it would be
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path
from typing import Any, cast

import numpy as np
from lxml import etree

from wbc.robot.assembly import Part, Vector, assemble
from wbc.scenario.located import read_text

HERE = Path(__file__).resolve().parent
FIGURES = HERE / "dual_arm.yaml"
MIRROR = np.diag((1.0, -1.0, 1.0))
DECLARATION = '<?xml version="1.0" encoding="utf-8"?>\n'
BONES = ("abd", "prox", "med", "dist")


def main() -> int:
    """Write or compare the files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--check", action="store_true", help="compare only")
    check = parser.parse_args().check
    stale = 0
    for name, text in files(figures(FIGURES)).items():
        path = HERE / name
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            continue
        stale += 1
        if check:
            print(f"urdf/{path.name} is stale: run python urdf/generate.py")
        else:
            path.write_text(text, encoding="utf-8")
            print(f"wrote urdf/{path.name}")
    return 1 if check and stale else 0


def figures(path: Path) -> dict[str, Any]:
    """The content of the parameter file."""
    found = read_text(path.read_bytes())
    if found.faults:
        raise SystemExit("\n".join(f"{path}: {fault.mark} {fault.text}" for fault in found.faults))
    return cast("dict[str, Any]", found.data)


def files(data: dict[str, Any]) -> dict[str, str]:
    """The text of every file by name."""
    robots = {
        "torso": torso(data["torso"]),
        "lwr_arm": arm(data["arm"]),
        "dexmart_hand_right": hand(data["hand"], np.eye(3)),
        "dexmart_hand_left": hand(data["hand"], MIRROR),
    }
    out = {f"{k}.urdf": _text(robot, k, data["colours"]) for k, robot in robots.items()}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in out.items():
            Path(folder, name).write_text(text, encoding="utf-8")
        whole = assemble("dual_arm", [_part(row, Path(folder)) for row in data["assembly"]])
    out["dual_arm.urdf"] = _headed(whole)
    out["dual_arm.srdf"] = _headed(_not_watched(data["not_watched"]))
    return out


def _not_watched(groups: list[dict[str, Any]]) -> str:
    """The SRDF of the whole robot: pairs of links that are not watched, and why."""
    robot = etree.Element("robot", name="dual_arm")
    for group in groups:
        robot.append(etree.Comment(f" {group['why']} "))
        pairs = [tuple(pair) for pair in group.get("pairs", ())]
        for side in ("right_", "left_"):
            pairs += [tuple(_sided(link, side) for link in p) for p in group.get("sides", ())]
        for one, two in pairs:
            etree.SubElement(robot, "disable_collisions", link1=one, link2=two)
    etree.indent(robot, space="  ")
    return etree.tostring(robot, encoding="unicode") + "\n"


def _sided(link_name: str, side: str) -> str:
    """The torso has no sides."""
    return link_name if link_name.startswith(("torso", "chest")) else side + link_name


def _part(row: dict[str, Any], folder: Path) -> Part:
    rpy = cast("Vector", tuple(math.radians(a) for a in row.get("rpy", (0, 0, 0))))
    xyz = cast("Vector", tuple(row.get("xyz", (0.0, 0.0, 0.0))))
    file = folder / f"{row['part']}.urdf"
    return Part(file, row.get("prefix", ""), row.get("parent", ""), xyz, rpy)


def torso(data: dict[str, Any]) -> etree._Element:
    """Three active joints and the passive chest."""
    robot = etree.Element("robot")
    for name, figures in data["links"].items():
        link(robot, name, figures)
    rows = data["joints"]
    for name, row in rows.items():
        row = dict(row)
        if "mimic" in row:
            leader, factor = row["mimic"]
            row.update(_following(rows[leader], factor))
        joint(robot, name, row["parent"], row["child"], row)
    return robot


def arm(data: dict[str, Any]) -> etree._Element:
    """Seven joints in a row, everything along z."""
    robot = etree.Element("robot")
    for name, figures in data["links"].items():
        link(robot, name, figures)
    parent = "arm_base"
    for name, row in data["joints"].items():
        joint(robot, name, parent, f"{name}_link", {**row, "xyz": [0, 0, row["z"]]})
        parent = f"{name}_link"
    return robot


def hand(data: dict[str, Any], side: Any) -> etree._Element:
    """A palm and five fingers; `side` is the identity (right) or the mirror in y (left)."""
    robot = etree.Element("robot")
    link(robot, "palm", data["palm"], side)
    for name, finger in data["fingers"].items():
        kind = data["kinds"]["thumb" if name == "thumb" else "finger"]
        _finger(robot, name, finger, kind, data, side)
    return robot


def _finger(
    robot: etree._Element, name: str, finger: dict[str, Any], kind: dict[str, Any],
    data: dict[str, Any], side: Any,
) -> None:  # fmt: skip
    """Abduction about z, then three parallel flexions, the last one coupled."""
    mirrored = np.linalg.det(side) < 0
    roll, pitch, yaw = finger["rpy"]
    placing: dict[str, Any] = {
        "xyz": side @ finger["base"],
        "rpy": [-roll, pitch, -yaw] if mirrored else [roll, pitch, yaw],
    }
    # An axis of rotation is mirrored with the opposite sign.
    abduction = -side @ kind["abduction_axis"] if mirrored else kind["abduction_axis"]
    parent = "palm"
    for bone, length in zip(BONES, finger["lengths"], strict=True):
        child = f"{name}_{bone}_link"
        link(robot, child, phalanx(bone, length, kind["radius"], data))
        row = {**placing, "axis": abduction if bone == "abd" else [0, 1, 0]}
        row.update(velocity=data["velocity"], effort=kind["effort"])
        if bone == "dist":
            leader = {**row, "range": kind["med"]}
            row.update(_following(leader, data["coupling"]))
            row["mimic"] = [f"{name}_med", data["coupling"]]
        else:
            row["range"] = kind[bone]
        joint(robot, f"{name}_{bone}", parent, child, row)
        parent, placing = child, {"xyz": [length, 0, 0]}
    link(robot, f"{name}_tip", {})
    fixed(robot, f"{name}_tip_fixed", parent, f"{name}_tip", placing["xyz"])


def phalanx(bone: str, length: float, radius: float, data: dict[str, Any]) -> dict[str, Any]:
    """The figures of one finger link along x. The last one ends at the tip frame."""
    end = length - radius if bone == "dist" else length
    start, stop, tip = [0, 0, 0], [end, 0, 0], [length, 0, 0]
    visuals: list[dict[str, Any]] = [{"joint": {"sphere": [1.25 * radius, start]}}]
    if bone == "dist":
        middle = [0.45 * end, 0, 0]
        visuals += [
            {"shell": {"cylinder": [radius, start, middle]}},
            {"pad": {"capsule": [radius, middle, stop]}},
        ]
    else:
        visuals += [{"shell": {"cylinder": [1.05 * radius, start, stop]}}]
    return {
        "mass": data["masses"][bone],
        "solid": {"cylinder": [data["solid_radius"], start, tip]},
        "capsules": [[radius, start, stop]],
        "visuals": visuals,
    }


def _following(leader: dict[str, Any], factor: float) -> dict[str, Any]:
    """The limits of a joint that follows `leader` by `factor`."""
    ends = sorted(factor * end for end in leader["range"])
    return {
        "range": ends,
        "velocity": abs(factor) * leader["velocity"],
        "effort": leader["effort"],
    }


def link(robot: etree._Element, name: str, figures: dict[str, Any], side: Any = None) -> None:
    """Add a link: inertia, visuals, capsules; mirrored where `side` is a mirror."""
    side = np.eye(3) if side is None else side
    element = etree.SubElement(robot, "link", name=name)
    if "mass" in figures:
        _inertial(element, figures, side)
    shapes = [s for row in figures.get("visuals", ()) for s in _visible(row)]
    for number, (colour, shape) in enumerate(shapes):
        visual = etree.SubElement(element, "visual", name=f"{name}_visual_{number}")
        _geometry(visual, shape, side)
        etree.SubElement(visual, "material", name=colour)
    capsules = figures.get("capsules", ())
    for number, capsule in enumerate(capsules):
        collision = etree.SubElement(element, "collision", name=f"{name}_capsule_{number}")
        _geometry(collision, ("cylinder", capsule), side)
    if capsules:
        checking = etree.SubElement(element, "collision_checking")
        for number in range(len(capsules)):
            etree.SubElement(checking, "capsule", name=f"{name}_capsule_{number}")


def _visible(row: dict[str, Any]) -> list[tuple[str, tuple[str, Any]]]:
    """(colour, shape) of a row; a URDF has no capsules to look at, so one becomes three shapes."""
    ((colour, shape),) = row.items()
    ((kind, size),) = shape.items()
    if kind != "capsule":
        return [(colour, (kind, size))]
    radius, start, stop = size
    parts = (("cylinder", size), ("sphere", [radius, start]), ("sphere", [radius, stop]))
    return [(colour, part) for part in parts]


def _geometry(parent: etree._Element, shape: tuple[str, Any], side: Any) -> None:
    kind, size = shape
    if kind == "cylinder":
        radius, start, stop = size
        a, b = side @ start, side @ stop
        _origin(parent, 0.5 * (a + b), _rpy_of_axis(b - a))
        values = {"radius": _number(radius), "length": _number(np.linalg.norm(b - a))}
    elif kind == "sphere":
        _origin(parent, side @ size[1])
        values = {"radius": _number(size[0])}
    else:
        _origin(parent, side @ size[1])
        values = {"size": _numbers(size[0])}
    etree.SubElement(etree.SubElement(parent, "geometry"), kind, values)


def _inertial(parent: etree._Element, figures: dict[str, Any], side: Any) -> None:
    mass = figures["mass"]
    if "solid" in figures:
        com, inertia = _solid(mass, *next(iter(figures["solid"].items())))
    else:
        com = np.array(figures["com"], dtype=float)
        xx, yy, zz, yz = figures["inertia"]
        inertia = np.array([[xx, 0, 0], [0, yy, yz], [0, yz, zz]])
    com, inertia = side @ com, side @ inertia @ side.T
    inertial = etree.SubElement(parent, "inertial")
    _origin(inertial, com)
    etree.SubElement(inertial, "mass", value=_number(mass))
    entries = {
        "ixx": (0, 0),
        "ixy": (0, 1),
        "ixz": (0, 2),
        "iyy": (1, 1),
        "iyz": (1, 2),
        "izz": (2, 2),
    }
    etree.SubElement(
        inertial, "inertia", {key: _number(inertia[at]) for key, at in entries.items()}
    )


def _solid(mass: float, kind: str, size: Any) -> tuple[Any, Any]:
    """Centre of mass and inertia about it of a homogeneous cylinder or box."""
    if kind == "box":
        x, y, z = np.square(size[0]) * mass / 12
        return np.array(size[1], dtype=float), np.diag((y + z, z + x, x + y))
    radius, start, stop = size[0], np.array(size[1], dtype=float), np.array(size[2], dtype=float)
    length = np.linalg.norm(stop - start)
    axis = (stop - start) / length
    along, across = mass * radius**2 / 2, mass * (3 * radius**2 + length**2) / 12
    return 0.5 * (start + stop), across * np.eye(3) + (along - across) * np.outer(axis, axis)


def joint(robot: etree._Element, name: str, parent: str, child: str, row: dict[str, Any]) -> None:
    """Add a revolute joint; the row's angles are in degrees."""
    element = etree.SubElement(robot, "joint", name=name, type="revolute")
    etree.SubElement(element, "parent", link=parent)
    etree.SubElement(element, "child", link=child)
    _origin(element, row["xyz"], np.radians(row.get("rpy", (0, 0, 0))))
    etree.SubElement(element, "axis", xyz=_numbers(row["axis"]))
    lower, upper = row["range"]
    etree.SubElement(
        element, "limit", lower=_number(math.radians(lower)), upper=_number(math.radians(upper)),
        effort=_number(row["effort"]), velocity=_number(math.radians(row["velocity"])),
    )  # fmt: skip
    if "mimic" in row:
        leader, factor = row["mimic"]
        etree.SubElement(element, "mimic", joint=leader, multiplier=_number(factor), offset="0")


def fixed(robot: etree._Element, name: str, parent: str, child: str, xyz: Any) -> None:
    """Add a fixed joint with parallel frames."""
    element = etree.SubElement(robot, "joint", name=name, type="fixed")
    etree.SubElement(element, "parent", link=parent)
    etree.SubElement(element, "child", link=child)
    _origin(element, xyz)


def _origin(parent: etree._Element, xyz: Any, rpy: Any = (0, 0, 0)) -> None:
    etree.SubElement(parent, "origin", xyz=_numbers(xyz), rpy=_numbers(rpy))


def _rpy_of_axis(axis: Any) -> tuple[float, float, float]:
    """Roll, pitch, yaw that turn z to `axis`."""
    x, y, z = axis
    return 0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x) if x or y else 0.0


def _number(value: Any) -> str:
    """Twelve digits: the same text on every machine, and 1e-12 of an arm's length."""
    return f"{float(value) + 0.0:.12g}"


def _numbers(values: Any) -> str:
    return " ".join(map(_number, values))


def _text(robot: etree._Element, name: str, colours: dict[str, Any]) -> str:
    robot.set("name", name)
    used = {str(m.get("name")) for m in robot.iterfind("link/visual/material")}
    for place, colour in enumerate(c for c in colours if c in used):
        material = etree.Element("material", name=colour)
        etree.SubElement(material, "color", rgba=_numbers(colours[colour]))
        robot.insert(place, material)
    etree.indent(robot, space="  ")
    return _headed(etree.tostring(robot, encoding="unicode") + "\n")


def _headed(text: str) -> str:
    note = "<!-- Written by urdf/generate.py; dual_arm.yaml says where every figure is from. -->"
    return f"{DECLARATION}{note}\n{text}"


if __name__ == "__main__":
    sys.exit(main())
