"""From a file, or the name of one, to a checked scenario."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, final

from wbc import resources
from wbc.errors import ScenarioError, UnknownNameError, did_you_mean
from wbc.scenario.located import Located, Mark, nearest, read_text, read_value
from wbc.scenario.patterns import spread
from wbc.scenario.schema import Scenario
from wbc.scenario.sentences import judge
from wbc.scenario.wording import Fault, KeyPath, clip, dotted, show

_ENDINGS: Final = (".yaml", ".yml")
_MOST_FAULTS: Final = 200


@final
@dataclass(frozen=True)
class Source:
    """The text of a scenario and what was set on top of it."""

    shown: str
    located: Located
    overrides: Mapping[KeyPath, str] = field(default_factory=dict)

    def override_of(self, path: KeyPath) -> str | None:
        """The setting that made, or failed to make, what is at `path`."""
        for set_path, name in self.overrides.items():
            if path[: len(set_path)] == set_path:
                return name
            if set_path[: len(path)] == path and not self._written(path):
                return name
        return None

    def _written(self, path: KeyPath) -> bool:
        return path in self.located.values

    def locate(self, path: KeyPath, *, key: bool = False, mark: Mark | None = None) -> str:
        """``file:line:column`` of a value or of its key, else of the closest thing around it."""
        name = self.override_of(path)
        if name is not None and mark is None:
            return f"--set {name}"
        if mark is None and key:
            mark = self.located.keys.get(path)
        mark = mark or nearest(self.located.values, path) or Mark(1, 1)
        return f"{self.shown}:{mark.line}:{mark.column}"

    def error(self, faults: Iterable[Fault]) -> ScenarioError:
        """All faults, one per line, in the order of the file."""
        rows = sorted({self._row(fault) for fault in faults})
        lines = [line for _, line in rows[:_MOST_FAULTS]]
        if len(rows) > _MOST_FAULTS:
            lines.append(f"{self.shown}: and {len(rows) - _MOST_FAULTS} more faults")
        return ScenarioError("\n".join(lines))

    def _row(self, fault: Fault) -> tuple[tuple[int, int], str]:
        mark = Mark(*fault.mark) if fault.mark is not None else None
        place = self.locate(fault.path, key=fault.on == "key", mark=mark)
        text = f"{dotted(fault.path)}: {fault.text}" if fault.named and fault.path else fault.text
        if place.startswith("--set "):
            # Behind the faults of the file, and not naming the path a second time.
            exact = self.overrides.get(fault.path) is not None
            return (2**31, 0), f"{place}: {fault.text if exact else text}"
        line, column = place.rsplit(":", 2)[1:]
        return (int(line), int(column)), f"{place}: {text}"


@final
@dataclass(frozen=True)
class Loaded:
    """A scenario and where it came from.

    Attributes:
        scenario: the checked scenario.
        path: its file.
        text: the file's text.
        hash: SHA-256 of the file's bytes, hexadecimal; overrides do not enter.
        overrides: what was set on top of the file.
    """

    scenario: Scenario
    path: Path
    text: str
    hash: str
    overrides: Mapping[str, Any]
    source: Source = field(repr=False)

    def locate(self, path: KeyPath, *, key: bool = False) -> str:
        """``file:line:column`` of a value or its key, or ``--set name`` where it was set."""
        return self.source.locate(path, key=key)

    def error(self, faults: Iterable[Fault]) -> ScenarioError:
        """The faults that only the robot can show (`check_names`), located."""
        return self.source.error(faults)


def load(path_or_name: str | Path, overrides: Mapping[str, Any] | None = None) -> Loaded:
    """Read and check a scenario.

    Args:
        path_or_name: a file, from any folder, or the name of a scenario that travels with wbc.
        overrides: values by dotted path, e.g. ``{"simulation.step": "1 ms"}``; text is read as
            YAML. Entries of a list are named by index or by their ``name``.

    Raises:
        ScenarioError: with every fault of the file and of the overrides, one per line.
    """
    path = _find(path_or_name)
    shown = _shown(path)
    return load_bytes(read_file(path, shown), path, shown, overrides)


def load_bytes(
    raw: bytes, path: Path, shown: str, overrides: Mapping[str, Any] | None = None
) -> Loaded:
    """Check a scenario that was read before.

    Args:
        raw: the file's bytes.
        path: where they came from, for files that are named beside it.
        shown: how faults call it.
        overrides: as for `load`.

    Raises:
        ScenarioError: with every fault of the file and of the overrides, one per line.
    """
    located = read_text(raw)
    if located.faults and located.data is None:
        raise Source(shown, located).error(located.faults)
    source, faults = _override(Source(shown, located), overrides or {})
    source = replace(source, located=spread(source.located))
    scenario, found = judge(source.located.data, source.located.unread)
    faults = [*source.located.faults, *faults, *found]
    if faults or scenario is None:
        raise source.error(faults)
    digest = hashlib.sha256(raw).hexdigest()
    text = raw.decode("utf-8-sig")
    return Loaded(scenario, path, text, digest, dict(overrides or {}), source)


def read_file(path: Path, shown: str) -> bytes:
    """What is in a file that faults call `shown`. Raises ScenarioError where it cannot be read."""
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "not a file name"
        raise ScenarioError(f"{shown}: cannot be read: {reason}") from None


def _find(path_or_name: str | Path) -> Path:
    name = str(path_or_name)
    if not name:
        raise ScenarioError("no scenario: give a file or a name")
    try:
        path = Path(name).expanduser()
        if path.is_file():
            return path
        if path.is_dir() and (path.name != name or name not in resources.names("tasks")):
            raise ScenarioError(f"{clip(name)}: is a folder, not a scenario")
        bare = path.name == name
        if bare:
            return resources.find("tasks", name)
        beside = [str(p) for p in path.parent.glob("*") if p.suffix in _ENDINGS]
    except UnknownNameError as error:
        raise ScenarioError(_no_such(clip(name), error.valid)) from None
    except (OSError, ValueError, RuntimeError):
        beside = []
    raise ScenarioError(f"{clip(name)}: no such file{did_you_mean(name, beside) if beside else ''}")


def _no_such(name: str, valid: tuple[str, ...]) -> str:
    here = [p.name for p in Path(".").glob("*") if p.suffix in _ENDINGS]
    if Path(name).suffix in _ENDINGS and difflib.get_close_matches(name, here, n=1):
        return f"{name}: no such file{did_you_mean(name, here)}"
    return f"{name}: no such file, and no scenario of that name{did_you_mean(name, valid)}"


def _shown(path: Path) -> str:
    """The path as its user knows it: relative to where they are, if it lies below."""
    try:
        return str(path.resolve().relative_to(Path.cwd().resolve()))
    except (OSError, ValueError):
        return str(path)


def _override(source: Source, overrides: Mapping[str, Any]) -> tuple[Source, list[Fault]]:
    """The source with values replaced; marks below a replaced value are forgotten."""
    if not overrides or not isinstance(source.located.data, dict):
        return source, []
    located = source.located
    keys, values = dict(located.keys), dict(located.values)
    named: dict[KeyPath, str] = {}
    faults: list[Fault] = []
    unread = set(located.unread)
    for name, raw in overrides.items():
        path = resolve(located.data, name)
        named[path] = clip(name)
        value, fault = _value(raw)
        fault = fault or _put(located.data, path, value)
        if fault:
            faults.append(Fault(path, fault))
            unread.add(path)
        for marks in (keys, values):
            for below in [p for p in marks if p[: len(path)] == path]:
                del marks[below]
    changed = Located(located.data, keys, values, located.faults, frozenset(unread))
    return Source(source.shown, changed, named), faults


def _value(raw: Any) -> tuple[Any, str | None]:
    if not isinstance(raw, str):
        return _plain(raw), None
    read = read_value(raw)
    return read.data, read.faults[0].text if read.faults else None


def _plain(raw: Any) -> Any:
    """Lists for tuples and Python numbers for NumPy's, as a file would have them."""
    if isinstance(raw, Mapping):
        return {str(k): _plain(v) for k, v in raw.items()}
    if isinstance(raw, list | tuple):
        return [_plain(v) for v in raw]
    return raw.tolist() if hasattr(raw, "tolist") else raw


