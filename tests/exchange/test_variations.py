"""The exchanges in space complete, or are refused before motion, wherever the object lies."""

from __future__ import annotations

import numpy as np
import pytest

from . import variations

FEW = 3


def judged(scenario: str, number: int, **settings: object) -> None:
    result = variations.judge(scenario, number, **settings)
    print(scenario, number, result.verdict, result.reasons, result.figures)
    assert result.verdict in ("completed", "refused"), result.reasons
    assert result.verdict == "completed" or all(result.reasons)


@pytest.mark.parametrize("number", range(FEW))
def test_a_few_at_a_coarse_tick(number: int) -> None:
    judged("dual_arm_exchange", number, **variations.COARSE)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(variations.COUNT))
@pytest.mark.parametrize("scenario", variations.SCENARIOS)
def test_all(scenario: str, number: int) -> None:
    judged(scenario, number)


def test_they_vary() -> None:
    """The whole range is used, the same every time."""
    drawn = [variations.displacement(number) for number in range(variations.COUNT)]
    shifts, turns = np.array([shift for shift, _ in drawn]), np.array([turn for _, turn in drawn])
    assert (np.abs(shifts).max(axis=0) > 0.8 * variations.PLACE).all()
    assert np.abs(shifts).max() <= variations.PLACE
    angles = np.rad2deg(np.linalg.norm(turns, axis=1))
    assert angles.max() > 0.8 * variations.TURN and angles.max() <= variations.TURN
    np.testing.assert_array_equal(variations.displacement(3)[0], shifts[3])
