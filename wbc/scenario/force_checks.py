"""What must hold between an object's weight, its contents, and the forces planned for it.

Like `crosscheck`, on the plain data.
"""

from __future__ import annotations

import math
from fnmatch import fnmatchcase
from typing import Any

from wbc.scenario.force_blocks import Contents
from wbc.scenario.relations import si
from wbc.scenario.units import NUMBER
from wbc.scenario.wording import Faults, KeyPath, clip, listing, mapping

_SLACK = 1e-9  # of rounding in numbers that a file gives in other units


def check_forces(data: dict[str, Any], faults: Faults) -> None:
    """Add the faults of `object`'s weight and of the block `forces`."""
    thing = mapping(data.get("object"))
    _weight(thing, faults)
    if isinstance(thing.get("contents"), dict):
        _contents(data, thing["contents"], faults)
    if isinstance(data.get("forces"), dict):
        _forces(data, data["forces"], faults)


def _weight(thing: dict[str, Any], faults: Faults) -> None:
    for key in ("com", "inertia", "contents"):
        if key in thing and thing.get("mass") is None:
            faults.add(("object", key), "needs the object's 'mass'", on="key")
    moments = [si(raw, "inertia") for raw in listing(thing.get("inertia"))]
    known = [x for x in moments if x is not None and x >= 0.0]
    if len(known) == 3 and 2.0 * max(known) > sum(known) * (1.0 + _SLACK):
        text = "no body has these moments: none is above the sum of the other two"
        faults.add(("object", "inertia"), text)


def _contents(data: dict[str, Any], contents: dict[str, Any], faults: Faults) -> None:
    path: KeyPath = ("object", "contents")
    surface = mapping(mapping(data.get("object")).get("surface"))
    kind, sizes = surface.get("type"), {}
    for key in ("radius", "length"):
        if key in contents:
            sizes[key] = si(contents[key], "length")
        elif kind == "cylinder":
            sizes[key] = si(surface.get(key), "length")
        elif isinstance(kind, str):
            text = f"needs '{key}' of the room inside: the surface is no cylinder"
            faults.add(path, text, on="key")
    mass = si(contents.get("mass"), "mass")
    density = si(contents.get("density", Contents.model_fields["density"].default), "density")
    room = [sizes.get("radius"), sizes.get("length"), mass, density]
    if all(x is not None and x > 0.0 for x in room):
        radius, length, m, rho = (float(x or 0.0) for x in room)
        volume, inside = m / rho, math.pi * radius**2 * length
        if volume > inside * (1.0 + _SLACK):
            text = f"is {1e3 * volume:.4g} l, more than the {1e3 * inside:.4g} l inside"
            faults.add((*path, "mass"), text)
    if isinstance(contents.get("pours"), dict):
        _pours(data, contents["pours"], mass, faults)


def _pours(data: dict[str, Any], pours: dict[str, Any], mass: float | None, faults: Faults) -> None:
    path: KeyPath = ("object", "contents", "pours")
    left = si(pours.get("to", 0.0), "mass")
    if left is not None and mass is not None and left > mass:
        faults.add((*path, "to"), f"must be at most the mass that is inside, {mass:g} kg")
    phases = [p for p in listing(data.get("phases")) if isinstance(p, dict)]
    names, name = [p.get("name") for p in phases], pours.get("phase")
    if not isinstance(name, str):
        return
    if name not in names:
        faults.unknown((*path, "phase"), "phase", name, [n for n in names if isinstance(n, str)])
    elif "over" not in phases[names.index(name)]:
        text = f"phase '{clip(name)}' has no 'over', the time in which it would leave"
        faults.add((*path, "phase"), text)


def _forces(data: dict[str, Any], forces: dict[str, Any], faults: Faults) -> None:
    thing = mapping(data.get("object"))
    if "object" not in data:
        faults.add(("forces",), "needs a block 'object'", on="key")
    elif isinstance(data["object"], dict) and thing.get("mass") is None:
        faults.add(("forces",), "needs 'mass' in the block 'object'", on="key")
    if "contacts" not in data:
        faults.add(("forces",), "needs a block 'contacts'", on="key")
    if len(listing(mapping(thing.get("pose")).get("position"))) == 2:
        text = "are planned in space: the object lies in the plane"
        faults.add(("forces",), text, on="key")
    if isinstance(forces.get("estimate"), dict):
        _estimate(data, forces["estimate"], faults)
    contacts = [name for name in mapping(data.get("contacts")) if isinstance(name, str)]
    soft = forces.get("model") == "soft_finger"
    for key, needed in (("friction", True), ("torsion", soft)):
        given = forces.get(key)
        if isinstance(given, dict):
            by_contact(("forces", key), given, contacts, faults, complete=needed)
        elif given is None and needed and key == "torsion":
            faults.add(("forces",), "needs 'torsion' for soft fingers", on="key")
    if not soft and forces.get("torsion"):
        text = "is only of soft fingers: 'model' is not soft_finger"
        faults.add(("forces", "torsion"), text, on="key")


def _estimate(data: dict[str, Any], given: dict[str, Any], faults: Faults) -> None:
    path: KeyPath = ("forces", "estimate")
    bounds = [si(raw, NUMBER) for raw in listing(given.get("mass"))]
    low, high = bounds if len(bounds) == 2 else (None, None)
    if low is not None and high is not None:
        if not low < high:
            faults.add((*path, "mass"), "the lower bound must be below the upper one")
        elif not low <= 1.0 <= high:
            text = "the bounds are multiples of the object's 'mass': 1 must lie between them"
            faults.add((*path, "mass"), text)
    phases = [p for p in listing(data.get("phases")) if isinstance(p, dict)]
    name = given.get("phase")
    if isinstance(name, str):
        names = [p["name"] for p in phases if isinstance(p.get("name"), str)]
        if name not in names:
            faults.unknown((*path, "phase"), "phase", name, names)
    elif name is None and not any("object" in p for p in phases):
        text = "no phase moves the object: say by 'phase' from when on fingers alone bear it"
        faults.add(path, text, on="key")


def by_contact(
    path: KeyPath, given: dict[Any, Any], contacts: list[str], faults: Faults,
    *, complete: bool = False,
) -> None:  # fmt: skip
    """Add faults of a table by contact: names that fit none; `complete`, contacts it leaves out."""
    named = [key for key in given if isinstance(key, str)]
    for key in named:
        if contacts and not any(fnmatchcase(name, key) for name in contacts):
            faults.unknown((*path, key), "contact", key, contacts, on="key")
    left = [n for n in contacts if not any(n == key or fnmatchcase(n, key) for key in named)]
    if complete and left and len(faults.found) == 0:
        faults.add(path, f"says nothing of '{clip(left[0])}': '*' stands for all the others")
