"""The blocks of a scenario that say what the object weighs and how its contacts may be loaded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias, final

from pydantic import Field

from wbc.scenario.blocks import Block, Entries, Text, Vector3, one_or_by_name
from wbc.scenario.units import (
    Density,
    Distance,
    Inertia,
    Mass,
    PositiveLength,
    PositiveMass,
    PositiveNumber,
    PositiveTime,
    Quantity,
    Torque,
)

PerContact: TypeAlias = Annotated[Mapping[str, PositiveNumber], one_or_by_name(PositiveNumber)]
"""One value, kept under ``"*"``, or a value by contact or pattern of contacts."""
LengthPerContact: TypeAlias = Annotated[
    Mapping[str, PositiveLength], one_or_by_name(PositiveLength)
]
Inertia3: TypeAlias = Annotated[tuple[Inertia, Inertia, Inertia], Entries(3)]


@final
class Pours(Block):
    """When what is inside leaves."""

    phase: Text = Field(description="during its 'over'")
    to: Mass = Field(default=0.0, description="what is left at its end")


@final
class Contents(Block):
    """A liquid in a cylindrical room about the object's z axis; its surface stays level."""

    type: Literal["water"]
    mass: PositiveMass
    radius: PositiveLength | None = Field(
        default=None, description="inside; the surface's when not given and it is a cylinder"
    )
    length: PositiveLength | None = Field(default=None, description="inside, as the radius")
    center: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="of the room inside, in the object's axes"
    )
    density: Density = 1000.0
    pours: Pours | None = None


@final
class Estimate(Block):
    """Mass and centre of mass of the object, from the forces measured at the fingertips."""

    phase: Text | None = Field(
        default=None,
        description="from which on nothing but fingers bears the object; the one after the first "
        "that moves it when not given",
    )
    smoothing: PositiveTime = Field(default=0.25, description="time constant of the low-pass")
    mass: Annotated[tuple[PositiveNumber, PositiveNumber], Entries(2)] = Field(
        default=(0.3, 3.0),
        description="bounds, as multiples of the object's 'mass'; 1 between them",
    )
    com: Distance = Field(
        default=0.02, description="largest shift of the centre of mass from the object's 'com'"
    )


@final
class Forces(Block):
    """How hard each contact presses: planned in each tick, with all limits kept."""

    model: Literal["point", "soft_finger"] = Field(
        default="point", description="soft_finger: a contact also takes a moment about its normal"
    )
    friction: PerContact = Field(description="mu; one value, or by contact or pattern")
    torsion: LengthPerContact = Field(
        default={}, description="mu_t of soft fingers: moment per normal force"
    )
    sliding_friction: PositiveNumber = Field(
        default=0.05, description="mu of a contact while it slides: it can hardly do but press"
    )
    torque_limits: Mapping[str, Torque] = Field(
        default={},
        description="joint or pattern: largest torque (force of a sliding joint), the first that "
        "fits; off: none; where nothing fits the URDF's effort, none if that is 0",
    )
    w_p: PositiveNumber = Field(default=1.0, description="weight of the normal forces")
    w_bF: PositiveNumber = Field(default=1e-2, description="weight of the friction barrier [N^2]")
    w_bT: PositiveNumber = Field(default=1e-3, description="weight of the torque barrier [N]")
    margin: Annotated[float, Quantity("number", least=0.0, most=0.5)] = Field(
        default=1e-3,
        description="part of a normal force to its cone, or of half a torque range to its limit, "
        "that must be left for a plan not to be called one of low margin",
    )
    method: Literal["newton", "exact"] = Field(
        default="newton", description="exact: the least forces, to the very limits"
    )
    ramp: PositiveTime = Field(
        default=0.2,
        description="how long forces take from one set of contacts to the next, in a phase without "
        "'over'",
    )
    estimate: Estimate | None = Field(
        default=None, description="plan for the load that is measured; {} for the defaults"
    )
