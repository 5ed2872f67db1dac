"""What spans the blocks of a scenario: names that must exist elsewhere, planar against spatial.

Works on the plain data of the file rather than on the models, so that one bad number does not hide
the faults of the rest. Whatever has the wrong form is passed over here: the models report it. A
block that is missing is reported once, not wherever one of its names is used.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

from wbc.scenario.kinds import SURFACES, SurfaceSpec
from wbc.scenario.units import QuantityError, read
from wbc.scenario.wording import Faults, KeyPath, clip, listing, mapping

_NAME = re.compile(r"[^\W\d][\w-]*")
_BALANCES: Final = ("equilibrium_force", "equilibrium_moment")
_NEEDS_CONTACTS: Final = ("object_pose", *_BALANCES)


def _texts(value: Any) -> Iterator[tuple[int, str]]:
    return ((i, v) for i, v in enumerate(listing(value)) if isinstance(v, str))


def _kind(entry: Any) -> str:
    kind = mapping(entry).get("type")
    return kind if isinstance(kind, str) else ""


def crosscheck(data: dict[str, Any], faults: Faults) -> None:
    """Add the faults between the blocks of `data`."""
    _names(data, faults)
    _stack(data, faults)
    _tasks(data, faults)
    _object(data, faults)
    _contacts(data, faults)
    seen: set[str] = set()
    for i, phase in enumerate(listing(data.get("phases"))):
        if isinstance(phase, dict):
            _phase(data, phase, i, faults)
            name = phase.get("name")
            if isinstance(name, str):
                if name in seen:
                    faults.add(("phases", i, "name"), f"'{clip(name)}' names two phases")
                seen.add(name)


def _names(data: dict[str, Any], faults: Faults) -> None:
    """Names end up in logs, on the command line and in dotted paths."""
    named: list[tuple[KeyPath, Any]] = [
        ((block, name), name) for block in ("tasks", "costs") for name in mapping(data.get(block))
    ]
    fingers = mapping(mapping(data.get("robot")).get("fingers"))
    named += [(("robot", "fingers", name), name) for name in fingers]
    for path, name in named:
        _name(path, name, "key", faults)
    if "name" in data:
        _name(("name",), data["name"], "value", faults)
    for i, phase in enumerate(listing(data.get("phases"))):
        if "name" in mapping(phase):
            _name(("phases", i, "name"), phase["name"], "value", faults)


def _name(path: KeyPath, name: Any, on: Any, faults: Faults) -> None:
    if isinstance(name, str) and name and not _NAME.fullmatch(name):
        text = f"'{clip(name)}' is no name: use letters, digits, _ and -, a letter first"
        faults.add(path, text, on=on)


def _stack(data: dict[str, Any], faults: Faults) -> None:
    tasks = data.get("tasks")
    if not isinstance(tasks, dict):
        return
    seen: set[str] = set()
    for i, name in _texts(mapping(data.get("stack")).get("priority")):
        path = ("stack", "priority", i)
        if name not in tasks:
            faults.unknown(path, "task", name, tasks)
        elif name in seen:
            faults.add(path, f"'{clip(name)}' is listed twice")
        elif i > 0 and _kind(tasks[name]) == "object_pose":
            faults.add(path, f"'{clip(name)}' is an object_pose, which can only be first")
        elif i == 0 and data.get("contacts") and _kind(tasks[name]) not in ("", "object_pose"):
            what = clip(_kind(tasks[name]))
            faults.add(path, f"with contacts the first task must be an object_pose, not {what}")
        seen.add(name)


def _tasks(data: dict[str, Any], faults: Faults) -> None:
    fingers = mapping(mapping(data.get("robot")).get("fingers"))
    twice = _twins(data, fingers)
    for name, task in mapping(data.get("tasks")).items():
        kind = _kind(task)
        if kind in _NEEDS_CONTACTS and not data.get("contacts"):
            faults.add(("tasks", name), f"{kind} needs a block 'contacts'", on="key")
        if kind in _BALANCES and twice:
            one, other = map(clip, twice)
            text = f"{kind} would count the tip of '{one}' and '{other}' twice"
            faults.add(("tasks", name), text, on="key")
        if kind == "synergy" and mapping(task).get("measure") == "outside" and "weights" in task:
            text = "are not for measure: outside, which only brings the hand into the synergies"
            faults.add(("tasks", name, "weights"), text, on="key")
        if kind == "palm_distance" and "object" not in data:
            faults.add(("tasks", name), f"{kind} needs a block 'object'", on="key")
        if kind == "manipulability":
            if not fingers:
                faults.add(("tasks", name), f"{kind} needs fingers in 'robot'", on="key")
            for i, finger in _texts(mapping(task).get("fingers")):
                if finger not in fingers:
                    faults.unknown(("tasks", name, "fingers", i), "finger", finger, fingers)


def _twins(data: dict[str, Any], fingers: dict[Any, Any]) -> tuple[str, str] | None:
    """Two contacts of the same tip, if there are."""
    first: dict[str, str] = {}
    for finger in mapping(data.get("contacts")):
        tip = fingers.get(finger)
        if isinstance(tip, str) and first.setdefault(tip, finger) != finger:
            return first[tip], finger
    return None


def _surface(data: dict[str, Any]) -> tuple[str, type[SurfaceSpec]] | None:
    kind = _kind(mapping(data.get("object")).get("surface"))
    found = SURFACES.get(kind)
    return (kind, found) if found is not None and issubclass(found, SurfaceSpec) else None


def _object(data: dict[str, Any], faults: Faults) -> None:
    surface = _surface(data)
    if surface is None:
        return
    poses: list[tuple[KeyPath, Any]] = [(("object", "pose"), mapping(data["object"]).get("pose"))]
    for i, phase in enumerate(listing(data.get("phases"))):
        target = mapping(mapping(phase).get("object")).get("target")
        poses.append((("phases", i, "object", "target"), target))
    kind, spec = surface
    for path, pose in poses:
        size = len(listing(mapping(pose).get("position")))
        if len(spec.chart) == 1 and size == 3:
            text = f"{_article(kind)} lies in the plane: give position [x, y] and angle"
            faults.add((*path, "position"), text)
        if len(spec.chart) == 2 and size == 2:
            text = f"{_article(kind)} lies in space: give position [x, y, z] and rpy or quaternion"
            faults.add((*path, "position"), text)


def _article(kind: str) -> str:
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


def _contacts(data: dict[str, Any], faults: Faults) -> None:
    contacts = mapping(data.get("contacts"))
    robot = data.get("robot")
    fingers = mapping(mapping(robot).get("fingers"))
    if contacts and isinstance(robot, dict) and "fingers" not in robot:
        faults.add(("contacts",), "needs 'fingers' in the block 'robot'", on="key")
    if contacts and "object" not in data:
        faults.add(("contacts",), "needs a block 'object'", on="key")
    if contacts and "phases" not in data:
        faults.add(("contacts",), "needs a block 'phases' that says who holds when", on="key")
    surface = _surface(data)
    for finger, contact in contacts.items():
        if fingers and finger not in fingers:
            faults.unknown(("contacts", finger), "finger", finger, fingers, on="key")
        if surface is not None and isinstance(contact, dict):
            _coordinates(("contacts", finger), contact, surface, faults)


def _coordinates(
    path: KeyPath,
    contact: dict[str, Any],
    surface: tuple[str, type[SurfaceSpec]],
    faults: Faults,
) -> None:
    kind, spec = surface
    at, face = listing(contact.get("at")), contact.get("face")
    chart = spec.chart_on(face)
    if at and len(at) != len(chart):
        wanted = " and ".join(_article(d) for d in chart)
        faults.add(
            (*path, "at"), f"a contact on {_article(kind)} takes {wanted}, got {len(at)} values"
        )
    else:
        for i, (raw, dimension) in enumerate(zip(at, chart, strict=False)):
            given = _dimension(raw)
            if given is not None and given not in (dimension, "any"):
                text = (
                    f"must be {_article(dimension)} here on {_article(kind)}, not {_article(given)}"
                )
                faults.add((*path, "at", i), text)
    if kind == "box" and face is None:
        faults.add(path, "a contact on a box needs 'face'", on="key")
    elif isinstance(face, str) and face not in spec.faces:
        faults.unknown((*path, "face"), "face", face, spec.faces)
    elif isinstance(face, int) and face >= len(spec.faces):
        text = f"must be below {len(spec.faces)} on {_article(kind)}, or one of "
        faults.add((*path, "face"), text + ", ".join(spec.faces))


def _dimension(raw: Any) -> str | None:
    try:
        return read(raw, "angle", "length").dimension
    except QuantityError:
        return None


def _phase(data: dict[str, Any], phase: dict[str, Any], i: int, faults: Faults) -> None:
    here: KeyPath = ("phases", i)
    if isinstance(data.get("contacts"), dict):
        _holding(data, phase, here, faults)
    elif "contacts" not in data:
        used = next((key for key in ("contacts", "reach", "force") if phase.get(key)), None)
        if used is not None:
            faults.add((*here, used), "needs a block 'contacts'", on="key")
    if isinstance(data.get("tasks"), dict):
        _asked(data, phase, here, faults)
    until = mapping(phase.get("until"))
    for key in ("tip_error", "touch"):
        if key in until and not phase.get("reach"):
            faults.add((*here, "until", key), "needs a finger in 'reach'", on="key")
    if "object" in phase and "object" not in data:
        faults.add((*here, "object"), "needs a block 'object'", on="key")


def _holding(data: dict[str, Any], phase: dict[str, Any], here: KeyPath, faults: Faults) -> None:
    known = mapping(data["contacts"])
    fingers = mapping(mapping(data.get("robot")).get("fingers"))
    holding, reaching = mapping(phase.get("contacts")), mapping(phase.get("reach"))
    for block, entries in (("contacts", holding), ("reach", reaching)):
        for finger in entries:
            path = (*here, block, finger)
            if finger in known:
                if block == "reach" and finger in holding:
                    faults.add(path, "is in this phase's contacts and cannot reach", on="key")
            elif finger in fingers:
                faults.add(path, "has no entry in the block 'contacts'", on="key")
            else:
                faults.unknown(path, "finger", finger, known or fingers, on="key")
    _one_name_each(data, phase, here, faults)
    for finger in mapping(phase.get("force")):
        path = (*here, "force", finger)
        if finger not in known and finger not in fingers:
            faults.unknown(path, "finger", finger, known or fingers, on="key")
        elif finger not in holding:
            faults.add(path, "does not touch in this phase, so it has no force", on="key")


def _one_name_each(
    data: dict[str, Any], phase: dict[str, Any], here: KeyPath, faults: Faults
) -> None:
    """A tip with several names, one per contact point, has one of them at a time."""
    fingers = mapping(mapping(data.get("robot")).get("fingers"))
    used: dict[str, str] = {}
    for block in ("contacts", "reach"):
        for finger in mapping(phase.get(block)):
            tip = fingers.get(finger)
            if isinstance(tip, str) and used.setdefault(tip, finger) != finger:
                text = f"is the tip of '{clip(used[tip])}', which is in this phase already"
                faults.add((*here, block, finger), text, on="key")


def _asked(data: dict[str, Any], phase: dict[str, Any], here: KeyPath, faults: Faults) -> None:
    tasks = mapping(data.get("tasks"))
    priority = listing(mapping(data.get("stack")).get("priority"))
    # A misspelled entry there is reported there, not again wherever its task is asked for.
    complete = bool(priority) and all(isinstance(p, str) and p in tasks for p in priority)
    seen: set[str] = set()
    for i, task in _texts(phase.get("tasks")):
        path = (*here, "tasks", i)
        if task not in tasks:
            faults.unknown(path, "task", task, tasks)
        elif complete and task not in priority:
            faults.add(path, f"'{clip(task)}' is not in stack.priority")
        elif task in seen:
            faults.add(path, f"'{clip(task)}' is listed twice")
        seen.add(task)
    _led(tasks, phase, here, faults)
    until = mapping(phase.get("until"))
    for task in mapping(until.get("residual")):
        if task not in tasks:
            faults.unknown((*here, "until", "residual", task), "task", task, tasks, on="key")


def _led(tasks: dict[str, Any], phase: dict[str, Any], here: KeyPath, faults: Faults) -> None:
    """Tasks whose weights a phase leads."""
    asked = listing(phase.get("tasks"))
    for task in mapping(phase.get("weights")):
        path = (*here, "weights", task)
        if task not in tasks:
            faults.unknown(path, "task", task, tasks, on="key")
        elif (kind := _kind(tasks[task])) not in ("", "synergy"):
            faults.add(path, f"is of type {clip(kind)}: only a synergy task has weights", on="key")
        elif mapping(tasks[task]).get("measure") == "outside":
            faults.add(path, "measures what is outside the synergies: it has no weights", on="key")
        elif task not in asked:
            faults.add(path, "is not among this phase's tasks: add it there", on="key")
