"""Torque bounds left out of the cost: the choice, its hysteresis, and that nothing breaks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from wbc.forces import ForceStatus, GraspForceProblem
from wbc.forces.cost import cost
from wbc.forces.flows import track
from wbc.forces.selection import active_after, select, track_selected

from . import reference
from .problems import pouring, two_hands


def test_threshold() -> None:
    problem = two_hands()
    tau = np.zeros(problem.joints)
    tau[:4] = np.array([0.0, 0.49, -0.51, 0.81]) * problem.tau_max[:4]
    lower, upper = select(problem, tau, 0.5).reshape(2, -1)
    assert not lower[:2].any() and lower[2] and not lower[3]
    assert upper[:4].tolist() == [False, False, False, True]
    # σ = 0: one of the two, so half as many
    tau = problem.tau_max * np.random.default_rng(0).uniform(-1, 1, problem.joints)
    lower, upper = select(problem, tau, 0.0).reshape(2, -1)
    np.testing.assert_array_equal(upper, tau > 0.0)
    np.testing.assert_array_equal(lower, tau < 0.0)


def test_limits_that_are_not_symmetric() -> None:
    problem = two_hands()
    uneven = problem.with_(tau_min=np.full(30, -0.2), tau_max=np.full(30, 0.6))
    tau = np.full(30, 0.45)  # 0.25 of 0.4 from the middle
    lower, upper = select(uneven, tau, 0.6).reshape(2, -1)
    assert upper.all() and not lower.any()


def test_joints_without_limits_have_no_bounds() -> None:
    problem = two_hands(arms=2)
    free = np.arange(problem.joints) >= 30
    some = problem.with_(
        tau_min=np.where(free, -np.inf, problem.tau_min),
        tau_max=np.where(free, np.inf, problem.tau_max),
    )
    assert select(some, np.full(34, 100.0), 0.5).shape == (60,)


def test_hysteresis_does_not_chatter() -> None:
    """A torque that hovers about the threshold switches its bound once, without the band often."""
    problem = two_hands()
    noise = 0.04 * np.random.default_rng(0).uniform(-1, 1, 400)
    for band, most in ((0.1, 1), (0.0, 400)):
        active, history = None, []
        for wave in noise:
            active = select(problem, (0.8 + wave) * problem.tau_max, 0.8, active, band)
            history.append(active[30])
        switches = sum(a != b for a, b in pairwise(history))
        assert switches <= most
        assert band > 0.0 or switches > 100
    # and it is dropped when the torque has left the band
    assert not select(problem, 0.69 * problem.tau_max, 0.8, active, 0.1).any()


@pytest.mark.parametrize("sigma", [0.0, 0.5, 0.8])
def test_tracks_and_breaks_nothing(sigma: float) -> None:
    ticks = list(pouring(load=1.4, dt=0.01))
    c = reference.optimum(ticks[0])
    full = c
    active = None
    counts, worst = [], 0.0
    for before, now in pairwise(ticks):
        active = active_after(before, c, sigma, active)
        found = track_selected(before, c, now, active)
        assert found.solution.status is ForceStatus.SOLVED
        assert found.solution.min_torque_margin > 0.0 and found.solution.min_cone_margin > 0.0
        assert found.solution.balance < 1e-9
        assert (found.active >= active).all()
        c, active = found.solution.c, found.active
        full = track(before, full, now).c
        counts.append(active.sum())
        worst = max(worst, cost(now, c) / cost(now, full) - 1.0)
    # far fewer bounds for the same forces
    assert np.mean(counts) < {0.0: 40, 0.5: 15, 0.8: 6}[sigma]
    assert worst < 0.1


def test_a_bound_left_out_that_breaks_is_put_back() -> None:
    problem = two_hands(load=1.0)
    tight = _tightened(problem)
    start = reference.feasible_start(tight)
    assert start is not None
    none = np.zeros(60, dtype=np.bool_)
    found = track_selected(tight, start, tight, none, tolerance=1e-8)
    assert found.rounds > 1 and found.active.any() and not found.active.all()
    assert found.solution.status is ForceStatus.SOLVED
    assert found.solution.min_torque_margin > 0.0
    # all bounds from the start: the plain flow
    every = track_selected(tight, start, tight, ~none)
    assert every.rounds == 1
    np.testing.assert_array_equal(every.solution.c, track(tight, start, tight).c)


def _tightened(problem: GraspForceProblem) -> GraspForceProblem:
    """Limits that the optimum without limits breaks, but some forces keep."""
    free = problem.with_(tau_min=np.full(30, -np.inf), tau_max=np.full(30, np.inf))
    tau = problem.J.T @ reference.optimum(free) + problem.tau_e
    for fraction in np.linspace(0.7, 0.99, 30):
        limit = np.where(abs(tau) > 0.5 * abs(tau).max(), fraction * abs(tau), problem.tau_max)
        tight = problem.with_(tau_min=-limit, tau_max=limit)
        if reference.feasible_start(tight) is not None:
            return tight
    raise AssertionError
