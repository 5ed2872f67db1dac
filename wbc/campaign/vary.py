"""Values of a scenario that differ from trial to trial: ``object.pose.position[0]=2 cm``."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from wbc.errors import ScenarioError, WbcError
from wbc.scenario import Loaded
from wbc.scenario.load import load_bytes, resolve
from wbc.scenario.units import UNITS, QuantityError, read
from wbc.scenario.wording import show

_SHARE: Final = "share"
_ALL: Final = tuple(dict.fromkeys(unit.dimension for unit in UNITS.values()))
_SI: Final = {u.dimension: name for name, u in UNITS.items() if u.times == u.per == 1.0}


@dataclass(frozen=True)
class Variation:
    """A value of the scenario and how far it may be from where it is.

    Attributes:
        key: its dotted path.
        value: in the middle, SI.
        most: largest deviation, SI.
        unit: as the value is to be written; empty for a plain number.
    """

    key: str
    value: float
    most: float
    unit: str

    def draw(self, seed: int) -> float:
        """Uniform in value ± most, by a stream of its own."""
        digest = hashlib.sha256(self.key.encode()).digest()
        words = np.frombuffer(digest[:12], dtype="<u4").tolist()
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=words))
        return self.value + self.most * float(random.uniform(-1.0, 1.0))

    def written(self, value: float) -> float | str:
        """A value as a scenario has it."""
        return f"{value!r} {self.unit}" if self.unit else value


def read_variations(texts: Sequence[str], loaded: Loaded) -> tuple[Variation, ...]:
    """``KEY=RANGE`` texts, the range in a unit or in % of the value.

    Raises:
        WbcError: one line per text that says nothing of this scenario.
    """
    found: list[Variation] = []
    faults = []
    for text in texts:
        key, equals, most = (part.strip() for part in text.partition("="))
        try:
            if not equals or not key:
                raise QuantityError("write KEY=RANGE, e.g. object.pose.position[0]=2cm")
            if key in {v.key for v in found}:
                raise QuantityError(f"'{key}' is varied twice")
            found.append(_variation(key, most.removeprefix("±"), loaded))
        except QuantityError as fault:
            faults.append(f"--vary '{text}': {fault}")
    if faults:
        raise WbcError("\n".join(faults))
    for sign in (-1.0, 1.0):
        ends = {v.key: v.written(v.value + sign * v.most) for v in found}
        try:
            raw, path, shown = loaded.text.encode(), loaded.path, loaded.source.shown
            load_bytes(raw, path, shown, {**loaded.overrides, **ends})
        except ScenarioError as error:
            lines = (line.removeprefix("--set ") for line in str(error).splitlines())
            raise WbcError("\n".join(f"--vary, at an end: {line}" for line in lines)) from None
    return tuple(found)


def drawn(variations: Iterable[Variation], seed: int) -> tuple[dict[str, Any], dict[str, float]]:
    """Overrides of a trial and the same in SI, by key."""
    values = {v.key: v.draw(seed) for v in variations}
    return {v.key: v.written(values[v.key]) for v in variations}, values


def _variation(key: str, most: str, loaded: Loaded) -> Variation:
    value, kind = _number(_found(key, loaded))
    reach, of = _number(most)
    if not 0.0 < reach < math.inf:
        raise QuantityError(f"a range must be above 0 and finite, got {show(most)}")
    if of == _SHARE:
        reach *= abs(value)
        if not reach:
            raise QuantityError("a share of 0 is 0: give the range in a unit")
    elif kind != of and not (kind == "" and (value == 0.0 or of != "angle")):
        is_a = f"of {kind}" if kind else "a plain number"
        raise QuantityError(f"a range of {of or 'no unit'} does not fit the value, {is_a}")
    unit = kind if of == _SHARE else of
    return Variation(key, value, reach, _SI.get(unit, ""))


def _found(key: str, loaded: Loaded) -> Any:
    """What the scenario has at `key`."""
    value: Any = loaded.source.located.data
    for part in resolve(value, key):
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            raise QuantityError("the scenario has no such value: --set it first") from None
    if key == "simulation.seed":
        raise QuantityError("each trial has its own seed anyway")
    return value


def _number(raw: Any) -> tuple[float, str]:
    """A quantity in SI and its dimension, empty for a number without unit."""
    if isinstance(raw, str):
        try:
            return float(raw), ""
        except ValueError:
            pass
        found = read(raw, *_ALL) if _readable(raw) else None
        if found is not None:
            return found.value, found.dimension
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise QuantityError(f"needs a number or a quantity, got {show(raw)}")
    return float(raw), ""


def _readable(raw: str) -> bool:
    try:
        read(raw, *_ALL)
    except QuantityError as fault:
        if str(fault).startswith("unknown unit"):
            raise
        return False
    return True
