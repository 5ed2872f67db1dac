"""References at a pace: the same way, later; the rates that belong to it; nothing ends then."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from wbc.control.pace import pace_of, paced, stride
from wbc.control.references import Aim, Motion, References, led, object_acceleration
from wbc.control.state import ControllerState, Measurement, PhaseState, TickRecord
from wbc.rotations import exp_so3
from wbc.scenario import load
from wbc.scenario.build import build

DT = 2e-3
MOTION = Motion(
    0.1, 0.8, np.array([[0.0, 0.0, 0.0], [0.3, -0.1, 0.2]]), np.eye(3), np.array([0.3, 0.1, -0.4]),
    np.array([[5e-3], [4e-3]]), np.array([[[0.0, 0.1, 0.0]], [[0.1, 0.1, 0.3]]]),
    (Aim(0, np.array([0.7]), False),),
)  # fmt: skip


class Seen(NamedTuple):
    """References of a tick, copied."""

    position: np.ndarray
    rotation: np.ndarray
    twist: np.ndarray
    reach: np.ndarray
    reach_rate: np.ndarray
    tips: np.ndarray
    target: np.ndarray
    acceleration: np.ndarray


def followed(profile: Callable[[float], float], ticks: int, inner: float = 0.0) -> list[Seen]:
    """The references of a motion at a pace; `inner`: seen a part of a tick later."""
    phase = PhaseState(0, 0.0, MOTION, False, False, ())
    found, references = [], References(1)
    for k in range(ticks):
        phase = paced(phase, k * DT, DT, profile(k * DT))
        t, motion = (k + inner) * DT, phase.motion
        now = references.at(t, motion)
        target = led(t, motion, (np.array([0.2]),))[0]
        found.append(Seen(
            now.position.copy(), now.rotation.copy(), now.twist.copy(), now.reach.copy(),
            now.reach_rate.copy(), references.tips.copy(), np.resize(target, 2),
            object_acceleration(t, motion),
        ))  # fmt: skip
    return found


def slow(t: float) -> float:
    """Down to a stand, and back."""
    return pace_of(min(1.0, abs(t - 0.5) / 0.2))


def test_at_its_own_speed_nothing_is_touched() -> None:
    phase = PhaseState(0, 0.0, MOTION, False, False, ())
    assert paced(phase, 0.4, DT, 1.0) is phase


def test_rates_are_those_of_what_moves() -> None:
    """Differences over a small part of a tick, in which the pace stands."""
    eps = 0.05
    for a, b in zip(followed(slow, 500), followed(slow, 500, eps), strict=True):
        rate = (b.position - a.position) / (eps * DT)
        assert rate == pytest.approx(a.twist[:3], abs=2e-3)
        turned = exp_so3(eps * DT * a.twist[3:]) @ a.rotation
        assert b.rotation == pytest.approx(turned, abs=3e-7)
        assert (b.reach - a.reach) / (eps * DT) == pytest.approx(a.reach_rate, abs=1e-5)
        moved = (b.tips[:, :3] - a.tips[:, :3]) / (eps * DT)
        assert moved == pytest.approx(a.tips[:, 3:], abs=2e-3)
        if (a.target[1] != 0.0) and (b.target[1] != 0.0):
            assert (b.target[0] - a.target[0]) / (eps * DT) == pytest.approx(a.target[1], abs=5e-3)


def test_the_acceleration_is_the_twists_rate() -> None:
    seen = followed(slow, 500)
    twist, a = (np.array([getattr(s, name) for s in seen]) for name in ("twist", "acceleration"))
    change = np.diff(twist, axis=0) / DT
    mean = 0.5 * (a[1:] + a[:-1])
    assert np.abs(change).max() > 5.0
    assert np.abs(change - mean).max() < 0.02 * np.abs(change).max()


def test_a_stand_costs_time_and_nothing_else() -> None:
    plain, held = followed(lambda _: 1.0, 500), followed(slow, 700)
    standing = [s for s in held if not s.twist.any()]
    assert np.abs(held[-1].position - plain[-1].position).max() < 1e-12
    assert standing
    way = np.array([s.position[0] for s in held])
    assert (np.diff(way) >= 0.0).all()
    # the same curve, later: what the paced one passes, the plain one passes
    own = np.array([s.position[0] for s in plain])
    speed = np.interp(way, own, [s.twist[0] for s in plain])
    actual = np.array([s.twist[0] for s in held])
    assert (actual <= speed + 5e-3).all()


def test_a_stride_goes_as_fast_as_it_may_and_ends_exactly() -> None:
    share, seen = 1.0, []
    for _ in range(200):
        share = stride(share, 0.0, DT, 0.3)
        seen.append(pace_of(share))
    assert seen[-1] == 0.0 and seen.index(0.0) in (149, 150)
    assert max(-np.diff([1.0, *seen])) < 1.51 * DT / 0.3
    for _ in range(200):
        share = stride(share, 1.0, DT, 0.3)
    assert pace_of(share) == 1.0


def walked(windows: tuple[tuple[float, float], ...], ticks: int) -> tuple[
    list[TickRecord], ControllerState
]:  # fmt: skip
    """The planar exchange on the ideal robot, held for some times."""
    assembly = build(load("planar_exchange"))
    state, share, records = assembly.start, 1.0, []
    for k in range(ticks):
        held = any(a <= k * DT < b for a, b in windows)
        share = stride(share, 0.0 if held else 1.0, DT, 0.2)
        record, state = assembly.controller.step(state, Measurement(state.q), pace_of(share))
        records.append(record)
    return records, state


def test_a_held_exchange_waits_and_then_ends_as_it_would_have() -> None:
    """Held longer than any timeout: in each of reach, slide and leave, and the object with it."""
    plain, end = walked((), 2800)
    held, later = walked(((0.3, 2.5), (3.4, 6.0)), 5400)
    assert end.phase.done and later.phase.done and not later.phase.timeouts
    standing = [r for r in held if 0.8 < r.t < 2.5 or 4.2 < r.t < 6.0]
    assert max(np.abs(r.v).max() for r in standing) < 1e-6
    assert len({r.phase for r in standing}) == 2
    errors = [np.nanmax(r.object_error[:, 0]) for r in held[200:]]
    assert max(errors) < 1e-9
    assert np.abs(held[-1].q - plain[-1].q).max() < 5e-3
    change = [np.abs(b.v - a.v).max() for a, b in pairwise(held)]
    assert max(change) <= 60.0 * DT + 1e-9
