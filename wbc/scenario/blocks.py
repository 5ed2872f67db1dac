"""The parts that several blocks of a scenario share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, TypeAlias, final, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
)
from pydantic_core import core_schema

from wbc.scenario.units import (
    Angle,
    AngleOrLength,
    JointValue,
    Length,
    Number,
    Quantity,
    refusal,
)
from wbc.scenario.wording import show

EVERY: Final = "*"
"""The key that stands for every joint not named."""


class Block(BaseModel):
    """Base of all blocks: frozen, no unknown keys, no NaN. Built on first use, not on import."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True, strict=False
    )


def _flag(raw: object) -> object:
    if not isinstance(raw, bool):
        raise refusal(f"must be true or false, got {show(raw)}")
    return raw


def _count(raw: object) -> object:
    if isinstance(raw, bool) or not isinstance(raw, int):
        raise refusal(f"must be a whole number, got {show(raw)}")
    if not 0 <= raw < 2**63:
        raise refusal(f"must be at least 0 and below 2^63, got {show(raw)}")
    return raw


def _face(raw: object) -> object:
    return raw if isinstance(raw, str) else _count(raw)


def _pairs(raw: object) -> object:
    if raw == "auto":
        return None
    if not isinstance(raw, list | tuple):
        raise refusal(f"must be auto or a list of [link, link], got {show(raw)}")
    return raw


def _direction(raw: tuple[float, ...]) -> tuple[float, ...]:
    if not 1e-9 < math.hypot(*raw) < math.inf:
        raise refusal("has no direction: its norm must be above 1e-9 and finite")
    return raw


def _by_name(raw: object) -> object:
    return raw if isinstance(raw, dict) else {EVERY: raw}


@final
@dataclass(frozen=True)
class Prepared:
    """Runs `prepare` before the annotated type; `also` gives the JSON Schema this makes valid."""

    prepare: Callable[[object], object]
    also: Callable[[], dict[str, Any]] | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self.prepare, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        inner: dict[str, Any] = handler(schema)
        return {"anyOf": [self.also(), inner]} if self.also else inner


def one_or_by_name(kind: Any) -> Prepared:
    """One value for all, kept under ``"*"``, or values by name or pattern.

    Args:
        kind: of the values, ``Annotated[float, Quantity(...)]``.
    """
    quantity: Quantity = get_args(kind)[1]

    def schema() -> dict[str, Any]:
        return quantity.__get_pydantic_json_schema__(None, None)

    return Prepared(_by_name, schema)


@final
@dataclass(frozen=True)
class Entries:
    """How many entries a list has; `most` is `least` unless given, 0 for no bound."""

    least: int
    most: int | None = None

    def __call__(self, raw: object) -> object:
        most = self.least if self.most is None else self.most or math.inf
        if isinstance(raw, list | tuple) and not self.least <= len(raw) <= most:
            count = f"{self.least}" if most == self.least else f"{self.least} or {most}"
            if most == math.inf:
                count = f"at least {self.least}"
            entries = "entry" if count.endswith("1") else "entries"
            raise refusal(f"must have {count} {entries}, got {len(raw)}")
        return raw

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        inner: dict[str, Any] = handler(schema)
        most = self.least if self.most is None else self.most
        return inner | {"minItems": self.least} | ({"maxItems": most} if most else {})


Text: TypeAlias = Annotated[str, Field(min_length=1)]
Flag: TypeAlias = Annotated[bool, Prepared(_flag)]
Count: TypeAlias = Annotated[
    int, Prepared(_count), WithJsonSchema({"type": "integer", "minimum": 0})
]
Face: TypeAlias = Annotated[
    int | str,
    Prepared(_face),
    WithJsonSchema({"anyOf": [{"type": "integer", "minimum": 0}, {"type": "string"}]}),
]
Form: TypeAlias = Literal["settled", "printed"]
Axis: TypeAlias = Literal["x", "y", "z"]
Vector3: TypeAlias = Annotated[tuple[Length, Length, Length], Entries(3)]
Quaternion: TypeAlias = Annotated[
    tuple[Number, Number, Number, Number], Entries(4), AfterValidator(_direction)
]
Pair: TypeAlias = Annotated[tuple[Text, Text], Entries(2)]
Pairs: TypeAlias = tuple[Pair, ...]
AutoOrPairs: TypeAlias = Annotated[Pairs | None, Prepared(_pairs, lambda: {"const": "auto"})]
"""None stands for auto."""
PerJoint: TypeAlias = Annotated[
    Mapping[str, JointValue], Prepared(_by_name, AngleOrLength.json_schema)
]
"""One value, kept under ``"*"``, or a value by joint."""
Weights: TypeAlias = Annotated[
    Annotated[tuple[Angle, ...], Tag("list")] | Annotated[Text, Tag("name")],
    Discriminator(lambda raw: "name" if isinstance(raw, str) else "list"),
]
"""Weights of a hand's synergies, or a name for some."""


class Turned(Block):
    """A rotation in space: rpy or a quaternion, neither of them for none."""

    rpy: Annotated[tuple[Angle, Angle, Angle], Entries(3)] | None = Field(
        default=None, description="roll, pitch, yaw about the fixed x, y, z, as in URDF"
    )
    quaternion: Quaternion | None = Field(
        default=None, description="[x, y, z, w]; normalised when read"
    )

    @property
    def xyzw(self) -> tuple[float, float, float, float]:
        """The unit quaternion."""
        if self.quaternion is not None:
            norm = math.hypot(*self.quaternion)
            x, y, z, w = (component / norm for component in self.quaternion)
            return x, y, z, w
        return _quaternion(*(self.rpy or (0.0, 0.0, 0.0)))


def _quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """R_z(yaw) R_y(pitch) R_x(roll)."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


@final
class Rotation(Turned):
    """An orientation: rpy or quaternion."""


@final
class Pose(Turned):
    """In the plane: position [x, y] and angle. In space: [x, y, z] and rpy or quaternion."""

    position: Annotated[tuple[Length, ...], Entries(2, 3)]
    angle: Angle | None = Field(default=None, description="about z; in the plane only")

    @property
    def planar(self) -> bool:
        """Whether the pose was given in the plane."""
        return len(self.position) == 2

    @property
    def xyz(self) -> tuple[float, float, float]:
        """The position in space; a planar one lies in z = 0."""
        x, y, *z = self.position
        return x, y, z[0] if z else 0.0

    @property
    def xyzw(self) -> tuple[float, float, float, float]:
        """The unit quaternion, also of a planar pose."""
        if self.planar:
            return _quaternion(0.0, 0.0, self.angle or 0.0)
        return super().xyzw
