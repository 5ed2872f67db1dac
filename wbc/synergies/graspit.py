"""Synergies of other hands, from the eigengrasp files of GraspIt!."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from typing import Final, NoReturn

import numpy as np
from lxml import etree
from numpy.typing import ArrayLike

from wbc.arrays import Array
from wbc.errors import WbcError, did_you_mean
from wbc.synergies.reading import name_trouble, parse_number, read_text, shown
from wbc.synergies.synergies import Synergies

_DEFAULT_VALUE: Final = 0.5
"""The eigenvalue of an eigengrasp without one."""
_LARGEST: Final = 1e6
_MOST_ELEMENTS: Final = 10_000
_ROOT: Final = "EigenGrasps"
_PARTS: Final = ("EG", "ORIGIN", "NORM")
_ENTRIES: Final = ("EigenValue", "Limits", "DimVals")


def read_eigengrasps(
    path: str | os.PathLike[str],
    joints: Sequence[str],
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Synergies:
    """The eigengrasps of a hand: the same weights give the same joint values as in GraspIt!.

    A file has n dimensions, k entries ``EG`` with numbers d_j (``DimVals``, 0 where absent), and
    may have an ``ORIGIN`` o and a ``NORM`` ν. The amplitudes a give (its "rigid" way)

        q = o + ν ∘ Σ_e a_e d_e / |d_e|,

    so c̄ = o, and column e of Ê is ν ∘ d_e / |d_e|: of unit length only where there is no ``NORM``.
    Without ``NORM`` ν = 1; without ``ORIGIN`` o is the middle of the ranges, and one outside the
    ranges is put on their ends. Of a posture that no amplitudes give, `Synergies.project` takes
    the nearest in joint space, GraspIt! the nearest in q/ν.

    The eigenvalues are in no unit and GraspIt! computes nothing with them: `Synergies.variances`
    holds them as written (0.5 where absent), shares of a total of 1, or of their sum where that is
    more. ``Limits`` bound what GraspIt! searches and not the map: they are checked and left out.

    Args:
        joints: (n,) names of GraspIt!'s degrees of freedom d0, d1 and so on; angles in rad.
        lower, upper: (n,) the hand's ranges, [rad]; those of the file's robot are not in the file.

    Raises:
        WbcError: one line: file, line, what is wrong and the remedy.
    """
    names = tuple(joints)
    if (trouble := name_trouble(names)) is not None:
        raise WbcError(f"joints of the hand: {trouble}")
    file = _File(shown(os.fspath(path), 200))
    root = file.parsed(read_text(path, "a file of eigengrasps"))
    file.check_dimensions(root, len(names))
    basis, values = [], []
    for entry in root.findall("EG"):
        direction = file.numbers(entry, len(names))
        length = float(np.linalg.norm(direction))
        if not length > 1e-9:
            file.fault(entry, "an eigengrasp of length zero (write its DimVals)")
        basis.append(direction / length)
        values.append(file.eigenvalue(entry))
        file.check_limits(entry)
    if not 1 <= len(basis) <= len(names):
        file.fault(root, f"{len(basis)} entries EG for {len(names)} joints (write one or more)")
    ends = [np.full(len(names), np.inf * sign) if given is None else np.asarray(given, np.float64)
            for sign, given in ((-1.0, lower), (1.0, upper))]  # fmt: skip
    if any(end.shape != (len(names),) for end in ends):
        raise WbcError(f"one limit for each of {len(names)} joints is needed")
    norm = file.norm(root, len(names))
    origin = file.origin(root, ends[0], ends[1])
    try:
        return Synergies(
            names, origin, norm[:, None] * np.array(basis).T, np.array(values),
            max(1.0, float(np.sum(values))), ends[0], ends[1],
        )  # fmt: skip
    except WbcError as error:
        file.fault(root, f"{error}")


class _File:
    """One file, for messages with its name."""

    def __init__(self, name: str) -> None:
        self._name = name

    def fault(self, element: etree._Element, text: str) -> NoReturn:
        """Raise what is wrong at an element."""
        raise WbcError(f"{self._name}:{element.sourceline}: {text}")

    def parsed(self, text: str) -> etree._Element:
        """The root of a well-formed file without document type; only known elements in it."""
        for mark in ("<!DOCTYPE", "<!ENTITY"):
            if (at := text.find(mark)) >= 0:
                line = text.count("\n", 0, at) + 1
                raise WbcError(f"{self._name}:{line}: {mark}: document types are refused (remove)")
        if text.count("<") > 2 * _MOST_ELEMENTS:
            raise WbcError(f"{self._name}: more than {_MOST_ELEMENTS} elements; no eigengrasps")
        parser = etree.XMLParser(
            resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False,
            encoding="utf-8", remove_comments=True, remove_pis=True,
        )  # fmt: skip
        try:
            root = etree.fromstring(text.encode("utf-8"), parser)
        except etree.LxmlError as error:
            line = getattr(error, "lineno", None) or 1
            reason = shown(str(getattr(error, "msg", None) or error).rsplit(", line ", 1)[0], 160)
            raise WbcError(f"{self._name}:{line}: not well-formed XML: {reason}") from None
        if root.tag != _ROOT:
            self.fault(root, f"the root element is <{shown(root.tag)}>, not <{_ROOT}>")
        for part in root:
            self._known(part, _PARTS)
            for entry in part:
                self._known(entry, _ENTRIES)
            for tag in _ENTRIES:
                if len(extra := part.findall(tag)) > 1:
                    self.fault(extra[1], f"a second <{tag}> in <{part.tag}> (remove one)")
        for tag in ("ORIGIN", "NORM"):
            if len(extra := root.findall(tag)) > 1:
                self.fault(extra[1], f"a second <{tag}> (remove one)")
        return root

    def check_dimensions(self, root: etree._Element, n: int) -> None:
        written = root.get("dimensions")
        if written is None or not re.fullmatch(r"\s*[0-9]{1,6}\s*", written, re.ASCII):
            self.fault(root, f'dimensions="{shown(written or "")}" is no number of joints')
        if int(written) != n:
            self.fault(root, f"a hand of {int(written)} joints, but {n} are named "
                             "(name one for each dimension d0, d1, ...)")  # fmt: skip

    def numbers(self, part: etree._Element, n: int) -> Array:
        """(n,) the ``DimVals`` of an entry."""
        entry = part.find("DimVals")
        if entry is None:
            self.fault(part, f"<{part.tag}> has no <DimVals> (add it, with d0 to d{n - 1})")
        known = {f"d{j}": j for j in range(n)}
        values = np.zeros(n)
        for key in entry.attrib:
            if str(key) not in known:
                self.fault(entry, f"'{shown(key)}' is no dimension (they are d0 to d{n - 1})")
            values[known[str(key)]] = self._number(entry, str(key))
        return values

    def eigenvalue(self, part: etree._Element) -> float:
        entry = part.find("EigenValue")
        if entry is None:
            return _DEFAULT_VALUE
        value = self._number(entry, "value")
        if value < 0.0:
            self.fault(entry, f"the eigenvalue {value:g} is negative (it is a variance)")
        return value

    def check_limits(self, part: etree._Element) -> None:
        entry = part.find("Limits")
        if entry is not None and self._number(entry, "min") > self._number(entry, "max"):
            self.fault(entry, "min is above max (exchange them)")

    def norm(self, root: etree._Element, n: int) -> Array:
        part = root.find("NORM")
        if part is None:
            return np.ones(n)
        values = self.numbers(part, n)
        if (zero := np.flatnonzero(values == 0.0)).size:
            self.fault(part, f"d{zero[0]} of NORM is zero or absent: that joint could not be moved")
        return values

    def origin(self, root: etree._Element, lower: Array, upper: Array) -> Array:
        part = root.find("ORIGIN")
        if part is not None:
            values: Array = np.clip(self.numbers(part, len(lower)), lower, upper)
            return values
        if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
            self.fault(root, "no <ORIGIN>: it is the middle of the ranges, which are not known")
        middle: Array = 0.5 * (lower + upper)
        return middle

    def _known(self, element: etree._Element, tags: Sequence[str]) -> None:
        tag = shown(element.tag)
        if tag not in tags:
            self.fault(element, f"<{tag}> is not known here{did_you_mean(tag, tags)}")

    def _number(self, element: etree._Element, key: str) -> float:
        written = element.get(key)
        if written is None:
            self.fault(element, f'<{element.tag}> has no {key} (add {key}="...")')
        try:
            value = parse_number(written)
        except ValueError as error:
            self.fault(element, f'{key}="{shown(written)}" {error} (write a decimal number)')
        if abs(value) > _LARGEST:
            self.fault(element, f'{key}="{shown(written)}" is beyond any hand (angles are in rad)')
        return value
