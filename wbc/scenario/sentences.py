"""Every fault of a scenario's data as one plain sentence with the path it belongs to."""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Final, TypeAlias, Union, get_args, get_origin

from pydantic import ValidationError

from wbc.errors import did_you_mean
from wbc.scenario.blocks import Block
from wbc.scenario.crosscheck import crosscheck
from wbc.scenario.disturbance_blocks import check_disturbances
from wbc.scenario.dynamic_checks import check_dynamics
from wbc.scenario.force_checks import check_forces
from wbc.scenario.kinds import COSTS, SURFACES, TASKS
from wbc.scenario.relations import check_relations
from wbc.scenario.schema import Scenario
from wbc.scenario.wording import Fault, Faults, KeyPath, clip, dotted, mapping, show

Table: TypeAlias = Mapping[str, type[Block]]
_MAPPING_WANTED: Final = ("model_type", "model_attributes_type", "dict_type", "mapping_type")


def judge(
    data: Any, unread: frozenset[KeyPath] = frozenset()
) -> tuple[Scenario | None, list[Fault]]:
    """The scenario, or all that is wrong with it; paths in `unread` were reported before."""
    faults = Faults()
    if not isinstance(data, dict):
        return None, [Fault((), f"must be a mapping of blocks, got {show(data)}", named=False)]
    scenario: Scenario | None = None
    guessed = _types(data, faults)
    try:
        scenario = Scenario.model_validate(guessed)
    except ValidationError as errors:
        _translate(errors, guessed, faults)
    check_relations(guessed, faults)
    crosscheck(guessed, faults)
    check_forces(guessed, faults)
    check_disturbances(guessed, faults)
    check_dynamics(guessed, faults)
    found = [
        f for f in faults.found if f.on == "key" or not any(f.path[: len(p)] == p for p in unread)
    ]
    return (None if faults.found else scenario), found


def _typed(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str, Table]]:
    """The places whose model is chosen by their `type`."""
    for name, task in mapping(data.get("tasks")).items():
        yield ("tasks", name), "task", TASKS
        if "region" in mapping(task):
            yield ("tasks", name, "region"), "surface", SURFACES
    for name in mapping(data.get("costs")):
        yield ("costs", name), "cost", COSTS
    if "surface" in mapping(data.get("object")):
        yield ("object", "surface"), "surface", SURFACES


def _types(data: dict[str, Any], faults: Faults) -> dict[str, Any]:
    """Judge every `type`; an unknown one is read as the nearest known, so the rest is judged too.

    Returns a copy without the entries that nothing can be said about.
    """
    out: dict[str, Any] = _copy(data)
    for path, what, table in list(_typed(data)):
        block, parent = _at(out, path), _at(out, path[:-1])
        if not isinstance(block, dict):
            continue
        kind = block.get("type")
        if isinstance(kind, str) and kind in table:
            continue
        if "type" not in block:
            known = ", ".join(sorted(table))
            text = f"missing key 'type' in {dotted(path)} (known: {known})"
            faults.found.append(Fault(path, text, "key", named=False))
        elif not isinstance(kind, str):
            faults.add((*path, "type"), f"must be the type of a {what}, got {show(kind)}")
        else:
            faults.unknown((*path, "type"), f"{what} type", kind, sorted(table))
        guess = _nearest(kind, table, faults)
        if guess is not None:
            block["type"] = guess
        else:
            # An empty entry keeps its name known to whoever refers to it.
            parent[path[-1]] = _Unknown()
    return out


class _Unknown(dict[str, Any]):
    """Stands for an entry whose type is unknown; pydantic's complaints about it are dropped."""


def _nearest(kind: Any, table: Table, faults: Faults) -> str | None:
    if not isinstance(kind, str):
        return None
    remedy = faults.remedy(kind, table)
    return next((name for name in table if f"did you mean '{name}'" in remedy), None)


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copy(v) for key, v in value.items()}
    return [_copy(v) for v in value] if isinstance(value, list) else value


