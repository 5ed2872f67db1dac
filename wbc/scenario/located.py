"""YAML that remembers where everything was written.

PyYAML follows YAML 1.1: the last of two equal keys wins, ``on`` is true, ``1e-3`` is text, ``010``
is 8 and ``12:30`` is 750. Here the core schema of YAML 1.2 decides, equal keys are a fault, and
what a hostile file can cost is bounded.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, NoReturn, final

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from wbc.scenario.wording import Fault, KeyPath, clip, dotted

MAX_BYTES: Final = 200_000
MAX_NODES: Final = 5_000
MAX_DEPTH: Final = 24
_MAX_DIGITS: Final = 18
_EXPLAINED: Final = 120

_TAG: Final = "tag:yaml.org,2002:"
_NULL = re.compile(r"~|null|Null|NULL|")
_BOOL = re.compile(r"true|True|TRUE|false|False|FALSE")
_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(
    r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
)
_SCALARS: Final = {"null": _NULL, "bool": _BOOL, "int": _INT, "float": _FLOAT}


class Mark(NamedTuple):
    """A place in the text, counted from 1."""

    line: int
    column: int


@final
@dataclass(frozen=True)
class Located:
    """Plain data and where it came from.

    Attributes:
        data: dict, list, str, int, float, bool or None; None too when nothing could be read.
        keys: where the key of each path is written.
        values: where the value of each path begins.
        faults: what is wrong with the text as YAML.
        unread: paths whose value is missing from `data` for that reason.
    """

    data: Any
    keys: Mapping[KeyPath, Mark]
    values: Mapping[KeyPath, Mark]
    faults: tuple[Fault, ...]
    unread: frozenset[KeyPath] = frozenset()


class _Refused(Exception):
    """Reading stops here."""

    def __init__(self, mark: Mark, text: str) -> None:
        self.mark = mark
        self.text = text


def _mark(mark: Any) -> Mark:
    return Mark(mark.line + 1, mark.column + 1) if mark is not None else Mark(1, 1)


def _core_resolvers() -> dict[str | None, list[tuple[str, re.Pattern[str]]]]:
    rows: dict[str | None, list[tuple[str, re.Pattern[str]]]] = {}
    starts = {"null": "~nN", "bool": "tTfF", "int": "-+0123456789", "float": "-+.0123456789"}
    for tag, pattern in _SCALARS.items():
        whole = re.compile(rf"(?:{pattern.pattern})\Z")
        for start in [*starts[tag], *([""] if tag == "null" else [])]:
            rows.setdefault(start, []).append((_TAG + tag, whole))
    return rows


@final
class _Loader(yaml.SafeLoader):
    """Composes nodes only; `_Builder` makes the data, so no constructor of PyYAML ever runs."""

    yaml_implicit_resolvers = _core_resolvers()

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._nodes = 0
        self._depth = 0

    def compose_node(self, parent: Node | None, index: int) -> Node | None:
        self._nodes += 1
        self._depth += 1
        if self._depth > MAX_DEPTH or self._nodes > MAX_NODES:
            why = "deeply nested" if self._depth > MAX_DEPTH else "large"
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise _Refused(_mark(event.start_mark), _too(why))
        node: Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node


def _too(why: str) -> str:
    limit = f"{MAX_DEPTH} levels" if why == "deeply nested" else f"{MAX_NODES} values"
    return f"too {why}: a scenario has at most {limit}"


@final
class _Builder:
    """Turns nodes into data, expanding aliases."""

    def __init__(self) -> None:
        self.keys: dict[KeyPath, Mark] = {}
        self.values: dict[KeyPath, Mark] = {}
        self.faults: list[Fault] = []
        self.unread: set[KeyPath] = set()
        self._count = 0

    def fault(self, path: KeyPath, node: Node, text: str) -> None:
        self.faults.append(Fault(path, text, named=False, mark=_mark(node.start_mark)))

    def build(self, node: Node, path: KeyPath) -> Any:
        # Counted once more: an alias is one node of the text but may stand for many values.
        self._count += 1
        if self._count > MAX_NODES:
            raise _Refused(_mark(node.start_mark), _too("large") + ", with its aliases written out")
        if len(path) > MAX_DEPTH:
            raise _Refused(_mark(node.start_mark), _too("deeply nested"))
        self.values[path] = _mark(node.start_mark)
        if isinstance(node, MappingNode) and node.tag == _TAG + "map":
            return self._mapping(node, path)
        if isinstance(node, SequenceNode) and node.tag == _TAG + "seq":
            return [self.build(child, (*path, i)) for i, child in enumerate(node.value)]
        if isinstance(node, ScalarNode):
            return self._scalar(node, path)
        return self._tagged(node, path)

    def _mapping(self, node: MappingNode, path: KeyPath) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, ScalarNode) or key_node.tag != _TAG + "str":
                quoted = f": write '{clip(key_node.value)}'" if _is_filled(key_node) else ""
                self.fault(path, key_node, f"a key must be text{quoted}")
                continue
            key = self._scalar(key_node, path)
            here = (*path, key)
            if key in out:
                first = self.keys[here].line
                self.fault(here, key_node, f"duplicate key '{clip(key)}' (first on line {first})")
                continue
            self.keys[here] = _mark(key_node.start_mark)
            out[key] = self.build(value_node, here)
        return out

    def _scalar(self, node: ScalarNode, path: KeyPath) -> Any:
        text: str = node.value
        kind = node.tag.removeprefix(_TAG)
        if kind == "str":
            if any("\ud800" <= c <= "\udfff" for c in text):
                self.fault(path, node, "this text holds half a character (a lone surrogate)")
                return clip(text)
            return text
        if kind not in _SCALARS:
            return self._tagged(node, path)
        if not _SCALARS[kind].fullmatch(text):
            self.fault(path, node, f"'{clip(text)}' is no {kind}")
            self.unread.add(path)
            return None
        return _value_of(kind, text)

    def _tagged(self, node: Node, path: KeyPath) -> None:
        shown = clip(node.tag.replace(_TAG, "!!"))
        self.fault(path, node, f"the tag '{shown}' is not allowed: a scenario is plain data")
        self.unread.add(path)


def _is_filled(node: Node) -> bool:
    return isinstance(node, ScalarNode) and bool(node.value)


def _value_of(kind: str, text: str) -> Any:
    if kind == "null":
        return None
    if kind == "bool":
        return text[0] in "tT"
    if kind == "int":
        base = {"0o": 8, "0x": 16}.get(text[:2], 10)
        # Python refuses to read integers of thousands of digits, and no quantity needs them exact.
        return int(text, base) if len(text) <= _MAX_DIGITS or base != 10 else float(text)
    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))


def read_text(raw: bytes) -> Located:
    """The data of one YAML document. Never raises: what is wrong is in `Located.faults`."""
    if len(raw) > MAX_BYTES:
        size = f"{len(raw)} bytes; a scenario has at most {MAX_BYTES}"
        return _nothing(Mark(1, 1), f"too large: {size}")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        mark = Mark(before.count(b"\n") + 1, error.start - (before.rfind(b"\n") + 1) + 1)
        return _nothing(mark, f"not UTF-8 text (byte 0x{raw[error.start]:02x})")
    return read_value(text, empty="the file is empty")


def read_value(text: str, *, empty: str = "") -> Located:
    """As `read_text`, from text. With `empty`, a text without content is a fault."""
    try:
        node = _compose(text)
        if node is None and empty:
            raise _Refused(Mark(1, 1), empty)
        builder = _Builder()
        data = builder.build(node, ()) if node is not None else None
        faults, unread = tuple(builder.faults), frozenset(builder.unread)
        return Located(data, builder.keys, builder.values, faults, unread)
    except _Refused as refused:
        return _nothing(refused.mark, refused.text)


def _nothing(mark: Mark, text: str) -> Located:
    return Located(None, {}, {}, (Fault((), text, named=False, mark=mark),))


def _compose(text: str) -> Node | None:
    loader: _Loader | None = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        mark = Mark(before.count("\n") + 1, len(before) - before.rfind("\n"))
        raise _Refused(mark, f"the character U+{_code(error):04X} is not allowed") from None
    except yaml.MarkedYAMLError as error:
        _explain(error)
    except (ValueError, OverflowError):
        # The scanner hands an escape such as "\UFFFFFFFF" to chr() as it stands.
        mark = _mark(loader.get_mark()) if loader is not None else Mark(1, 1)
        raise _Refused(mark, "an escape names no character") from None
    finally:
        if loader is not None:
            loader.dispose()
    return node


def _code(error: yaml.reader.ReaderError) -> int:
    return error.character if isinstance(error.character, int) else ord(error.character[0])


_INDENTED = "the indentation does not match the lines above"
_SECOND = "a second document starts here: a scenario is one document"
_TAGGED = "an unknown tag: a scenario is plain data"
_ESCAPED = "an unknown escape: use single quotes for plain text"
# What PyYAML says, in the order of looking, and what is said instead.
_PROBLEMS: Final = (
    (r"found character '\\t'", "a tab stands here: indent with spaces"),
    (r"found character '(.+)' that", r"a value cannot start with '\1': put it in quotes"),
    (r"mapping values are not", "a ':' out of place: wrong indentation, or text that needs quotes"),
    (r"mapping keys are not", "a '?' out of place: text that begins with it needs quotes"),
    (r"could not find expected ':'", "a key without ':'"),
    (r"expected <block end>|invalid indentation", _INDENTED),
    (r"sequence entries are not allowed", "a list item cannot start here: put it on a new line"),
    (r"expected the node content", "a value is missing here"),
    (r"unknown escape character|expected escape sequence", _ESCAPED),
    (r"found undefined alias '([^']*)'", r"the alias '*\1' has no anchor '&\1' before it"),
    (r"found duplicate anchor '([^']*)'", r"the anchor '&\1' is already taken"),
    (r"expected a single document|but found '<document start>'", _SECOND),
    (r"expected '<document start>'", "unexpected text after the end of the data"),
    (
        r"(a|an) (alias|anchor)\b",
        "an '&' or '*' without a name: text that begins with it needs quotes",
    ),
    (r"a block scalar", "after '|' or '>' the text starts on the next line"),
    (r"directive|YAML document", "a line that begins with '%' is not understood: remove it"),
    (r"tag", _TAGGED),
)


def _explain(error: yaml.MarkedYAMLError) -> NoReturn:
    """One plain line for one of PyYAML's errors."""
    context, problem = error.context or "", error.problem or ""
    mark = _mark(error.problem_mark or error.context_mark)
    opened = _mark(error.context_mark)
    if "quoted" in context and problem.startswith("found unexpected"):
        raise _Refused(opened, "the quote opened here is never closed")
    if "flow" in context and problem.startswith("expected ','"):
        bracket = "{" if "mapping" in context else "["
        where = f"{opened.line}:{opened.column}"
        raise _Refused(mark, f"the '{bracket}' opened at {where} is not closed before this")
    said = " ".join(f"{problem} | {context}".split())
    for pattern, remedy in _PROBLEMS:
        found = re.search(pattern, said)
        if found:
            raise _Refused(mark, clip(found.expand(remedy), _EXPLAINED))
    raise _Refused(mark, f"this cannot be read: {clip(problem or context, _EXPLAINED)}")


def nearest(marks: Mapping[KeyPath, Mark], path: KeyPath) -> Mark | None:
    """The mark of `path` or of the closest thing around it."""
    for end in range(len(path), -1, -1):
        if path[:end] in marks:
            return marks[path[:end]]
    return None


__all__ = ["Located", "Mark", "dotted", "nearest", "read_text", "read_value"]
