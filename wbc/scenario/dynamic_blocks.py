"""The blocks of a scenario that runs under torques: its physics, and the second stage's gains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias, final

from pydantic import Field

from wbc.scenario.blocks import EVERY, Block, Entries, Flag, Text, one_or_by_name
from wbc.scenario.units import (
    Damping,
    Force,
    Inertia,
    Length,
    NonNegative,
    PositiveLength,
    PositiveTime,
    Quantity,
    RateFromZero,
    Stiffness,
    Time,
    TorqueBound,
    TurningDamping,
    TurningStiffness,
)

NumberBy: TypeAlias = Annotated[Mapping[str, NonNegative], one_or_by_name(NonNegative)]
StiffnessBy: TypeAlias = Annotated[Mapping[str, Stiffness], one_or_by_name(Stiffness)]
RateBy: TypeAlias = Annotated[Mapping[str, RateFromZero], one_or_by_name(RateFromZero)]
ForceBy: TypeAlias = Annotated[Mapping[str, Force], one_or_by_name(Force)]
InertiaBy: TypeAlias = Annotated[Mapping[str, Inertia], one_or_by_name(Inertia)]
TurningStiffnessBy: TypeAlias = Annotated[
    Mapping[str, TurningStiffness], one_or_by_name(TurningStiffness)
]
TurningDampingBy: TypeAlias = Annotated[
    Mapping[str, TurningDamping], one_or_by_name(TurningDamping)
]


Plan: TypeAlias = Annotated[tuple[Length, Length], Entries(2)]


@final
class Table(Block):
    """What the object lies on at the start, wherever it truly is.

    The compliant engine has none: there a fixture holds the object until a phase moves it. Where
    'fixture' is given too, that is when the object is let go, in both engines.
    """

    height: Length | None = Field(default=None, description="of the table top in the world")
    size: Annotated[tuple[PositiveLength, PositiveLength], Entries(2)] = Field(
        default=(0.5, 0.5), description="of the top along x and y, the object in its middle"
    )
    posts: tuple[Plan, ...] = Field(
        default=(),
        description="where round posts touch the object from below, along the world's x and y from "
        "its position; each is as high as the object's underside there; hands collide with posts "
        "that stand on a top",
    )


@final
class Physics(Block):
    """Robot, pads and friction as an engine computes them."""

    step: PositiveTime = Field(default=1e-3, description="longest step of the engine's rule")
    control: Literal["held", "continuous"] = Field(
        default="held",
        description="torques held over the tick; continuous: anew in every evaluation, as in the "
        "published simulation (compliant only)",
    )
    friction: NumberBy = Field(default={EVERY: 0.8}, description="mu of tips; by contact")
    sliding_friction: NumberBy = Field(
        default={EVERY: 0.0}, description="mu of tips while they slide on purpose; by contact"
    )
    pad_damping: Damping = Field(default=5.0, description="of the pads along the normal")
    bristle_stiffness: Stiffness = Field(default=2e4, description="of stick-slip friction")
    bristle_damping: Annotated[float, Quantity("damping", above=0.0)] = 20.0
    armature: InertiaBy = Field(
        default={},
        description="joint or pattern: reflected inertia of its motor; where none is given, of a "
        "robot in space by its effort, and so its friction",
    )
    joint_damping: TurningDampingBy = Field(
        default={}, description="joint or pattern: viscous friction"
    )
    fixture: Text | None = Field(
        default=None,
        description="phase at whose start what holds the object until then lets go; beside a table "
        "it holds the object on that",
    )
    table: Table | None = Field(default=None, description="what the object lies on at the start")


@final
class Arms(Block):
    """Joint control of all that is no finger."""

    stiffness: TurningStiffnessBy = Field(
        default={EVERY: 1000.0}, description="joint or pattern; of sliding joints in N/m"
    )
    damping: TurningDampingBy = Field(default={EVERY: 100.0}, description="joint or pattern")
    integral: RateFromZero = Field(default=0.0, description="of the stiffness's torque")
    windup: TorqueBound = Field(default=10.0, description="largest torque of the integrators")


@final
class WatchBlock(Block):
    """When the watchdogs slow the motion or stop it."""

    arm_error: Annotated[float, Quantity("angle", above=0.0)] = Field(
        default=0.1,
        description="error of an arm joint at which all stands still; slower from half of it on",
    )
    finger_error: Annotated[float, Quantity("angle", above=0.0)] = Field(
        default=0.6, description="the same of finger joints"
    )
    lost: PositiveTime = Field(
        default=0.03, description="after which a finger that is not felt has lost its contact"
    )
    overload: PositiveTime = Field(
        default=0.1, description="at a torque limit, after which all goes slower"
    )


@final
class ForceControl(Block):
    """The second stage (36)."""

    position: StiffnessBy = Field(default={EVERY: 2000.0}, description="k_P; by contact")
    force: NumberBy = Field(default={EVERY: 0.2}, description="k_F; by contact")
    smoothing: Time = Field(
        default=0.0, description="time constant of the force errors that k_F acts on"
    )
    integral: RateBy = Field(default={EVERY: 20.0}, description="k_I; by contact")
    windup: ForceBy = Field(
        default={EVERY: 5.0}, description="largest force of the integrators; by contact"
    )
    damping: TurningDampingBy = Field(
        default={EVERY: 5.0}, description="k_d of finger joints, by joint or pattern"
    )
    position_in: Literal["palm", "world"] = Field(
        default="palm",
        description="where k_P holds a tip: world, errors of the arms made up for; or about its "
        "palm, wherever that is",
    )
    arms: Arms = Field(default_factory=Arms)
    inertia: Flag = Field(
        default=True,
        description="feed the torques of the commanded motion forward; false: gravity's only, "
        "as printed",
    )
    watch: WatchBlock = Field(default_factory=WatchBlock)
