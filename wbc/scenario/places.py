"""Where the robot is that a file names: beside it, with wbc, or in a package."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from wbc import resources
from wbc.robot.packages import at_home, is_file, locate

_ENDINGS: Final = ("", ".urdf", ".parts.yaml")


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
    for place in (folder, resources.folder("urdf")) if bare else (folder,):
        for ending in _ENDINGS:
            candidate = place / path.with_name(path.name + ending) if path.name else place / path
            if is_file(candidate):
                return candidate
    return resources.find("urdf", name) if bare else locate(name, folder)


def pairs_file(name: str, folder: Path) -> Path:
    """The SRDF `name`: a path from `folder` or a package, or one that travels with wbc.

    Raises:
        WbcError: there is none; one line.
    """
    bare = "://" not in name and at_home(name).name == name
    for place in (folder, resources.folder("urdf")) if bare else ():
        for ending in ("", ".srdf"):
            if is_file(place / (name + ending)):
                return place / (name + ending)
    return locate(name, folder)
