"""What the exchange under torques costs, against the physics that it has to keep up with."""

from __future__ import annotations

import numpy as np
import pytest

import wbc.compiled
from benchmarks.real_time import measured


@pytest.mark.slow
@pytest.mark.skipif(not wbc.compiled.COMPILED, reason="the kernels are not compiled")
@pytest.mark.parametrize(
    ("scenario", "most"), [("dual_arm_exchange_mujoco", 6.0), ("ball_exchange_mujoco", 9.0)]
)
def test_a_tick_costs_a_few_times_its_physics(scenario: str, most: float) -> None:
    """Measured 3.6 and 5.2, where 2 ms of physics take 0.33 and 0.19 ms; in real time there would
    be room for 6 and 10. Every hundredth tick may take three times as long."""
    pytest.importorskip("mujoco")
    found = measured(scenario, most=3000)
    assert found.ratio < most
    assert np.percentile(found.ticks, 99) / np.median(found.physics) < 3.0 * most
