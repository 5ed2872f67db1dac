"""Noise, delay and dropout are as asked for, repeatable, and never on the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from wbc.control.state import Measurement
from wbc.sim.disturbances import Disturbance
from wbc.sim.plant import Sensed
from wbc.sim.sensors import Sensors

DT = 2e-3


def _truth(k: int = 0) -> Sensed:
    force = np.array([[10.0, 0.0, -2.0], [0.0, 0.0, 0.0]]) + k
    return Sensed(
        np.full(3, float(k)), np.full(3, -1.0), force, np.zeros(3), np.eye(3), np.zeros(2)
    )


def _read(ticks: int, *, moving: bool = True, **given: Any) -> list[Measurement]:
    sensors = Sensors(Disturbance(**given), DT)
    return [sensors.read(_truth(k if moving else 0)) for k in range(ticks)]


def _forces(read: list[Measurement]) -> np.ndarray:
    return np.array([m.force for m in read if m.force is not None])


def test_perfect_sensors_see_the_truth() -> None:
    seen = Sensors(Disturbance(seed=3), DT).read(_truth(5))
    for got, true in zip(seen[:3], (_truth(5).q, _truth(5).v, _truth(5).force), strict=True):
        assert got is not None
        assert np.array_equal(got, true)


def test_noise_has_the_deviation_asked_for() -> None:
    read = _read(
        4000, moving=False, joint_noise=2e-4, velocity_noise=0.02, force_noise=0.05,
        force_floor=0.02, seed=1,
    )  # fmt: skip
    off = np.array([m.q for m in read])
    assert off.std() == pytest.approx(2e-4, rel=0.03)
    assert abs(off.mean()) < 1e-5
    assert np.array([m.v for m in read]).std() == pytest.approx(0.02, rel=0.03)
    spread = _forces(read).std(axis=0)
    assert spread[0] == pytest.approx(np.hypot(0.02, [0.5, 0.0, 0.1]), rel=0.05)
    assert spread[1] == pytest.approx(np.full(3, 0.02), rel=0.05)


def test_seeds_decide() -> None:
    def run(seed: int) -> bytes:
        read = _read(50, joint_noise=1e-3, force_floor=0.1, dropout=0.2, delay=4e-3, seed=seed)
        return np.array([m.q for m in read]).tobytes() + _forces(read).tobytes()

    assert run(1) == run(1) != run(2)
    sensors = Sensors(Disturbance(joint_noise=1e-3, seed=1), DT)
    first = sensors.read(_truth()).q
    sensors.reset()
    assert np.array_equal(sensors.read(_truth()).q, first)


def test_forces_come_late_and_joints_do_not() -> None:
    read = _read(8, delay=3 * DT)
    assert [m.q[0] for m in read] == list(range(8))
    assert list(_forces(read)[:, 1, 0]) == [0, 0, 0, 0, 1, 2, 3, 4]


def test_a_lost_sample_shows_the_one_before() -> None:
    """One sensor's at a time."""
    read = _read(4000, dropout=0.3, seed=2)
    shown = np.array(
        [[*m.q, *f[:, 0] - [10.0, 0.0]] for m, f in zip(read, _forces(read), strict=True)]
    )
    lost = shown != np.arange(4000)[:, None]
    assert lost.mean(axis=0) == pytest.approx(np.full(5, 0.3), abs=0.03)
    assert lost.all(axis=1).mean() == pytest.approx(0.3**5, abs=0.003)
    assert np.array_equal(shown[1:][lost[1:]], shown[:-1][lost[1:]])


def test_the_truth_stays_as_it_is() -> None:
    truth = _truth()
    copies = [np.array(x) for x in truth]
    Sensors(Disturbance(joint_noise=1.0, force_floor=1.0, dropout=0.5), DT).read(truth)
    assert all(np.array_equal(a, b) for a, b in zip(truth, copies, strict=True))
