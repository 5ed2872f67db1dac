"""Strict reading of small XML files: one clear line per fault, each with its place in the file.

lxml reports the line on which a start tag *ends*; the tags are therefore also found in the text
itself, so that every fault names the line on which the element starts.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

from lxml import etree

from wbc.errors import UrdfError, did_you_mean

MAX_BYTES = 20_000_000
MAX_ELEMENTS = 50_000
"""Ten times the largest robots known; a larger file is refused before it costs memory."""
MAX_DEPTH = 60
"""tinyxml2, which reads the file after us, has limits of its own."""
MAX_FAULTS = 100
"""Faults shown; the rest are only counted."""

# What C++ reads with `stream >> double` in the classic locale: no hex, no nan, no inf, no comma.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_OPENING = re.compile(r"<!--|<!\[CDATA\[")
_START_TAG = re.compile(r"<[^/!?](?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")
_VALUE = re.compile(r"\"[^\"]*\"|'[^']*'")
_DECLARATION = re.compile(r"\s*<\?xml\s[^>]*\?>")


@final
@dataclass(frozen=True, eq=False)
class Node:
    """One element: its tag as written (with prefix), attributes, line and child elements."""

    tag: str
    attributes: Mapping[str, str]
    line: int
    children: tuple[Node, ...]

    def every(self, tag: str) -> tuple[Node, ...]:
        """The children called `tag`, in file order."""
        return tuple(child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Node | None:
        """The first child called `tag`."""
        return next((child for child in self.children if child.tag == tag), None)


@final
class Faults:
    """The faults of one file, one line of text each, raised together."""

    def __init__(self, path: Path | str) -> None:
        self._path = str(path)
        self._found: list[tuple[int, str]] = []
        self._more = 0

    def __len__(self) -> int:
        return len(self._found) + self._more

    def add(self, line: int, text: str) -> None:
        """Note a fault on `line`, counted from 1."""
        if len(self._found) < MAX_FAULTS:
            self._found.append((line, text))
        else:
            self._more += 1

    def hint(self, name: str, valid: Iterable[str]) -> str:
        """A did-you-mean, left out once so many faults were found that nobody reads it."""
        return "" if self._more else did_you_mean(shown(name), valid)

    def raise_if_any(self) -> None:
        """Raise `UrdfError` with all faults in the order of their lines."""
        if not self._found:
            return
        by_line = sorted(self._found, key=lambda fault: fault[0])
        lines = [f"{self._path}:{line}: {text}" for line, text in by_line]
        if self._more:
            lines.append(f"{self._path}: ... and {self._more} more faults")
        raise UrdfError("\n".join(lines))


@final
@dataclass(frozen=True)
class Scope:
    """A part of the file that faults are named after, e.g. ``joint 'elbow'``."""

    faults: Faults
    where: str

    def fault(self, node: Node, what: str, remedy: str) -> None:
        """Note `what` is wrong in `node` and what to do about it."""
        self.faults.add(node.line, f"{what}, in {self.where}; {remedy}")

    def only(self, node: Node, tag: str) -> Node | None:
        """The one child called `tag`; a second one is a fault because it would be ignored."""
        found = node.every(tag)
        for extra in found[1:]:
            self.fault(extra, f"a second <{tag}>", "only the first would be read: remove one")
        return found[0] if found else None

    def known(self, node: Node, children: Sequence[str] = (), optional: Sequence[str] = ()) -> None:
        """Flag children and attributes that are misspellings of known ones.

        Extensions are welcome in a URDF, so an unknown name is a fault only when it is close to
        a known one: Pinocchio would skip it without a word.
        """
        for child in node.children:
            near = None if child.tag in children else _near(child.tag, children)
            if near is not None:
                what = f"<{shown(child.tag)}> is not read"
                self.fault(child, what, f"did you mean <{near}>?")
        for name in node.attributes:
            near = None if name in optional else _near(name, optional)
            if near is not None and near not in node.attributes:
                what = f"attribute '{shown(name)}' of <{node.tag}> is not read"
                self.fault(node, what, f"did you mean '{near}'?")

    def text(self, node: Node, name: str, remedy: str) -> str | None:
        """A required attribute that is not empty and has no space at its ends."""
        value = node.attributes.get(name)
        if value is None:
            near = _near(name, [key for key in node.attributes])
            found = "" if near is None else f" (found '{near}')"
            self.fault(node, f"<{node.tag}> has no attribute '{name}'{found}", remedy)
        elif not value.strip():
            self.fault(node, f"attribute '{name}' of <{node.tag}> is empty", remedy)
        elif value != value.strip() or not value.isprintable():
            what = f"attribute '{name}' of <{node.tag}> has spaces around it or control characters"
            self.fault(node, what, "remove them")
        else:
            return value
        return None

    def number(
        self, node: Node, name: str, remedy: str = "", *, largest: float = math.inf
    ) -> float | None:
        """A finite number; required where `remedy` says what to write, else None if absent."""
        values = self.vector(node, name, 1, remedy, largest=largest)
        return None if values is None else values[0]

    def vector(
        self, node: Node, name: str, count: int, remedy: str = "", *, largest: float = 1e9
    ) -> tuple[float, ...] | None:
        """`count` finite numbers between spaces, none beyond `largest` in magnitude."""
        if name not in node.attributes:
            if remedy:
                self.text(node, name, remedy)
            return None
        written = node.attributes[name]
        # The readers behind us split vectors at spaces; a lone number must not end in one.
        pieces = [p for p in written.split(" ") if p] if count > 1 else [written.lstrip(" ")]
        label = f'{name}="{shown(written)}" of <{node.tag}>'
        if len(pieces) != count:
            what = f"{label} has {len(pieces)} numbers"
            self.fault(node, what, f"write {count} numbers with spaces between them")
            return None
        for piece in pieces:
            if (trouble := _number_trouble(piece, largest)) is not None:
                self.fault(node, f"{label} {trouble[0]}", trouble[1])
                return None
        return tuple(float(piece) for piece in pieces)


def shown(value: str, most: int = 60) -> str:
    """`value` on one line and not too long, for a message."""
    flat = "".join(c if c.isprintable() else "?" for c in value[: most + 1])
    return flat if len(flat) <= most else flat[:most] + "..."


def read(path: Path, root: str, text: str | None = None) -> tuple[str, Node]:
    """The text of the file and its root element, which must be called `root`.

    Args:
        text: read instead of what is in the file, which then only gives its name.

    Raises:
        UrdfError: not a readable, well-formed UTF-8 file of reasonable size, or another root.
    """
    text = _text(path) if text is None else text
    blanked = _blanked(text)
    _refuse_unsafe(path, blanked)
    parser = safe_parser(elements_only=True)
    try:
        element = etree.fromstring(text.encode("utf-8"), parser)
    except etree.LxmlError as error:
        line = getattr(error, "lineno", None) or 1
        reason = str(getattr(error, "msg", None) or error).rsplit(", line ", 1)[0]
        remedy = "repair the XML (is the file complete?)"
        raise _refusal(path, line, f"not well-formed XML: {shown(reason, 160)}; {remedy}") from None
    starts, broken = _start_tags(blanked)
    if broken:
        what = "a tab or line break inside a quoted value; Pinocchio's reader takes only spaces"
        raise UrdfError("\n".join(f"{path}:{line}: {what}" for line in broken[:MAX_FAULTS]))
    tree = _node(path, element, iter(starts), MAX_DEPTH)
    if tree.tag != root:
        what = f"the root element is <{shown(tree.tag)}>, not <{root}>"
        raise _refusal(path, tree.line, f"{what}; is this the right file?")
    return text, tree


def safe_parser(*, elements_only: bool = False, indented: bool = True) -> etree.XMLParser:
    """A parser for files of strangers: no entities, no network, no DTD, no huge trees.

    Args:
        elements_only: leave out comments and processing instructions.
        indented: keep the white space between elements.
    """
    return etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, encoding="utf-8",
        remove_comments=elements_only, remove_pis=elements_only, remove_blank_text=not indented,
    )  # fmt: skip


def _refusal(path: Path, line: int, text: str) -> UrdfError:
    return UrdfError(f"{path}:{line}: {text}")


def _text(path: Path) -> str:
    """The file as text without byte order mark."""
    try:
        if path.exists() and not path.is_file():
            raise UrdfError(f"{path}: not a file; name the robot description itself")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UrdfError(f"{path}: cannot be read: {reason}") from None
    if len(data) > MAX_BYTES:
        raise UrdfError(f"{path}: larger than {MAX_BYTES // 1_000_000} MB; not a robot description")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise _refusal(path, line, "not UTF-8 text; save the file as UTF-8") from None
    if not text.strip():
        raise _refusal(path, 1, "the file is empty; a robot description was expected")
    return text


def _blanked(text: str) -> str:
    """`text` with comments and CDATA sections replaced by their line breaks."""
    pieces: list[str] = []
    at = 0
    while (opening := _OPENING.search(text, at)) is not None:
        closing = "-->" if opening.group() == "<!--" else "]]>"
        end = text.find(closing, opening.end())
        if end < 0:
            break  # not well-formed; the parser says where
        pieces.append(text[at : opening.start()])
        pieces.append("\n" * text.count("\n", opening.start(), end))
        at = end + len(closing)
    pieces.append(text[at:])
    return "".join(pieces)


def _refuse_unsafe(path: Path, blanked: str) -> None:
    """Refuse what can cost much to parse or is read differently by other parsers."""
    for mark in ("<!DOCTYPE", "<!ENTITY"):
        if (at := blanked.find(mark)) >= 0:
            line = blanked.count("\n", 0, at) + 1
            what = f"{mark}: document types and entities are refused"
            raise _refusal(path, line, f"{what}; remove it")
    declaration = _DECLARATION.match(blanked)
    at = blanked.find("<?", declaration.end() if declaration else 0)
    if at >= 0:
        line = blanked.count("\n", 0, at) + 1
        what = "a processing instruction <?...?>: Pinocchio's reader cannot skip it"
        raise _refusal(path, line, f"{what}; remove it")
    if blanked.count("<") > 2 * MAX_ELEMENTS:
        raise UrdfError(f"{path}: more than {MAX_ELEMENTS} elements; not a robot description")


def _start_tags(blanked: str) -> tuple[list[int], list[int]]:
    """Lines of all start tags of a well-formed text, and of those with a broken value."""
    lines: list[int] = []
    broken: list[int] = []
    line, at = 1, 0
    for tag in _START_TAG.finditer(blanked):
        line += blanked.count("\n", at, tag.start())
        at = tag.start()
        lines.append(line)
        if any(re.search(r"[\t\r\n]", value) for value in _VALUE.findall(tag.group())):
            broken.append(line)
    return lines, broken


def _node(path: Path, element: etree._Element, lines: Iterable[int], depth: int) -> Node:
    """The tree below `element`; start tags and elements come in the same order."""
    line = next(iter(lines))
    if depth == 0:
        raise _refusal(path, line, f"elements nested deeper than {MAX_DEPTH}; not a robot")
    name = etree.QName(element).localname
    tag = f"{element.prefix}:{name}" if element.prefix else name
    attributes = {str(key): str(value) for key, value in element.attrib.items()}
    inner = (child for child in element if isinstance(child.tag, str))
    children = tuple(_node(path, child, lines, depth - 1) for child in inner)
    return Node(tag, attributes, line, children)


def _near(name: str, valid: Sequence[str]) -> str | None:
    """The known name that `name` is a misspelling of."""
    for candidate in valid:
        if sorted(candidate.lower()) == sorted(name[:80].lower()):
            return candidate
    near = difflib.get_close_matches(name[:80], valid, n=1, cutoff=0.75)
    return near[0] if near else None


def _number_trouble(piece: str, largest: float) -> tuple[str, str] | None:
    """What is wrong with a number as written, and the remedy."""
    if _NUMBER.fullmatch(piece) is not None:
        if not math.isfinite(float(piece)):
            return "is too large for a double", "write a finite number"
        if abs(float(piece)) > largest:
            return "is beyond any robot", "check the units (m, kg, rad)"
        return None
    if "${" in piece or "$(" in piece:
        return "is not expanded", "run xacro on the file first"
    if re.fullmatch(r"[+-]?(nan|inf|infinity)", piece.strip(), re.IGNORECASE):
        return "is not finite", "write a finite number"
    if _NUMBER.fullmatch(piece.strip()):
        return "has white space after the number", "remove it"
    if _NUMBER.fullmatch(piece.replace(",", ".", 1)):
        return "has a decimal comma", "write a decimal point"
    return "is not a number", "write a plain decimal number"
