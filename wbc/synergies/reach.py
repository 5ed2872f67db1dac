"""Reach to grasp: the hand opens, then closes, along straight lines in the synergies' weights."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal, NamedTuple, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from wbc.arrays import Array, read_only
from wbc.errors import WbcError
from wbc.synergies.synergies import Synergies

Law: TypeAlias = Literal["linear", "smooth"]

_TOUCHES: Final = 1e-9
"""A joint this little out of its range is at its limit, [rad]."""


class Beyond(NamedTuple):
    """A joint is out of its range for a while.

    Attributes:
        joint: its name.
        start, end: from when to when, [s].
        excess: the largest on the way, above (> 0) or below (< 0) the range, [rad].
    """

    joint: str
    start: float
    end: float
    excess: float


@final
@dataclass(frozen=True)
class Reach:
    """The path of the weights of 3.3, after (56): zero offset, open hand, grasp.

    Attributes:
        synergies: of the hand.
        corners: (3, k) weights of the three configurations, [rad].
        law: in each of both parts the weights go ``linear`` in time, as published, or ``smooth``
            along the same line with minimum jerk, at rest at its ends.
        part: how long each part takes, [s].
    """

    synergies: Synergies
    corners: Array
    law: Law = "linear"
    part: float = 3.0

    def __post_init__(self) -> None:
        corners = read_only(self.corners)
        if corners.shape != (3, self.synergies.count) or not np.isfinite(corners).all():
            raise WbcError(f"a reach needs finite weights (3, {self.synergies.count}), "
                           f"got shape {corners.shape}")  # fmt: skip
        if self.law not in ("linear", "smooth"):
            raise WbcError(f"the law of a reach is 'linear' or 'smooth', not '{self.law}'")
        if not 0.0 < self.part < math.inf:
            raise WbcError(f"a part of a reach takes a positive time, not {self.part} s")
        object.__setattr__(self, "corners", corners)

    @classmethod
    def to(
        cls, synergies: Synergies, grasp: ArrayLike, *, law: Law = "linear", part: float = 3.0
    ) -> Reach:
        """From the zero offset over the open hand, all joints zero (56), to a grasp.

        Args:
            grasp: (k,) its weights, [rad].

        Raises:
            WbcError: another number of weights, one not finite, no such law, no time.
        """
        weights = np.asarray(grasp, dtype=np.float64)
        if weights.shape != (synergies.count,):
            raise WbcError(f"a grasp has {synergies.count} weights, got shape {weights.shape}")
        hand_open = synergies.project(np.zeros(len(synergies.joints)))
        corners = np.stack((np.zeros(synergies.count), hand_open, weights))
        return cls(synergies, corners, law, part)

    @property
    def duration(self) -> float:
        """Of both parts, [s]."""
        return 2.0 * self.part

    def weights(self, time: ArrayLike) -> Array:
        """At a time: () → (k,), or (m,) → (m, k), [rad]; at rest before 0 and after the end."""
        part, u = self._place(time)
        along = u if self.law == "linear" else _minimum_jerk(u)
        start = self.corners[part]
        # so that the ends are met to the last bit
        there: Array = np.where(
            along[..., None] == 1.0,
            self.corners[part + 1],
            start + along[..., None] * (self.corners[part + 1] - start),
        )
        return there

    def rates(self, time: ArrayLike) -> Array:
        """Of the weights, shaped as `weights`, [rad/s]; a linear law's jump counts as over."""
        part, u = self._place(time)
        speed = np.ones_like(u) if self.law == "linear" else 30.0 * u**2 * (1.0 - u) ** 2
        t = np.asarray(time, dtype=np.float64)
        speed = np.where((t < 0.0) | (t >= self.duration), 0.0, speed) / self.part
        rates: Array = speed[..., None] * (self.corners[part + 1] - self.corners[part])
        return rates

    def posture(self, time: ArrayLike) -> Array:
        """(55) at a time: () → (n,), or (m,) → (m, n), [rad]; may leave the ranges."""
        return self.synergies.posture(self.weights(time))

    def beyond(self) -> tuple[Beyond, ...]:
        """Where the path leaves the joints' ranges, joint after joint in the order of time.

        Not sampled: on each part a joint moves along a line from one corner to the next.
        """
        found: list[Beyond] = []
        corners = self.synergies.posture(self.corners)
        for j, joint in enumerate(self.synergies.joints):
            low, high = float(self.synergies.lower[j]), float(self.synergies.upper[j])
            for limit, side in ((low, -1.0), (high, 1.0)):
                out = side * (corners[:, j] - limit)
                found += self._outside(joint, side, [float(value) for value in out])
        order = {joint: j for j, joint in enumerate(self.synergies.joints)}
        return tuple(sorted(found, key=lambda beyond: (order[beyond.joint], beyond.start)))

    def _outside(self, joint: str, side: float, out: list[float]) -> list[Beyond]:
        """The times in which `out`, linear between its three corners, is above zero."""
        spans: list[Beyond] = []
        for part, (first, last) in enumerate(pairwise(out)):
            if max(first, last) <= _TOUCHES:
                continue
            crossing = self._time_along(first / (first - last)) if first * last < 0.0 else 0.0
            start = part * self.part + (crossing if first < 0.0 else 0.0)
            end = part * self.part + (crossing if last < 0.0 else self.part)
            excess = side * max(first, last)
            if spans and spans[-1].end == start:  # out at the corner: one stay
                before = spans.pop()
                start, excess = before.start, max(before.excess, excess, key=abs)
            spans.append(Beyond(joint, start, end, excess))
        return spans

    def _time_along(self, along: float) -> float:
        """When a part has gone a share of its line, [s] from its start."""
        if self.law == "linear":
            return self.part * along
        return self.part * _inverse(_minimum_jerk, along)

    def _place(self, time: ArrayLike) -> tuple[np.ndarray, Array]:
        """Which part a time is in, and the share of the part's time that is over."""
        t = np.asarray(time, dtype=np.float64)
        if t.ndim > 1 or not np.isfinite(t).all():
            raise WbcError("a time is needed, or a row of them, finite, in s")
        part = np.where(t >= self.part, 1, 0)
        return part, np.clip(t / self.part - part, 0.0, 1.0)


def _minimum_jerk(u: Array) -> Array:
    return u**3 * (10.0 + u * (6.0 * u - 15.0))


def _inverse(law: Callable[[Array], Array], value: float) -> float:
    """Where a rising law of [0, 1] onto itself has a value: by halves, to the last bit."""
    low, high = 0.0, 1.0
    while low < (middle := 0.5 * (low + high)) < high:
        if float(law(np.float64(middle))) < value:
            low = middle
        else:
            high = middle
    return high
