"""Where the robot and its SRDF are that a file names: beside it, with wbc, or in a package."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from wbc import resources
from wbc.robot.packages import at_home, is_file, locate

_ROBOTS: Final = ("", ".urdf", ".parts.yaml")
_PAIRS: Final = ("", ".srdf")


def robot_file(name: str, folder: Path) -> Path:
    """The file of the robot `name`, a URDF or parts to put together.

    Args:
        name: a path from `folder`, an absolute one, ``package://NAME/...`` as in
            `wbc.robot.packages`, or the name of a robot that travels with wbc.
        folder: where the file lies that names it.

    Raises:
        WbcError: there is none; one line.
    """
    if "://" in name:
        return locate(name, folder)
    path = at_home(name)
    bare = path.name == name
    places = (folder, resources.folder("urdf")) if bare else (folder,)
    found = _first(places, path, _ROBOTS)
    if found is not None:
        return found
    return resources.find("urdf", name) if bare else locate(name, folder)


def pairs_file(name: str, folder: Path) -> Path:
    """The SRDF `name`: a path from `folder` or a package, or one that travels with wbc.

    Raises:
        WbcError: there is none; one line.
    """
    path = at_home(name)
    bare = "://" not in name and path.name == name
    places = (folder, resources.folder("urdf")) if bare else ()
    return _first(places, path, _PAIRS) or locate(name, folder)


def _first(places: Iterable[Path], path: Path, endings: Iterable[str]) -> Path | None:
    """The first file of that path, or with one of the endings behind it, in one of the places."""
    for place in places:
        for ending in endings:
            candidate = place / path.with_name(path.name + ending) if path.name else place / path
            if is_file(candidate):
                return candidate
    return None
