"""Finding the files that travel with the package: robots in ``urdf/``, scenarios in ``tasks/``.

In a wheel they lie in ``wbc/_data/<kind>``; in a checkout (also an editable install) in
``<repository>/<kind>``.
"""

from __future__ import annotations

from pathlib import Path

from wbc.errors import UnknownNameError, WbcError

_PACKAGE = Path(__file__).resolve().parent
KINDS = ("urdf", "tasks")


def folder(kind: str) -> Path:
    """The folder that holds `kind` (``"urdf"`` or ``"tasks"``)."""
    if kind not in KINDS:
        raise UnknownNameError("kind of resource", kind, KINDS)
    for candidate in (_PACKAGE / "_data" / kind, _PACKAGE.parent / kind):
        if candidate.is_dir():
            return candidate
    raise WbcError(f"the {kind}/ folder of wbc is missing; reinstall the package")


def names(kind: str) -> tuple[str, ...]:
    """Names of the files of `kind`, without their ending, sorted."""
    ending = ".urdf" if kind == "urdf" else ".yaml"
    return tuple(sorted(p.stem for p in folder(kind).glob(f"*{ending}")))


def find(kind: str, name: str) -> Path:
    """The file of `kind` called `name` (with or without ending).

    Raises:
        UnknownNameError: no such file travels with the package; lists the ones that do.
    """
    ending = ".urdf" if kind == "urdf" else ".yaml"
    stem = name[: -len(ending)] if name.endswith(ending) else name
    if stem not in names(kind):
        raise UnknownNameError("robot" if kind == "urdf" else "scenario", name, names(kind))
    return folder(kind) / f"{stem}{ending}"
