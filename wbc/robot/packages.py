"""Where robots and their meshes lie: beside a file, in ROS packages, in example-robot-data."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from wbc.errors import WbcError

_SCHEME = "package://"
_DATA = "example-robot-data"


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
        path = folder / Path(name.removeprefix("file://")).expanduser()
        if path.is_file():
            return path
        raise WbcError(f"no file {path}")
    package, _, inside = name.removeprefix(_SCHEME).lstrip("/").partition("/")
    for shelf in _shelves(folder):
        for root in (shelf / package, shelf):
            if root.name == package and (root / inside).is_file():
                return root / inside
    raise WbcError(f"no file '{inside}' in a package '{package}': {_looked(package, folder)}")


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
