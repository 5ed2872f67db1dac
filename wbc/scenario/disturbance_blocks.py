"""The block of a scenario that says what is wrong on purpose, and how far."""

from __future__ import annotations

import math
from typing import Annotated, Any, TypeAlias, final

from pydantic import Field

from wbc.scenario.blocks import Block, Entries, Text
from wbc.scenario.units import Distance, Force, PositiveTime, Quantity, Time
from wbc.scenario.wording import Faults, listing, mapping

Range: TypeAlias = Annotated[float, Quantity("share", least=0.0, most=0.95)]
Share: TypeAlias = Annotated[float, Quantity("share", least=0.0, most=1.0)]
Turn: TypeAlias = Annotated[float, Quantity("angle", least=0.0, most=math.pi)]
Spin: TypeAlias = Annotated[float, Quantity("angular velocity", least=0.0)]
Pull: TypeAlias = Annotated[float, Quantity("force")]

_ENGINES = ("compliant", "mujoco")


@final
class PushSpec(Block):
    """A force on the object for a while."""

    at: Time = Field(description="when it begins")
    force: Annotated[tuple[Pull, Pull, Pull], Entries(3)] = Field(
        description="at the object's origin, world's axes"
    )
    over: PositiveTime = Field(description="how long it lasts")


@final
class LostSpec(Block):
    """A contact that bears nothing for a while."""

    finger: Text
    at: Time = Field(description="when that begins")
    over: PositiveTime = Field(description="how long it lasts")


@final
class Disturbances(Block):
    """What the controller is not told: errors of the model, of the sensors, and what happens."""

    mass: Range = Field(default=0.0, description="of the object and its inertia, factor 1 ± this")
    friction: Range = Field(default=0.0, description="of the contacts, factor 1 ± this")
    size: Range = Field(default=0.0, description="of the object's surface, factor 1 ± this")
    position: Distance = Field(default=0.0, description="of the object, at most this far off")
    rotation: Turn = Field(default=0.0, description="of the object, at most this far off")
    gravity: Range = Field(
        default=0.0, description="torque of the arms' weight as modelled, factor 1 ± this"
    )
    force_noise: Share = Field(
        default=0.0, description="standard deviation of a measured force, as a share of it"
    )
    force_floor: Force = Field(default=0.0, description="and what is added to it, per axis")
    joint_noise: Turn = Field(default=0.0, description="standard deviation of measured positions")
    velocity_noise: Spin = Field(default=0.0, description="standard deviation, of the joints")
    delay: Time = Field(default=0.0, description="of the measured forces")
    dropout: Share = Field(
        default=0.0, description="how likely a sample is missing, per tick and sensor"
    )
    pushes: tuple[PushSpec, ...] = ()
    lost: tuple[LostSpec, ...] = Field(default=(), description="contacts")


def check_disturbances(data: dict[str, Any], faults: Faults) -> None:
    """Add the faults between the block and the rest of `data`."""
    simulation = mapping(data.get("simulation"))
    if simulation.get("disturbances") is None:
        return
    block = mapping(simulation["disturbances"])
    here = ("simulation", "disturbances")
    if simulation.get("engine", "kinematic") == "kinematic":
        text = f"needs 'simulation.engine: {' or '.join(_ENGINES)}', which have forces"
        faults.add(here, text, on="key")
    if "object" not in data:
        faults.add(here, "needs a block 'object'", on="key")
    fingers = mapping(data.get("contacts"))
    for i, entry in enumerate(listing(block.get("lost"))):
        finger = mapping(entry).get("finger")
        if isinstance(finger, str) and fingers and finger not in fingers:
            faults.unknown((*here, "lost", i, "finger"), "contact", finger, fingers)