def resolve(data: Any, name: str) -> KeyPath:
    """``phases.slide.until.time`` or ``phases[1].until.time`` as a path."""
    path: list[str | int] = []
    for part in name.replace("[", ".").replace("]", "").split("."):
        step: str | int = part
        if isinstance(data, list):
            names = [e.get("name") if isinstance(e, dict) else None for e in data]
            if part in names:
                step = names.index(part)
            elif part.isdecimal() and len(part) < 6:
                step = int(part)
        path.append(step)
        try:
            data = data[step]
        except (KeyError, IndexError, TypeError):
            data = None
    return tuple(path)


def _put(data: Any, path: KeyPath, value: Any) -> str | None:
    """Set `value` at `path`, making blocks that the file leaves out; what is wrong, if anything."""
    if not all(part != "" for part in path):
        return "is no path: write block.key"
    for end, part in enumerate(path):
        last = end + 1 == len(path)
        if isinstance(data, list):
            if not isinstance(part, int) or part >= len(data):
                valid = [str(e["name"]) for e in data if isinstance(e, dict) and "name" in e]
                inside = dotted(path[:end])
                return f"'{clip(part)}' is no entry of {inside}{did_you_mean(str(part), valid)}"
        elif isinstance(data, dict):
            if not last and data.get(str(part)) is None:
                data[part] = {}
        else:
            return f"{dotted(path[:end])} is {show(data)} and has no entries"
        if last:
            data[part] = value
        else:
            data = data[part]
    return None
