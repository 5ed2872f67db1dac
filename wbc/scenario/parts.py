"""The file of `wbc assemble`: which URDFs make a robot, and where each goes.

name: arm_with_hand
parts:
  - urdf: arm.urdf
  - urdf: hand.urdf
    prefix: right_
    parent: flange
    xyz: [0, 0, 10 cm]
    rpy: [0, -90 deg, 0]
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from wbc.errors import UnknownNameError, WbcError
from wbc.robot.assembly import Part, Vector
from wbc.scenario.load import Source, read_file
from wbc.scenario.located import read_text
from wbc.scenario.places import robot_file
from wbc.scenario.units import QuantityError, read
from wbc.scenario.wording import Fault, Faults, KeyPath, show

_TOP: Final = ("name", "parts")
_KEYS: Final = ("urdf", "prefix", "parent", "xyz", "rpy")


def load_parts(path: Path) -> tuple[str, tuple[Part, ...]]:
    """The name of the robot and its parts.

    Raises:
        ScenarioError: with every fault of the file, one line each.
    """
    located = read_text(read_file(path, str(path)))
    source = Source(str(path), located)
    faults = Faults(list(located.faults))
    if located.data is None:
        raise source.error(faults.found)
    data = _block(located.data, (), _TOP, faults)
    name = _text(data, (), "name", faults, needed=True)
    rows = data.get("parts")
    if not isinstance(rows, list) or not rows:
        faults.add(("parts",) if "parts" in data else (), f"must be a list, got {show(rows)}")
        rows = []
    parts = tuple(_part(row, ("parts", k), path.parent, faults) for k, row in enumerate(rows))
    if faults.found:
        raise source.error(faults.found)
    return name, parts


def _part(row: Any, path: KeyPath, folder: Path, faults: Faults) -> Part:
    block = _block(row, path, _KEYS, faults)
    urdf = _text(block, path, "urdf", faults, needed=True)
    return Part(
        urdf=_find(urdf, (*path, "urdf"), folder, faults) if urdf else folder,
        prefix=_text(block, path, "prefix", faults),
        parent=_text(block, path, "parent", faults),
        xyz=_vector(block, path, "xyz", "length", faults),
        rpy=_vector(block, path, "rpy", "angle", faults),
    )


def _block(raw: Any, path: KeyPath, known: tuple[str, ...], faults: Faults) -> dict[str, Any]:
    if not isinstance(raw, dict):
        faults.found.append(Fault(path, f"must be a mapping, got {show(raw)}", named=bool(path)))
        return {}
    for key in raw:
        if key not in known:
            faults.unknown((*path, key), "key", key, known, on="key")
    return raw


def _text(
    block: dict[str, Any], path: KeyPath, key: str, faults: Faults, *, needed: bool = False
) -> str:
    value = block.get(key, None if needed else "")
    if isinstance(value, str) and (value or not needed):
        return value
    if key in block:
        faults.add((*path, key), f"must be text, got {show(value)}")
    elif block:
        faults.add(path, f"missing key '{key}'", on="key")
    return ""


def _vector(
    block: dict[str, Any], path: KeyPath, key: str, dimension: str, faults: Faults
) -> Vector:
    raw = block.get(key, [0, 0, 0])
    if not isinstance(raw, list) or len(raw) != 3:
        faults.add((*path, key), f"must be a list of 3, got {show(raw)}")
        return 0.0, 0.0, 0.0
    values = [0.0, 0.0, 0.0]
    for k, entry in enumerate(raw):
        try:
            values[k] = float(read(entry, dimension))
        except QuantityError as error:
            faults.add((*path, key, k), str(error))
    return values[0], values[1], values[2]


def _find(name: str, path: KeyPath, folder: Path, faults: Faults) -> Path:
    try:
        return robot_file(name, folder)
    except (OSError, ValueError):
        faults.add(path, f"{show(name)} is no file name")
    except UnknownNameError as error:
        near = [p.name for p in folder.glob("*.urdf")]
        remedy = faults.remedy(name, [*near, *error.valid])
        faults.add(path, f"no such file, and no robot of that name: {remedy}")
    except WbcError as error:
        faults.add(path, str(error))
    return folder
