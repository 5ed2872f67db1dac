"""What a controller sees of a plant: noise, delay and dropout, seeded. The truth stays as it is."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.arrays import Array
from wbc.control.state import Measurement
from wbc.sim.plant import Sensed


@final
@dataclass(frozen=True)
class SensorSettings:
    """How bad the sensors are; all zero: perfect ones.

    Attributes:
        position: standard deviation of each joint's reading, [rad] or [m].
        velocity: of each joint's speed, [rad/s] or [m/s].
        force: of each component of each tip's force, [N].
        force_gain: the same as a part of the component itself.
        delay: age of what is seen, [s]; rounded to ticks.
        dropout: chance that a tick's reading is lost, and the one before it seen again.
        seed: of all of it.
    """

    position: float = 0.0
    velocity: float = 0.0
    force: float = 0.0
    force_gain: float = 0.0
    delay: float = 0.0
    dropout: float = 0.0
    seed: int = 0


@final
class Sensors:
    """The sensors of one run, read once a tick."""

    def __init__(self, settings: SensorSettings, dt: float) -> None:
        """
        Args:
            dt: the tick [s].
        """
        self._settings = settings
        self._wait = round(settings.delay / dt)
        self.reset()

    def reset(self) -> None:
        """Begin anew: the same truth gives the same readings again."""
        self._random = np.random.default_rng(self._settings.seed)
        self._on_the_way: deque[Measurement] = deque(maxlen=self._wait + 1)
        self._seen: Measurement | None = None

    def read(self, truth: Sensed) -> Measurement:
        """What is seen when this is true. In the first ticks of a delay: the first reading."""
        settings, draw = self._settings, self._random.standard_normal
        scatter: Array = np.hypot(settings.force, settings.force_gain * truth.force)
        reading = Measurement(
            truth.q + settings.position * draw(truth.q.shape),
            truth.v + settings.velocity * draw(truth.v.shape),
            truth.force + scatter * draw(truth.force.shape),
        )
        self._on_the_way.append(reading)
        lost = self._random.random() < settings.dropout
        if self._seen is None or not lost:
            self._seen = self._on_the_way[0]
        return self._seen
