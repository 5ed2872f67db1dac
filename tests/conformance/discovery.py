"""Finding the classes that must be in a table, and the arrays that an evaluation must not touch."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from dataclasses import fields, is_dataclass

import numpy as np


def concrete(base: type, package) -> set[type]:  # type: ignore[no-untyped-def]
    """All classes below `base` in a package that can be instantiated."""
    found = set()
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        for _, kind in inspect.getmembers(importlib.import_module(module.name), inspect.isclass):
            if issubclass(kind, base) and not inspect.isabstract(kind):
                found.add(kind)
    return found


def snapshot(*things: object) -> list[np.ndarray]:
    """Copies of all arrays that a definition or a workspace holds."""
    out: list[np.ndarray] = []
    for thing in things:
        if isinstance(thing, np.ndarray):
            out.append(thing.copy())
        elif is_dataclass(thing):
            out += snapshot(*(getattr(thing, f.name) for f in fields(thing)))
        elif isinstance(thing, tuple):
            out += snapshot(*thing)
        elif type(thing).__module__.startswith("wbc.") and hasattr(thing, "__dict__"):
            out += snapshot(*vars(thing).values())
    return out
