"""Noise, delay and dropout are as asked for, repeatable, and never on the truth."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.control.state import Measurement
from wbc.sim.plant import Sensed
from wbc.sim.sensors import Sensors, SensorSettings

DT = 2e-3


def _truth(k: int = 0) -> Sensed:
    force = np.array([[10.0, 0.0, -2.0], [0.0, 0.0, 0.0]])
    return Sensed(
        np.full(3, float(k)), np.full(3, -1.0), force, np.zeros(3), np.eye(3), np.zeros(2)
    )


def _read(settings: SensorSettings, ticks: int) -> list[Measurement]:
    sensors = Sensors(settings, DT)
    return [sensors.read(_truth(k)) for k in range(ticks)]


def _forces(read: list[Measurement]) -> np.ndarray:
    return np.array([m.force for m in read if m.force is not None])


def test_perfect_sensors_see_the_truth() -> None:
    seen = Sensors(SensorSettings(seed=3), DT).read(_truth(5))
    for got, true in zip(seen, (_truth(5).q, _truth(5).v, _truth(5).force), strict=True):
        assert got is not None
        assert np.array_equal(got, true)


def test_noise_has_the_deviation_asked_for() -> None:
    settings = SensorSettings(position=2e-4, velocity=0.02, force=0.02, force_gain=0.05, seed=1)
    read = _read(settings, 4000)
    off = np.array([m.q - k for k, m in enumerate(read)])
    assert off.std() == pytest.approx(2e-4, rel=0.03)
    assert abs(off.mean()) < 1e-5
    assert np.array([m.v for m in read]).std() == pytest.approx(0.02, rel=0.03)
    spread = _forces(read).std(axis=0)
    assert spread[0] == pytest.approx(np.hypot(0.02, [0.5, 0.0, 0.1]), rel=0.05)
    assert spread[1] == pytest.approx(np.full(3, 0.02), rel=0.05)


def test_seeds_decide() -> None:
    def run(seed: int) -> bytes:
        settings = SensorSettings(position=1e-3, force=0.1, dropout=0.2, delay=4e-3, seed=seed)
        return np.array([m.q for m in _read(settings, 50)]).tobytes()

    assert run(1) == run(1) != run(2)
    sensors = Sensors(SensorSettings(position=1e-3, seed=1), DT)
    first = sensors.read(_truth()).q
    sensors.reset()
    assert np.array_equal(sensors.read(_truth()).q, first)


def test_delay_shows_what_was() -> None:
    read = _read(SensorSettings(delay=3 * DT), 8)
    assert [m.q[0] for m in read] == [0, 0, 0, 0, 1, 2, 3, 4]


def test_a_lost_reading_shows_the_one_before() -> None:
    read = _read(SensorSettings(dropout=0.3, seed=2), 4000)
    shown = np.array([m.q[0] for m in read])
    lost = np.flatnonzero(shown != np.arange(4000))
    assert len(lost) / 4000 == pytest.approx(0.3, abs=0.03)
    assert np.array_equal(shown[lost], shown[lost - 1])


def test_the_truth_stays_as_it_is() -> None:
    truth = _truth()
    copies = [np.array(x) for x in truth]
    Sensors(SensorSettings(position=1.0, force=1.0, seed=1), DT).read(truth)
    assert all(np.array_equal(a, b) for a, b in zip(truth, copies, strict=True))
