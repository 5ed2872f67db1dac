"""The smooth gains: exact in time, without steps, and the published form to compare."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stack.problems import seeded
from wbc.stack.activation import Activation, advance, published, start

RATE = 12.0
SHARE = st.floats(0.0, 1.0)


def after(activation: Activation, target: np.ndarray, time: float, steps: int) -> Activation:
    for _ in range(steps):
        activation = advance(activation, target, RATE, time / steps)
    return activation


@settings(max_examples=200, deadline=None)
@given(rho=SHARE, lag=SHARE, target=SHARE, dt=st.floats(0.0, 10.0), share=SHARE)
def test_two_steps_equal_one(rho, lag, target, dt, share):
    """Exact solution: however the time is cut, the gains at its end are the same."""
    begin, goal = Activation(np.array([rho]), np.array([lag])), np.array([target])
    once = advance(begin, goal, RATE, dt)
    twice = advance(advance(begin, goal, RATE, share * dt), goal, RATE, (1.0 - share) * dt)
    np.testing.assert_allclose(twice.rho, once.rho, atol=2e-12)  # arriving, up to 1e-12 is skipped
    np.testing.assert_allclose(twice.lag, once.lag, atol=2e-12)
    assert -1e-15 <= once.rho[0] <= 1.0 + 1e-15
    assert -1e-15 <= once.lag[0] <= 1.0 + 1e-15


def test_solves_two_lags_in_series():
    """λ' = μ (target − λ), ρ' = μ (λ − ρ), by differences of the solution."""
    rng = seeded("lags")
    begin, target = Activation(rng.uniform(size=4), rng.uniform(size=4)), rng.uniform(size=4)
    h = 1e-5
    for t in (0.01, 0.1, 0.4):
        before, here, later = (advance(begin, target, RATE, t + s) for s in (-h, 0.0, h))
        np.testing.assert_allclose(
            (later.lag - before.lag) / (2 * h), RATE * (target - here.lag), atol=1e-6
        )
        np.testing.assert_allclose(
            (later.rho - before.rho) / (2 * h), RATE * (here.lag - here.rho), atol=1e-6
        )


def test_neither_the_gain_nor_its_slope_jumps_at_a_switch():
    """Switched at any time, also half way and back; from rest ρ moves by O(dt²) in the first dt."""
    dt, state, rho = 1e-4, start(1), [0.0]
    switches = {200: 1.0, 900: 0.0, 1100: 1.0, 1150: 0.0, 4000: 1.0}
    target = np.zeros(1)
    for k in range(9000):
        target = np.array([switches.get(k, float(target[0]))])
        state = advance(state, target, RATE, dt)
        rho.append(float(state.rho[0]))
    slope = np.diff(rho) / dt
    assert np.abs(np.diff(rho)).max() < RATE * dt
    assert np.abs(np.diff(slope)).max() < 2.0 * RATE**2 * dt  # |ρ''| ≤ 2 μ²
    # the first tick after a switch from rest: half the square of the published form's step
    assert rho[201] == pytest.approx(0.5 * (RATE * dt) ** 2, rel=2e-3)


def test_result_does_not_depend_on_the_tick():
    target = np.array([1.0, 0.0])
    begin = Activation(np.array([0.2, 0.9]), np.array([0.0, 1.0]))
    for time in (0.02, 0.5):
        ends = [after(begin, target, time, steps) for steps in (1, 10, 250)]
        for end in ends[1:]:
            np.testing.assert_allclose(end.rho, ends[0].rho, atol=1e-13)


def test_everything_starts_out_and_arrives():
    """At exactly 0 and 1: a task that is out is out, and one that is in takes its rows whole."""
    state = start(3)
    np.testing.assert_array_equal(state.rho, 0.0)
    for target in (np.ones(3), np.zeros(3), np.full(3, 0.25)):
        state = after(state, target, 40.0 / RATE, 1000)
        np.testing.assert_array_equal(state.rho, target)
        np.testing.assert_array_equal(state.lag, target)


def test_an_infinite_rate_switches_at_once():
    target = np.array([1.0, 0.0, 0.4])
    state = advance(start(3), target, math.inf, 1e-3)
    np.testing.assert_array_equal(state.rho, target)
    target[:] = 7.0  # the state is a value: what happens to the target later is not its business
    assert state.rho.max() == state.lag.max() == 1.0
    # the limit of large rates
    fast = advance(start(1), np.ones(1), 1e9, 1e-3)
    np.testing.assert_array_equal(fast.rho, 1.0)


def test_advancing_leaves_its_arguments_alone():
    begin, target = Activation(np.array([0.3]), np.array([0.6])), np.array([1.0])
    advance(begin, target, RATE, 0.01)
    assert (begin.rho[0], begin.lag[0], target[0]) == (0.3, 0.6, 1.0)


def test_published_form():
    """1 − e^{−μ(t−τ)} and e^{−μ(t−τ′)}: right at rest, a jump when switched back early."""
    assert published(2.0, 2.0, RATE, inserted=True) == 0.0
    assert published(2.0, 2.0, RATE, inserted=False) == 1.0
    assert published(2.1, 2.0, RATE, inserted=True) == pytest.approx(1.0 - math.exp(-1.2))
    assert published(2.1, 2.0, RATE, inserted=False) == pytest.approx(math.exp(-1.2))
    # it solves one lag, ρ' = μ (target − ρ)
    h = 1e-6
    slope = (
        published(0.3 + h, 0, RATE, inserted=True) - published(0.3, 0, RATE, inserted=True)
    ) / h
    assert slope == pytest.approx(RATE * (1.0 - published(0.3, 0, RATE, inserted=True)), rel=1e-4)
    # inserted at 0 and removed at 0.05: what it was is forgotten, the gain jumps up to 1
    jump = published(0.05, 0.05, RATE, inserted=False) - published(0.05, 0.0, RATE, inserted=True)
    assert jump == pytest.approx(math.exp(-0.6))
