"""The points of the object's surface below the fingertips, followed as the tips move."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.base import POINT
from wbc.contact.surfaces.closest import follow
from wbc.contact.surfaces.foot import flat, is_foot, sought

_NEAR = 0.01  # [m] beyond its rest length at which a pad is watched in every evaluation


@final
class Feet:
    """For each tip the closest surface point: by Newton's rule from the last, from afar by search.

    A tip that is far cannot touch before it has moved as far as it is from the surface; until then
    it is not looked at. Beyond the edge of a face, and near a chart's pole, the foot is sought anew
    in each step.

    Attributes:
        near: (N,) tips whose records are fresh; the others are too far away to touch.
        records: (N, 6, 3) chart records at the feet, object frame.
    """

    def __init__(self, surface: Surface, rest_length: Array) -> None:
        n = len(rest_length)
        self._surface = surface
        self._reach = rest_length + _NEAR
        self._xi: Array = np.zeros((n, 2))
        self._face: IntArray = np.zeros(n, dtype=np.int64)
        self._room: Array = np.full(n, -1.0)  # how far a far tip may go unseen
        self._from: Array = np.zeros((n, 3))  # where it was
        self._at: Array = np.zeros((n, 3))
        self.near: BoolArray = np.zeros(n, dtype=np.bool_)
        self.records: Array = np.zeros((n, 6, 3))

    def forget(self) -> None:
        """Begin anew: the tips may be anywhere at the next `begin`."""
        self._room[:] = -1.0
        self.near[:] = False

    def begin(self, tips: Array) -> None:
        """At the start of a step: which tips could touch, and their feet for certain.

        Args:
            tips: (N, 3) in the object frame [m].
        """
        self.follow(tips)
        for i, tip in enumerate(tips):
            if not self.near[i]:
                if np.linalg.norm(tip - self._from[i]) < self._room[i]:
                    continue
            elif not self._astray(i, tip):
                self._judge(i, tip)
                if self.near[i]:
                    continue  # one that has gone is looked for, for it may have come elsewhere
            if np.isfinite(tip).all():
                self._xi[i], self._face[i], self.records[i] = sought(
                    self._surface, flat(self._surface, tip)
                )
                self._judge(i, tip)

    def follow(self, tips: Array) -> Array:
        """The records (N, 6, 3) where the tips have moved to since `begin`."""
        if self.near.any():
            self._at[:] = flat(self._surface, tips)
            far = ~self.near
            self._at[far] = self.records[far, POINT]
            follow(self._surface, self._at, self._xi, self._face, self.records)
        return self.records

    def _judge(self, i: int, tip: Array) -> None:
        """Near or far, and if far, how far it may go."""
        gap = float(np.linalg.norm(flat(self._surface, tip) - self.records[i, POINT]))
        # a little further out than in, so that a tip at the limit does not go to and fro
        self.near[i] = gap < self._reach[i] * (2.0 if self.near[i] else 1.5)
        if not self.near[i]:
            self._room[i] = 0.9 * (gap - self._reach[i])
            self._from[i] = tip

    def _astray(self, i: int, tip: Array) -> bool:
        """Whether following has not arrived, or has left what its chart is good for."""
        surface, xi, face = self._surface, self._xi[i], int(self._face[i])
        return not is_foot(surface, xi, face, self.records[i], flat(surface, tip))
