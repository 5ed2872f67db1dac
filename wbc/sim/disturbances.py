"""What is wrong with the world on purpose: masses, friction, poses, sensors, and what happens.

A scenario gives ranges, a seed makes one trial of them. A plant is handed what was drawn, the
controller never is.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

Vector: TypeAlias = tuple[float, float, float]


class Push(NamedTuple):
    """A force on the object at its origin, world axes.

    Attributes:
        at: when it begins [s].
        force: (3,) [N].
        over: how long it lasts [s].
    """

    at: float
    force: Vector
    over: float


class Lost(NamedTuple):
    """A contact that bears nothing for a while.

    Attributes:
        finger: whose.
        at: when that begins [s].
        over: how long it lasts [s].
    """

    finger: str
    at: float
    over: float


@dataclass(frozen=True)
class Ranges:
    """How far each quantity may be off; what is not drawn is as it stands here.

    Attributes:
        mass, friction, size, gravity: of a factor about 1, drawn from 1 ± range.
        position, rotation: largest length [m] and angle [rad]; direction or axis at random.
        force_noise, force_floor, joint_noise, velocity_noise, delay, dropout, pushes, lost: as in
            `Disturbance`, the same in every trial.
    """

    mass: float = 0.0
    friction: float = 0.0
    size: float = 0.0
    position: float = 0.0
    rotation: float = 0.0
    gravity: float = 0.0
    force_noise: float = 0.0
    force_floor: float = 0.0
    joint_noise: float = 0.0
    velocity_noise: float = 0.0
    delay: float = 0.0
    dropout: float = 0.0
    pushes: tuple[Push, ...] = ()
    lost: tuple[Lost, ...] = ()


@dataclass(frozen=True)
class Disturbance:
    """What one trial meets. As it stands here, nothing is wrong.

    Attributes:
        mass: factor on the object's mass and inertia.
        friction: factor on the friction between pads and object.
        size: factor on the object's surface.
        position: (3,) [m] of the object, true minus believed, world axes.
        rotation: (3,) rotation vector [rad] from the believed to the true attitude, world axes.
        gravity: factor on the arms' gravity torque as the controller's model has it.
        force_noise: standard deviation of a measured force, as a share of it.
        force_floor: standard deviation of a measured force beside that, per axis [N].
        joint_noise, velocity_noise: standard deviation of measured joints [rad], [rad/s].
        delay: of the measured forces [s].
        dropout: probability, per tick and sensor, that a sample is missing.
        pushes, lost: what happens, and when.
        seed: of the noise and the dropouts.
    """

    mass: float = 1.0
    friction: float = 1.0
    size: float = 1.0
    position: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)
    gravity: float = 1.0
    force_noise: float = 0.0
    force_floor: float = 0.0
    joint_noise: float = 0.0
    velocity_noise: float = 0.0
    delay: float = 0.0
    dropout: float = 0.0
    pushes: tuple[Push, ...] = ()
    lost: tuple[Lost, ...] = ()
    seed: int = 0

    def as_record(self) -> dict[str, Any]:
        """Plain numbers, names and lists by field, for summary.json."""
        facts = dataclasses.asdict(self)
        facts["pushes"] = [push._asdict() for push in self.pushes]
        facts["lost"] = [lost._asdict() for lost in self.lost]
        return facts


_STREAMS: Final = ("noise", "mass", "friction", "size", "position", "rotation", "gravity")
"""A stream of random numbers each, by its place here: new ones go to the end."""


def draw(ranges: Ranges, seed: int, *, planar: bool = False) -> Disturbance:
    """One trial of `ranges`.

    Each quantity has a stream of its own, so that asking for one more changes none of the others.
    Factors are uniform in 1 ± range. Offsets have a direction uniform on the sphere and a length
    uniform up to the range; in the plane a direction on the circle, and a turn about z.

    Args:
        seed: of the trial, at least 0.
        planar: the object moves in the plane.
    """
    factors = {
        name: 1.0 + getattr(ranges, name) * _stream(seed, name).uniform(-1.0, 1.0)
        for name in ("mass", "friction", "size", "gravity")
    }
    given = {
        field.name: getattr(ranges, field.name)
        for field in dataclasses.fields(Ranges)
        if field.name not in _STREAMS
    }
    return Disturbance(
        **factors,
        **given,
        position=_offset(seed, "position", ranges.position, 2 if planar else 3),
        rotation=_offset(seed, "rotation", ranges.rotation, 1 if planar else 3),
        seed=int(_stream(seed, "noise").integers(2**32)),
    )


def _stream(seed: int, name: str) -> np.random.Generator:
    sequence = np.random.SeedSequence(seed, spawn_key=(_STREAMS.index(name),))
    return np.random.default_rng(sequence)


def _offset(seed: int, name: str, most: float, dimensions: int) -> Vector:
    """A vector of random direction: in space, in x and y, or along z where there is one."""
    random = _stream(seed, name)
    along = random.normal(size=dimensions)
    along *= most * random.uniform() / np.linalg.norm(along)
    filled = {1: [0.0, 0.0, *along], 2: [*along, 0.0], 3: [*along]}[dimensions]
    x, y, z = (float(value) for value in filled)
    return x, y, z