def _at(data: Any, path: KeyPath) -> Any:
    for part in path:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _translate(errors: ValidationError, data: dict[str, Any], faults: Faults) -> None:
    found = errors.errors(include_url=False, include_input=False)
    places = [(_path(error["loc"], data), error) for error in found]
    meant: set[KeyPath] = set()
    for path, error in places:
        if error["type"] == "extra_forbidden":
            present, known = mapping(_at(data, path[:-1])), _keys(path[:-1], data)
            remedy = faults.remedy(path[-1], [key for key in known if key not in present])
            if "did you mean" not in remedy:
                remedy = faults.remedy(path[-1], known)
            text = f"unknown key {remedy}"
            faults.found.append(Fault(path, text, "key", named=False))
            meant |= {(*path[:-1], key) for key in known if f"did you mean '{key}'" in remedy}
    for path, error in places:
        if isinstance(_at(data, path), _Unknown) or error["type"] == "extra_forbidden":
            continue
        if error["type"] == "missing":
            if path not in meant:
                faults.found.append(_missing(path))
            continue
        faults.add(path, _sentence(error["type"], error.get("ctx", {}), _at(data, path)))


def _missing(path: KeyPath) -> Fault:
    block = path[:-1]
    inside = f" in {dotted(block)}" if block else ""
    return Fault(block, f"missing key '{path[-1]}'{inside}", "key", named=False)


def _sentence(kind: str, context: Mapping[str, Any], raw: Any) -> str:
    """pydantic's error in words."""
    if kind == "wbc":
        return str(context["text"])
    if kind in _MAPPING_WANTED:
        return f"must be a mapping, got {show(raw)}"
    if kind in ("tuple_type", "list_type"):
        return f"must be a list, got {show(raw)}"
    if kind == "string_type":
        quote = f": write '{show(raw)}'" if isinstance(raw, int | float) else ""
        return f"must be text, got {show(raw)}{quote}"
    if kind == "string_too_short":
        return "must not be empty"
    if kind == "literal_error":
        expected = str(context["expected"]).replace("'", "")
        near = ""
        if isinstance(raw, str):
            choices = expected.replace(" or ", ", ").split(", ")
            suggestion = did_you_mean(clip(raw), choices)
            near = suggestion if "did you mean" in suggestion else ""
        return f"must be {expected}, got {show(raw)}{near}"
    return f"cannot be {show(raw)}"


def _path(loc: tuple[int | str, ...], data: Any) -> KeyPath:
    """pydantic's location without the types it adds where a type chooses the model."""
    path: KeyPath = ()
    entry, added = data, False
    for part in loc:
        if not added and _is_typed(path) and mapping(entry).get("type") == part:
            added = True
            continue
        added = False
        if isinstance(part, str) and not isinstance(entry, dict):
            continue  # no key of the file, but which of several forms it was read as
        path = (*path, part)
        entry = _at(entry, (part,))
    return path


def _is_typed(path: KeyPath) -> bool:
    if len(path) == 2 and path[0] in ("tasks", "costs"):
        return True
    return path == ("object", "surface") or (path[:1] == ("tasks",) and path[2:] == ("region",))


def _keys(path: KeyPath, data: Any) -> list[str]:
    """The keys that the block at `path` may have."""
    model: Any = Scenario
    for end, part in enumerate(path):
        model = _resolve(model, _at(data, path[:end]))
        arguments = get_args(model)
        if arguments:
            model = arguments[0] if get_origin(model) is tuple else arguments[1]
        else:
            model = model.model_fields[str(part)].annotation
    model = _resolve(model, _at(data, path))
    return list(model.model_fields)


def _resolve(annotation: Any, data: Any) -> Any:
    """The model or collection behind Annotated, None and the choice by type."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif get_origin(annotation) in (Union, types.UnionType):
            members = [m for m in get_args(annotation) if m is not type(None)]
            if len(members) > 1:
                kind = str(mapping(data).get("type"))
                members = [t[kind] for t in (TASKS, COSTS, SURFACES) if t.get(kind) in members]
            annotation = members[0]
        else:
            return annotation
