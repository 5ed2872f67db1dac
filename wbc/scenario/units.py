"""Quantities with units: ``'110 deg'``, ``'5 mm'``, ``'20 /s'``.

A bare number is SI, except that an angle always names its unit.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Final, NamedTuple, TypeAlias, final

from pydantic_core import PydanticCustomError, core_schema

from wbc.errors import did_you_mean
from wbc.scenario.wording import clip, show


class Unit(NamedTuple):
    """One row of the table: a quantity is ``number * times / per`` in SI.

    Two factors: dividing by 1000 rounds correctly, multiplying by 0.001 does not. A degree is
    rounded as `math.radians` does.
    """

    dimension: str
    times: float = 1.0
    per: float = 1.0


UNITS: Final[dict[str, Unit]] = {
    "rad": Unit("angle"),
    "deg": Unit("angle", math.pi / 180.0),
    "mrad": Unit("angle", per=1000.0),
    "m": Unit("length"),
    "cm": Unit("length", per=100.0),
    "mm": Unit("length", per=1000.0),
    "um": Unit("length", per=1e6),
    "s": Unit("time"),
    "ms": Unit("time", per=1000.0),
    "us": Unit("time", per=1e6),
    "min": Unit("time", 60.0),
    "/s": Unit("rate"),
    "1/s": Unit("rate"),
    "/ms": Unit("rate", 1000.0),
    "N": Unit("force"),
    "mN": Unit("force", per=1000.0),
    "kN": Unit("force", 1000.0),
    "N/m": Unit("stiffness"),
    "N/mm": Unit("stiffness", 1000.0),
    "kN/m": Unit("stiffness", 1000.0),
    "N s/m": Unit("damping"),
    "Nm/rad": Unit("rotational stiffness"),
    "Nm s/rad": Unit("rotational damping"),
    "rad/s": Unit("angular velocity"),
    "deg/s": Unit("angular velocity", math.pi / 180.0),
    "rad/s^2": Unit("angular acceleration"),
    "deg/s^2": Unit("angular acceleration", math.pi / 180.0),
    "m/s": Unit("velocity"),
    "cm/s": Unit("velocity", per=100.0),
    "mm/s": Unit("velocity", per=1000.0),
    "m/s^2": Unit("acceleration"),
    "kg": Unit("mass"),
    "g": Unit("mass", per=1000.0),
    "kg m^2": Unit("inertia"),
    "kg cm^2": Unit("inertia", per=1e4),
    "kg/m^3": Unit("density"),
    "g/cm^3": Unit("density", 1000.0),
    "Nm": Unit("torque"),
    "mNm": Unit("torque", per=1000.0),
    "%": Unit("share", per=100.0),
}

EXAMPLES: Final[dict[str, str]] = {
    "angle": "110 deg",
    "length": "5 mm",
    "time": "2 ms",
    "rate": "20 /s",
    "force": "20 N",
    "stiffness": "5e4 N/m",
    "damping": "5 N s/m",
    "rotational stiffness": "1000 Nm/rad",
    "rotational damping": "100 Nm s/rad",
    "angular velocity": "2 rad/s",
    "angular acceleration": "60 rad/s^2",
    "velocity": "0.5 m/s",
    "acceleration": "2 m/s^2",
    "mass": "0.2 kg",
    "inertia": "1e-4 kg m^2",
    "density": "1000 kg/m^3",
    "torque": "0.5 Nm",
    "share": "30 %",
}

SHARED: Final = "x-quantity"
"""Marks a JSON Schema that recurs, and names it."""
NUMBER: Final = "number"
"""The dimension of a plain number, which takes no unit."""
_NUMBER = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"({_NUMBER})\s*(.*)", re.DOTALL)
_LONGEST = 100


class Coordinate(NamedTuple):
    """A value in SI that may be an angle or a length.

    `dimension` is ``"angle"``, ``"length"`` or, for a bare 0, ``"any"``.
    """

    value: float
    dimension: str

    def __float__(self) -> float:
        return self.value


class QuantityError(ValueError):
    """A quantity that cannot be read; the text says why."""


def units_of(dimension: str) -> tuple[str, ...]:
    """The units a dimension may be written in."""
    return tuple(name for name, unit in UNITS.items() if unit.dimension == dimension)


def _a(dimension: str) -> str:
    return f"{'an' if dimension[0] in 'aeiou' else 'a'} {dimension}"


def _wanted(dimensions: tuple[str, ...]) -> str:
    if dimensions == (NUMBER,):
        return "a plain number"
    return " or ".join(f"{_a(d)} such as '{EXAMPLES[d]}'" for d in dimensions)


def _finite(value: float, raw: object) -> float:
    if not math.isfinite(value):
        raise QuantityError(f"must be a finite number, got {show(raw)}")
    return value


def _bare(value: float, raw: object, dimensions: tuple[str, ...]) -> Coordinate:
    _finite(value, raw)
    if "angle" in dimensions and value != 0.0:
        also = "" if len(dimensions) == 1 else f" (a length: '{EXAMPLES['length']}')"
        raise QuantityError(f"an angle needs its unit: write '110 deg' or '1.92 rad'{also}")
    return Coordinate(value, dimensions[0] if len(dimensions) == 1 else "any")


def read(raw: object, *dimensions: str) -> Coordinate:
    """`raw` in SI, if it is a quantity of one of `dimensions`.

    Raises:
        QuantityError: it is not; the text says what was wanted.
    """
    if isinstance(raw, bool) or not isinstance(raw, int | float | str):
        raise QuantityError(f"must be {_wanted(dimensions)}, got {show(raw)}")
    if not isinstance(raw, str):
        try:
            return _bare(float(raw), raw, dimensions)
        except OverflowError:
            raise QuantityError(f"must be a finite number, got {show(raw)}") from None
    match = _QUANTITY.fullmatch(raw.strip()) if len(raw) <= _LONGEST else None
    if match is None or dimensions == (NUMBER,):
        raise QuantityError(f"must be {_wanted(dimensions)}, got {show(raw)}")
    number, name = float(match[1]), match[2]
    if not name:
        return _bare(number, raw, dimensions)
    if name not in UNITS:
        known = [u for d in dimensions for u in units_of(d)]
        raise QuantityError(f"unknown unit '{clip(name)}'{did_you_mean(clip(name), known)}")
    unit = UNITS[name]
    if unit.dimension not in dimensions:
        raise QuantityError(f"must be {_wanted(dimensions)}, got {_a(unit.dimension)}, {show(raw)}")
    return Coordinate(_finite(number * unit.times / unit.per, raw), unit.dimension)


@final
@dataclass(frozen=True)
class Quantity:
    """Tells pydantic how to read one dimension, within bounds given in SI.

    `off` names the word that stands for None.
    """

    dimension: str
    above: float | None = None
    least: float | None = None
    most: float | None = None
    off: str | None = None

    def __call__(self, raw: object) -> float | None:
        if self.off is not None and raw == self.off:
            return None
        try:
            value = read(raw, self.dimension).value
        except QuantityError as fault:
            also = f" (or '{self.off}')" if self.off else ""
            raise refusal(f"{fault}{also}") from None
        if self.above is not None and not value > self.above:
            raise refusal(f"must be above {self.above:g}, got {show(raw)}")
        if self.least is not None and not value >= self.least:
            raise refusal(f"must be at least {self.least:g}, got {show(raw)}")
        if self.most is not None and not value <= self.most:
            raise refusal(f"must be at most {self.most:g}, got {show(raw)}")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        number: dict[str, Any] = {"type": "number"}
        bounds = {"exclusiveMinimum": self.above, "minimum": self.least, "maximum": self.most}
        if self.dimension == "angle":
            number = {"const": 0}
        else:
            number |= {name: bound for name, bound in bounds.items() if bound is not None}
        if self.dimension == NUMBER:
            return number
        forms = [number, _text_schema(self.dimension)]
        if self.off is not None:
            forms.append({"const": self.off})
        limits = {"above": self.above, "from": self.least, "to": self.most}
        name = "-".join(f"{word}-{b:g}" for word, b in limits.items() if b is not None)
        name = "-".join(filter(None, [self.dimension.replace(" ", "-"), name, self.off]))
        return {SHARED: name, "anyOf": forms, "examples": [EXAMPLES[self.dimension]]}


@final
@dataclass(frozen=True)
class AngleOrLength:
    """Tells pydantic to read a joint or chart coordinate."""

    def __call__(self, raw: object) -> Coordinate:
        try:
            return read(raw, "angle", "length")
        except QuantityError as fault:
            raise refusal(str(fault)) from None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return self.json_schema()

    @staticmethod
    def json_schema() -> dict[str, Any]:
        """What an editor should accept."""
        forms = [{"const": 0}, _text_schema("angle", "length")]
        examples = [EXAMPLES["angle"], EXAMPLES["length"]]
        return {SHARED: "angle-or-length", "anyOf": forms, "examples": examples}


def _text_schema(*dimensions: str) -> dict[str, Any]:
    # an escaped space is no regular expression to the browsers' kind of editor
    names = "|".join(re.escape(u).replace("\\ ", " ") for d in dimensions for u in units_of(d))
    bare = "" if "angle" in dimensions else "?"
    return {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*({names}){bare}\s*$"}


def refusal(text: str) -> PydanticCustomError:
    """A pydantic error whose whole text is ours."""
    return PydanticCustomError("wbc", "{text}", {"text": text})


Angle: TypeAlias = Annotated[float, Quantity("angle")]
Length: TypeAlias = Annotated[float, Quantity("length")]
PositiveLength: TypeAlias = Annotated[float, Quantity("length", above=0.0)]
Distance: TypeAlias = Annotated[float, Quantity("length", least=0.0)]
Time: TypeAlias = Annotated[float, Quantity("time", least=0.0)]
PositiveTime: TypeAlias = Annotated[float, Quantity("time", above=0.0)]
Rate: TypeAlias = Annotated[float, Quantity("rate", above=0.0)]
RateFromZero: TypeAlias = Annotated[float, Quantity("rate", least=0.0)]
RateOrOff: TypeAlias = Annotated[float | None, Quantity("rate", above=0.0, off="off")]
Force: TypeAlias = Annotated[float, Quantity("force", least=0.0)]
PositiveForce: TypeAlias = Annotated[float, Quantity("force", above=0.0)]
Stiffness: TypeAlias = Annotated[float, Quantity("stiffness", above=0.0)]
Damping: TypeAlias = Annotated[float, Quantity("damping", least=0.0)]
TurningStiffness: TypeAlias = Annotated[float, Quantity("rotational stiffness", least=0.0)]
TurningDamping: TypeAlias = Annotated[float, Quantity("rotational damping", least=0.0)]
AngularVelocity: TypeAlias = Annotated[float, Quantity("angular velocity", above=0.0)]
AngularAcceleration: TypeAlias = Annotated[float, Quantity("angular acceleration", above=0.0)]
Mass: TypeAlias = Annotated[float, Quantity("mass", least=0.0)]
PositiveMass: TypeAlias = Annotated[float, Quantity("mass", above=0.0)]
Inertia: TypeAlias = Annotated[float, Quantity("inertia", least=0.0)]
Density: TypeAlias = Annotated[float, Quantity("density", above=0.0)]
Torque: TypeAlias = Annotated[float | None, Quantity("torque", above=0.0, off="off")]
"""None stands for no limit."""
TorqueBound: TypeAlias = Annotated[float, Quantity("torque", least=0.0)]
Number: TypeAlias = Annotated[float, Quantity(NUMBER)]
PositiveNumber: TypeAlias = Annotated[float, Quantity(NUMBER, above=0.0)]
NonNegative: TypeAlias = Annotated[float, Quantity(NUMBER, least=0.0)]
JointValue: TypeAlias = Annotated[Coordinate, AngleOrLength()]
