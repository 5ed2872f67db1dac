"""(21): the first point of a tick from the forces of the one before."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.arrays import Array
from wbc.forces import POINT, SOFT_FINGER, ForceStatus
from wbc.forces.cost import balance_error, cone_margins, torque_margins
from wbc.forces.flow_kernels import assemble, fixed, lifting, tick
from wbc.forces.flows import track
from wbc.forces.initial_point import between, initial_point

from . import reference
from .problems import pouring, two_hands


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_reaches_the_new_wrench_at_once_on_slow_ticks(model: str) -> None:
    ticks = list(pouring(model))[300:302]
    c = reference.optimum(ticks[0])
    found = initial_point(*(ticks[0], c, ticks[1]))
    assert found.gamma == 1.0
    assert balance_error(ticks[1], found.c) < 1e-12
    assert cone_margins(ticks[1], found.c).min() > 0.0
    assert torque_margins(ticks[1], found.c).min() > 0.0
    # the same internal forces: what G^# adds is all that changes
    change = (found.c - c) / ticks[1].scale
    g = ticks[1].G * ticks[1].scale
    rows = np.repeat([1.0, 1.0 / fixed(ticks[1]).arm], 3)[:, None]
    np.testing.assert_allclose(
        np.linalg.pinv(rows * g) @ (rows * g) @ change, change, atol=1e-9 * abs(change).max()
    )


@pytest.mark.parametrize("weighted", [False, True])
def test_returns_the_last_forces_at_gamma_0(weighted: bool) -> None:
    """Mended (21) does; as printed it does not, as soon as G changes or the inverse is weighted."""
    ticks = list(pouring())[300:320:19]
    previous, problem = ticks
    c = reference.optimum(previous)
    weight = np.repeat([1.0, 3.0], 15) if weighted else np.ones(30)

    def sharp(g: Array) -> Array:
        inverse: Array = (g / weight).T @ np.linalg.inv((g / weight) @ g.T)
        return inverse

    old, new = previous.G * previous.scale, problem.G * problem.scale
    u = c / problem.scale
    plain = np.linalg.pinv(new)
    printed = u - plain @ new @ u + sharp(old) @ previous.h_e
    assert abs(printed - u).max() > 1e-3
    same = u - sharp(new) @ new @ u + sharp(new) @ (new @ u)
    np.testing.assert_allclose(same, u, atol=1e-12)
    # and the limits at γ = 0 are those that c kept
    fix = fixed(problem)
    rows = between(assemble(fix, tick(previous)), assemble(fix, tick(problem)), 0.0)
    slack = rows.b @ u + rows.free
    lower = len(problem.limited)
    tau = previous.J.T @ c + previous.tau_e
    np.testing.assert_allclose(slack[:lower], (tau - previous.tau_min)[problem.limited])


@pytest.mark.parametrize("weighted", [False, True])
def test_a_point_on_the_way_supplies_what_gamma_says(weighted: bool) -> None:
    """Where the jump is too large: G c = γ h_e + (1 − γ) G c_{k−1}, with G of the new tick."""
    previous, problem = list(pouring())[300:320:19]
    c = reference.optimum(previous)
    wanted = problem.with_(h_e=-6.0 * problem.h_e)
    found = initial_point(
        previous, c, wanted, weight=np.repeat([1.0, 3.0], 15) if weighted else None
    )
    assert 0.0 < found.gamma < 1.0
    wrench = found.gamma * wanted.h_e + (1.0 - found.gamma) * wanted.G @ c
    np.testing.assert_allclose(wanted.G @ found.c, wrench, atol=1e-9)


def test_lifting_is_the_weighted_inverse() -> None:
    """(23), its first G transposed: G G^# = I, and cᵀ W_G c is least."""
    problem = two_hands()
    g = problem.G * problem.scale
    weight = np.linspace(1.0, 4.0, problem.size)
    lift = lifting(g, 1.0 / weight)
    np.testing.assert_allclose(g @ lift, np.eye(6), atol=1e-10)
    c = lift @ problem.h_e
    null = np.linalg.svd(g)[2][6:]
    np.testing.assert_allclose(null @ (weight * c), 0.0, atol=1e-9)


@pytest.mark.parametrize("size", [0.25, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("seed", range(5))
def test_survives_a_jump_of_the_wrench(size: float, seed: int) -> None:
    """γ goes from below 1 to 1 while the barrier leads away from the limits that stopped it."""
    rng = np.random.default_rng(seed)
    problem = two_hands(load=1.0)
    c = reference.optimum(problem)
    force, moment = rng.standard_normal(3), rng.standard_normal(3)
    force *= size / np.linalg.norm(force)
    moment *= 0.02 * size / np.linalg.norm(moment)
    jumped = problem.with_(h_e=problem.h_e + np.concatenate([force, moment]))
    if reference.feasible_start(jumped) is None:
        pytest.skip("not feasible")
    first = initial_point(problem, c, jumped)
    assert 0.0 < first.gamma <= 1.0
    assert size < 2.0 or first.gamma < 1.0
    there = problem.h_e + first.gamma * (jumped.h_e - problem.h_e)
    np.testing.assert_allclose(problem.G @ first.c, there, atol=1e-9)
    assert cone_margins(jumped, first.c).min() > 0.0
    assert torque_margins(jumped, first.c).min() > 0.0
    found = track(problem, c, jumped)
    assert found.status is ForceStatus.SOLVED and found.balance < 1e-9


def test_says_so_where_there_is_no_way() -> None:
    problem = two_hands(load=1.0)
    c = reference.optimum(problem)
    heavy = problem.with_(h_e=30.0 * problem.h_e)
    first = initial_point(problem, c, heavy)
    assert 0.0 < first.gamma < 1.0
    assert track(problem, c, heavy, most=100).status is ForceStatus.NOT_BALANCED
    # forces outside the limits are no start
    assert track(problem, 50.0 * c, problem).status is ForceStatus.STALE_START
