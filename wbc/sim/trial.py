"""What a drawn disturbance does to a run: where the object truly is, what is seen, what happens."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar, final

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.contact.surfaces import Surface
from wbc.control.state import Measurement
from wbc.robot.dynamics import InverseDynamics
from wbc.robot.model import RobotModel
from wbc.rotations import exp_so3
from wbc.sim.disturbances import Disturbance
from wbc.sim.plant import Sensed
from wbc.sim.sensors import Sensors

_Shape = TypeVar("_Shape", bound=Surface)


@final
class Trial:
    """One run's disturbance at work. The controller is handed what `seen` returns, and no more.

    Mass, friction and size of the object are the plant's, from when it was made.
    """

    def __init__(
        self, given: Disturbance, model: RobotModel, contacts: tuple[str, ...], arms: BoolArray,
        dt: float,
    ) -> None:  # fmt: skip
        """
        Args:
            contacts: (N,) names.
            arms: (nv,) joints whose weight the controller has wrong.
            dt: the tick [s].
        """
        self._given = given
        self._contacts = contacts
        self._arms = arms
        self._sensors = Sensors(given, dt)
        self._dynamics = InverseDynamics(model)

    def placed(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Where the object truly is, (3,) [m], (3, 3), when it is believed to be here."""
        given = self._given
        return position + given.position, exp_so3(np.array(given.rotation)) @ rotation

    def begin(self) -> None:
        """A run begins: the sensors' random numbers, too."""
        self._sensors.reset()

    def seen(self, truth: Sensed) -> Measurement:
        """What the sensors say; once a tick."""
        return self._sensors.read(truth)

    def misjudged(self, tau: Array, q: Array) -> Array:
        """(nv,) torques that the controller commands with a wrong idea of the arms' weight."""
        if self._given.gravity == 1.0:
            return tau
        still = np.zeros(len(q))
        weight = np.where(self._arms, self._dynamics.torques(q, still, still), 0.0)
        out: Array = tau + (self._given.gravity - 1.0) * weight
        return out

    def happening(self, t: float) -> tuple[Array, BoolArray]:
        """Force on the object (3,) [N], and contacts that bear nothing (N,), from t on."""
        given = self._given
        push = np.zeros(3)
        for one in given.pushes:
            if one.at <= t < one.at + one.over:
                push += one.force
        gone = {one.finger for one in given.lost if one.at <= t < one.at + one.over}
        return push, np.array([name in gone for name in self._contacts], dtype=np.bool_)

    @property
    def eventful(self) -> bool:
        """Whether anything happens while it runs."""
        return bool(self._given.pushes or self._given.lost)


def scaled(surface: _Shape, factor: float) -> _Shape:
    """The surface `factor` times as large: every length of it, but not its exponent."""
    if factor == 1.0:
        return surface
    sizes: dict[str, Any] = {}
    for field in dataclasses.fields(surface):  # type: ignore[arg-type]  # every final one is
        if field.init and field.name != "p":
            sizes[field.name] = _larger(field.name, getattr(surface, field.name), factor)
    changed: _Shape = dataclasses.replace(surface, **sizes)  # type: ignore[type-var]
    return changed


def _larger(name: str, value: Any, factor: float) -> Any:
    if name == "harmonics":  # the first of a row is its order
        return tuple((order, *(factor * x for x in lengths)) for order, *lengths in value)
    if isinstance(value, tuple):
        return tuple(factor * x for x in value)
    return factor * value
