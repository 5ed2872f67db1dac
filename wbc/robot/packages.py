"""Where robots and their meshes lie: beside a file, in ROS packages, in example-robot-data."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from wbc.errors import WbcError
from wbc.robot.strict_xml import shown

_SCHEME = "package://"
_DATA = "example-robot-data"
_SHOWN = 300  # characters of a path in a message


def locate(name: str, folder: Path) -> Path:
    """The file that `name` means, seen from `folder`.

    Args:
        name: an absolute path, a path relative to `folder`, ``file://...``, or
            ``package://NAME/...``, where NAME is looked for in `folder` and the folders above it,
            on ROS_PACKAGE_PATH and AMENT_PREFIX_PATH, and in an installed example-robot-data.

    Raises:
        WbcError: there is no such file; the text, one line, says where it was looked for.
    """
    if not name.startswith(_SCHEME):
        path = folder / at_home(name.removeprefix("file://"))
        if is_file(path):
            return path
        raise WbcError(f"no file {shown(str(path), _SHOWN)}")
    package, _, inside = name.removeprefix(_SCHEME).lstrip("/").partition("/")
    for shelf in _shelves(folder):
        for root in (shelf / package, shelf):
            if root.name == package and is_file(root / inside):
                return root / inside
    what = f"no file '{shown(inside, _SHOWN)}' in a package '{shown(package)}'"
    raise WbcError(f"{what}: {_looked(package, folder)}")


def at_home(name: str) -> Path:
    """The path `name` with ``~`` as the home folder, as it stands where there is none."""
    try:
        return Path(name).expanduser()
    except RuntimeError:  # of a user that is not known here
        return Path(name)


def is_file(path: Path) -> bool:
    """Whether `path` is a regular file; False for what no file can be called, too."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _shelves(folder: Path) -> Iterator[Path]:
    """Folders that hold packages, or are one."""
    beside = folder.resolve()
    yield beside
    yield from beside.parents
    yield from _listed("ROS_PACKAGE_PATH")
    yield from (prefix / "share" for prefix in _listed("AMENT_PREFIX_PATH"))
    yield from _shares()


def _listed(variable: str) -> list[Path]:
    return [Path(p) for p in os.environ.get(variable, "").split(os.pathsep) if p]


def _shares() -> list[Path]:
    """Data folders of the environment: PyPI's wheels of robots unpack below ``cmeel.prefix``."""
    prefixes = [Path(p) / "cmeel.prefix" for p in sys.path if p]
    return [p / "share" for p in (*prefixes, Path(sys.prefix)) if (p / "share" / _DATA).is_dir()]


def _looked(package: str, folder: Path) -> str:
    """Where a package was looked for, and what would bring it."""
    unset = [v for v in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH") if not os.environ.get(v)]
    places = [f"{folder} and above"]
    places += [v + (" (not set)" if v in unset else "") for v in (
        "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")]  # fmt: skip
    if _shares():
        places.append(f"the installed {_DATA}")
    remedy = ""
    if package == _DATA and not _shares():
        remedy = f"; pip install {_DATA}"
    return f"looked in {', '.join(places)}{remedy}"
