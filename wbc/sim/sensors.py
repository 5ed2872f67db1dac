"""What a controller sees of a plant: noise, delay and dropout, seeded. The truth stays as it is."""

from __future__ import annotations

from collections import deque
from typing import final

import numpy as np

from wbc.arrays import Array
from wbc.control.state import Measurement
from wbc.sim.disturbances import Disturbance
from wbc.sim.plant import Sensed


@final
class Sensors:
    """The sensors of one run, read once a tick.

    Each joint and each fingertip is a sensor of its own. Where a sample is lost, the one before it
    is seen again. Forces are as old as the delay, rounded to ticks; before that the first is seen.
    """

    def __init__(self, disturbance: Disturbance, dt: float) -> None:
        """
        Args:
            disturbance: of which the noise, the delay, the dropout and their seed count here.
            dt: the tick [s].
        """
        self._given = disturbance
        self._wait = round(disturbance.delay / dt)
        self.reset()

    def reset(self) -> None:
        """Begin anew: the same truth gives the same readings again."""
        self._random = np.random.default_rng(self._given.seed)
        self._forces: deque[Array] = deque(maxlen=self._wait + 1)
        self._seen: Measurement | None = None

    def read(self, truth: Sensed) -> Measurement:
        """What is seen when this is true."""
        given, draw = self._given, self._random.standard_normal
        q = truth.q + given.joint_noise * draw(truth.q.shape)
        v = truth.v + given.velocity_noise * draw(truth.v.shape)
        scale = 1.0 + given.force_noise * draw(truth.force.shape)
        force = scale * truth.force + given.force_floor * draw(truth.force.shape)
        self._forces.append(force)
        force = self._forces[0]
        joints = self._random.random(len(q)) < given.dropout
        tips = self._random.random(len(force)) < given.dropout
        last = self._seen
        if last is not None and last.v is not None and last.force is not None:
            q, v = np.where(joints, last.q, q), np.where(joints, last.v, v)
            force = np.where(tips[:, None], last.force, force)
        self._seen = Measurement(q, v, force)
        return self._seen
