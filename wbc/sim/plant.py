"""What a robot and an object do under torques: the interface that every engine offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.control.state import Measurement


class Sensed(NamedTuple):
    """What there is at one instant.

    Attributes:
        q, v: (nv,) joint positions [rad] or [m] and velocities, in the order of `RobotModel`.
        force: (N, 3) force of each fingertip on the object, world axes [N]; 0 where it is off.
        object_position, object_rotation: (3,) [m], (3, 3): the truth, which no controller is given.
        slip: (N,) tangential way that each contact has slid so far while it was to hold, [m].
    """

    q: Array
    v: Array
    force: Array
    object_position: Array
    object_rotation: Array
    slip: Array

    @property
    def measurement(self) -> Measurement:
        """The part that sensors of a robot give: joints, and forces at the fingertips."""
        return Measurement(self.q, self.v, self.force)


class Plant(ABC):
    """A robot and a free object, moved by joint torques. Values go in and out, never changed."""

    @abstractmethod
    def reset(self, q: Array, v: Array, position: Array, rotation: Array) -> Sensed:
        """Put the robot at q, v (nv,) and the object at rest at a pose; no contact has slid.

        Args:
            position, rotation: (3,) [m], (3, 3) of the object's frame in the world.
        """

    @abstractmethod
    def treat(self, mode: IntArray) -> None:
        """Say how the contacts are meant from now on, (N,) ContactMode; before `reset`: all hold.

        It decides whose slip counts (`ContactMode.FIXED`), and where a scenario gives tips that
        slide on purpose another friction, who they are.
        """

    def disturb(self, push: Array, lost: BoolArray) -> None:
        """What happens from now on, until it is said anew; an engine may know of nothing.

        Args:
            push: (3,) force on the object at its origin, world axes [N].
            lost: (N,) contacts that bear nothing.
        """
        return None

    def release(self) -> None:
        """Let go of the object, where something beside the fingers holds it: a fixture."""
        return None

    @abstractmethod
    def step(self, tau: Array, dt: float) -> Sensed:
        """Hold the torques (nv,) for a time dt [s] and say what there is then.

        Never raises on numbers: an engine that diverges says so by values that are not finite, from
        then on until `reset`.
        """


def no_numbers(nv: int, count: int) -> Sensed:
    """What an engine that has diverged says of nv joints and `count` contacts."""
    shapes = ((nv,), (nv,), (count, 3), (3,), (3, 3), (count,))
    return Sensed(*(np.full(shape, np.nan) for shape in shapes))
