"""Joints with limits of all sizes, demands on them, and the filter called on both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from wbc.stack.limits import Limited, limit, limit_from, velocity_bounds


@dataclass(frozen=True)
class Joints:
    """Limits of n joints, each (n,), and the tick [s]."""

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    dt: float

    @property
    def n(self) -> int:
        return len(self.lower)

    def bounds(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low, high = np.full(self.n, np.nan), np.full(self.n, np.nan)
        velocity_bounds(
            q, self.lower, self.upper, self.velocity, self.acceleration, self.dt, low, high
        )
        return low, high

    def command(
        self, q: np.ndarray, last: np.ndarray, main: np.ndarray, total: np.ndarray
    ) -> tuple[np.ndarray, Limited]:
        out = np.full(self.n, np.nan)
        done = limit(main, total, last, *self.bounds(q), self.acceleration, self.dt, out)
        return out, Limited(*done)

    def command_from(
        self, anchor: np.ndarray, q: np.ndarray, last: np.ndarray, main: np.ndarray,
        total: np.ndarray,
    ) -> tuple[np.ndarray, Limited, float]:  # fmt: skip
        """Also the share of the way to the anchor."""
        out = np.full(self.n, np.nan)
        *done, kept = limit_from(
            anchor, main, total, last, *self.bounds(q), self.acceleration, self.dt, out
        )
        return out, Limited(*done), kept


def joints(
    n: int = 1, span: float = 1.0, velocity: float = 2.0, acceleration: float = 10.0,
    dt: float = 2e-3,
) -> Joints:  # fmt: skip
    one = np.ones(n)
    return Joints(-span * one, span * one, velocity * one, acceleration * one, dt)


@st.composite
def some_joints(draw: st.DrawFn) -> Joints:
    """One to four joints with limits of all sizes; some without position or acceleration limit."""
    n = draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    centre, span = rng.normal(size=n), 10.0 ** rng.uniform(-4, 1.5, n)
    unlimited = rng.random(n) < 0.1
    acceleration = np.where(rng.random(n) < 0.2, np.inf, 10.0 ** rng.uniform(-1, 3, n))
    velocity = np.where(rng.random(n) < 0.1, 0.0, 10.0 ** rng.uniform(-2, 1.5, n))
    return Joints(
        np.where(unlimited, -np.inf, centre - span),
        np.where(unlimited, np.inf, centre + span),
        velocity, acceleration, draw(st.sampled_from([1e-3, 2e-3, 1e-2, 0.1])),
    )  # fmt: skip


DEMANDS = ("outward", "back and forth", "noise", "rare", "huge", "still")


def demand(kind: str, k: int, rng: np.random.Generator, limits: Joints) -> np.ndarray:
    """(n,) what is asked for at tick k."""
    fast = 3.0 * limits.velocity + 0.1
    if kind == "outward":
        return fast
    if kind == "back and forth":
        return fast * np.sign(np.sin(2.0 * np.pi * k / (20.0 + 30.0 * np.arange(limits.n))))
    if kind == "noise":
        return fast * rng.normal(size=limits.n)
    if kind == "rare":
        return fast * rng.choice([0.0, 0.0, -1.0, 1.0, 1e-12], limits.n)
    return (
        np.full(limits.n, 1e12) * rng.choice([-1.0, 1.0]) if kind == "huge" else np.zeros(limits.n)
    )


def somewhere(limits: Joints, rng: np.random.Generator) -> np.ndarray:
    """(n,) a position inside the limits, often on one of them."""
    share = np.clip(rng.uniform(-0.2, 1.2, limits.n), 0.0, 1.0)
    inside = np.isfinite(limits.lower)
    low, high = np.where(inside, limits.lower, -1.0), np.where(inside, limits.upper, 1.0)
    return np.clip(low + share * (high - low), limits.lower, limits.upper)
