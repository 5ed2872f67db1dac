"""The exceptions raised while loading, one family. Nothing below `scenario` raises in the tick."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class WbcError(Exception):
    """Base of every error raised on bad input; its text is one clear line per fault."""


class UrdfError(WbcError):
    """A robot description that must not reach Pinocchio: `file:line: what, where, remedy`."""


class ScenarioError(WbcError):
    """A scenario file with faults: one line `file:line:column: what (remedy)` per fault."""


class UnknownNameError(WbcError):
    """A name that the model does not have.

    Attributes:
        kind: what was looked for, e.g. ``"frame"``.
        name: the name asked for.
        valid: the names that exist.
    """

    def __init__(self, kind: str, name: str, valid: Iterable[str]) -> None:
        self.kind = kind
        self.name = name
        self.valid = tuple(valid)
        super().__init__(f"unknown {kind} '{name}'{did_you_mean(name, self.valid)}")


class SetupError(WbcError):
    """A scenario that is well formed but cannot be started: who, which limit, how far."""


def did_you_mean(name: str, valid: Iterable[str], *, most: int = 12) -> str:
    """The remedy that follows an unknown name: the nearest valid one, else a list of them."""
    known = [str(v) for v in valid]
    near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.6)
    if near:
        return f" (did you mean '{near[0]}'?)"
    if not known:
        return " (there are none)"
    shown = ", ".join(known[:most]) + (", ..." if len(known) > most else "")
    return f" (known: {shown})"


def follower_refusal(name: str, master: str) -> str:
    """What to say where a joint is named that is not free to be."""
    return f"joint '{name}' follows '{master}' (mimic) and has no value of its own: name '{master}'"
