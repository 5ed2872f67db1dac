"""Names with a star in a phase, ``r_*: fixed``, spread over the fingers they fit."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any, Final

from wbc.scenario.located import Located
from wbc.scenario.wording import KeyPath, listing, mapping

_BLOCKS: Final = ("contacts", "reach", "force")


def matching(patterns: Iterable[str], names: Iterable[str]) -> tuple[str, ...]:
    """The names that patterns like ``left_arm_*`` fit, each once, in the patterns' order."""
    known = tuple(names)
    return tuple(dict.fromkeys(n for p in patterns for n in known if fnmatchcase(n, p)))


def spread(located: Located) -> Located:
    """The same scenario with an entry per finger in its phases; a finger named in full wins.

    A pattern that fits no finger stays, to be reported as an unknown one.
    """
    data = mapping(located.data)
    fingers = [name for name in mapping(data.get("contacts")) if isinstance(name, str)]
    renamed: list[tuple[KeyPath, str]] = []
    for i, phase in enumerate(listing(data.get("phases"))):
        for block in _BLOCKS:
            entries = mapping(phase).get(block)
            if isinstance(entries, dict) and any("*" in str(key) for key in entries):
                here: KeyPath = ("phases", i, block)
                phase[block] = _spread_block(entries, fingers, here, renamed)
    if not renamed:
        return located
    keys, values = dict(located.keys), dict(located.values)
    for path, finger in renamed:
        for marks, source in ((keys, located.keys), (values, located.values)):
            for below in [p for p in source if p[: len(path)] == path]:
                place: KeyPath = (*path[:-1], finger, *below[len(path) :])
                marks[place] = source[below]
    return replace(located, keys=keys, values=values)


def _spread_block(
    entries: dict[Any, Any], fingers: list[str], here: KeyPath, renamed: list[tuple[KeyPath, str]]
) -> dict[Any, Any]:
    out: dict[Any, Any] = {}
    for key, value in entries.items():
        found = matching([key], fingers) if isinstance(key, str) and "*" in key else ()
        for finger in found:
            if finger not in entries and finger not in out:
                out[finger] = copy.deepcopy(value)
                renamed.append(((*here, key), finger))
        if not found:
            out[key] = value
    return out
