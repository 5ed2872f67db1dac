"""How faults are worded: one line each, whatever the file holds."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, final

from wbc.errors import did_you_mean

KeyPath: TypeAlias = tuple[str | int, ...]
"""Keys and list indices from the root of a scenario to one of its values."""

_LONGEST = 60
_SUGGESTIONS = 100
_PLAIN = re.compile(r"[\w<>./*+-]+")


@final
@dataclass(frozen=True)
class Fault:
    """What is wrong at one place of a scenario.

    Attributes:
        path: the key or value at fault.
        text: what is wrong and, where there is one, the remedy.
        on: whether the key itself or its value is to be pointed at.
        named: whether the line must say which value is meant before `text`.
        mark: line and column from 1, where the path alone would not find it.
    """

    path: KeyPath
    text: str
    on: Literal["key", "value"] = "value"
    named: bool = True
    mark: tuple[int, int] | None = None


def clip(text: object, most: int = _LONGEST) -> str:
    """`text` on one line, printable and not long."""
    flat = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(text))
    return flat if len(flat) <= most else flat[: most - 3] + "..."


def show(value: Any) -> str:
    """A value of a scenario as its reader wrote it, shortened."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    return f"'{clip(value)}'" if isinstance(value, str) else clip(value)


def dotted(path: KeyPath) -> str:
    """``phases[2].until.time``; also what ``--set`` understands."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = part if _PLAIN.fullmatch(part) else f"'{part}'"
            text += f".{clip(name)}" if text else clip(name)
    return text


def mapping(value: Any) -> dict[str, Any]:
    """`value` if it is a mapping, else an empty one."""
    return value if isinstance(value, dict) else {}


def listing(value: Any) -> list[Any]:
    """`value` if it is a list, else an empty one."""
    return value if isinstance(value, list) else []


@final
@dataclass
class Faults:
    """Collects the faults of one file."""

    found: list[Fault] = field(default_factory=list)

    def add(self, path: KeyPath, text: str, *, on: Literal["key", "value"] = "value") -> None:
        """A fault named by its path."""
        self.found.append(Fault(path, text, on))

    def unknown(
        self,
        path: KeyPath,
        kind: str,
        name: object,
        valid: Any,
        *,
        on: Literal["key", "value"] = "value",
    ) -> None:
        """A name that does not exist, with the nearest one that does."""
        self.found.append(
            Fault(path, f"unknown {kind} {self.remedy(name, valid)}", on, named=False)
        )

    def remedy(self, name: object, valid: Any) -> str:
        """The quoted name and its remedy."""
        # Comparing strings is the one slow step here; a file of nothing but faults must stay quick.
        if len(self.found) > _SUGGESTIONS or not isinstance(name, str):
            return show(name)
        return f"'{clip(name)}'{did_you_mean(clip(name), [clip(v) for v in list(valid)[:200]])}"
