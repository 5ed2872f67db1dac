"""The main task: exact while its rows are independent, bounded and reported where they are not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stack.problems import (
    Level,
    conditioned,
    directions,
    level,
    make_stack,
    projector,
    seeded,
    solve,
)

N = 12
NEAR = 1e-3  # independent share of a row's length below which its inverse is damped
WORST = 1.31e3  # and the most by which that row then drives the joints faster than alone


def at_share(rng: np.random.Generator, share: float, m: int = 3) -> np.ndarray:
    """m rows, all independent but the last, which keeps `share` of its length, [1]."""
    base = directions(rng, m, N)
    mix = np.linalg.qr(rng.normal(size=(m - 1, m - 1)))[0]
    inside = mix[0] @ base[: m - 1]
    return np.vstack([base[: m - 1], np.sqrt(1.0 - share**2) * inside + share * base[m - 1]])


@pytest.mark.parametrize("share", [1.0, 1e-1, 1e-2, 1.001e-3])
def test_never_damped_while_independent(share):
    rng = seeded("independent", share)
    for scale in (1e-3, 1.0, 1e3):
        rows, rhs = at_share(rng, share) * scale, rng.normal(size=3)
        found = solve(make_stack(N, [], Level(rows, rhs)))
        np.testing.assert_allclose(rows @ found.main, rhs, atol=1e-12 / share)
        assert found.rank == 3
        assert found.independence == pytest.approx(share, rel=1e-9)
        np.testing.assert_allclose(
            found.main,
            np.linalg.pinv(rows, rcond=1e-14) @ rhs,
            rtol=1e-9,
            atol=1e-10 / scale / share,
        )


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), power=st.floats(-17.0, 0.0), size=st.floats(-3.0, 3.0))
def test_bounded_and_reported_near_a_rank_loss(seed, power, size):
    rng = np.random.default_rng(seed)
    share, scale = 10.0**power, 10.0**size
    rows, rhs = at_share(rng, share) * scale, rng.normal(size=3)
    found = solve(make_stack(N, [], Level(rows, rhs)))
    before = solve(make_stack(N, [], Level(rows[:2], rhs[:2]))).main
    missing = abs(rhs[2] - rows[2] @ before)
    assert np.linalg.norm(found.main - before) <= WORST * missing / scale
    assert found.independence == pytest.approx(share, rel=1e-3, abs=3e-16)
    np.testing.assert_allclose(rows[:2] @ found.main, rhs[:2], atol=1e-12)  # the others keep theirs


def test_the_bound_is_met():
    rng = seeded("met")
    speeds = []
    for share in np.linspace(0.5 * NEAR, NEAR, 200):
        rows = at_share(rng, share)
        speeds.append(
            np.linalg.norm(solve(make_stack(N, [], Level(rows, np.array([0, 0, 1.0])))).main)
        )
    assert 0.995 * WORST < max(speeds) <= WORST


@pytest.mark.parametrize("share", [1.0, 1e-2, 5e-4, 1e-5, 1e-7, 2e-9])
def test_projector_never_leaks_even_where_the_inverse_is_damped(share):
    """J N = 0 to rounding: the inverse is damped, the projector is not."""
    rng = seeded("leak", share)
    rows = at_share(rng, share)
    levels = [level(rng.normal(size=(2, N)), 1e3), level(rows[2] + 1e-6 * rng.normal(size=N), 1e3)]
    stack = make_stack(N, levels, Level(rows, rng.normal(size=3)), 1e3 * rng.normal(size=N))
    assert np.abs(rows @ projector(stack)).max() < 1e-13
    found = solve(stack)
    secondary = found.v - found.main
    assert np.abs(rows @ secondary).max() < 1e-12 * np.linalg.norm(secondary)
    assert np.trace(projector(make_stack(N, [], stack.main))) == pytest.approx(N - 3, abs=1e-10)


@pytest.mark.parametrize("condition", [1e2, 1e6, 1e9])
def test_projector_does_not_leak_for_ill_conditioned_rows(condition):
    rng = seeded("condition", condition)
    rows = conditioned(rng, 6, N, condition)
    stack = make_stack(N, [level(rng.normal(size=(4, N)), 1.0)], Level(rows, rng.normal(size=6)))
    found = solve(stack)
    # rows farther than rounding from the others count; of the rest no more is left than 1e-9
    assert np.abs(rows @ (found.v - found.main)).max() < 1e-9 * np.linalg.norm(found.v - found.main)
    assert np.linalg.norm(found.main) < WORST**6


def test_continuous_through_a_rank_loss():
    """The last row passes through the span of the others: what it asked for fades and comes back.

    Within 1e-9 of it the row drops out; that step is below 1e-3 of what the row alone would do.
    """
    rng = seeded("through")
    base = directions(rng, 3, N)

    def main(share: float) -> np.ndarray:
        rows = np.vstack([base[:2], base[0] + share * base[2]])
        return solve(make_stack(N, [], Level(rows, np.array([1.0, -2.0, 1.7])))).main

    places = np.linspace(-2 * NEAR, 2 * NEAR, 4001)
    values = np.array([main(s) for s in places])
    steps = np.linalg.norm(np.diff(values, axis=0), axis=1)
    assert steps.max() < 4e6 * (places[1] - places[0]) * 0.7  # Lipschitz: 1.3e3 within 1e-3
    for side in (1.0, -1.0):
        step = np.linalg.norm(main(side * 1.01e-9) - main(side * 0.99e-9))
        assert step < 1e-3 * 0.75
    np.testing.assert_allclose(main(1e-12), [*base[:2].T @ [1.0, -2.0]], atol=1e-12)


def test_lower_levels_do_not_feel_the_main_task_pass_through_a_rank_loss():
    """What it takes there is a direction, and the same one on both sides."""
    rng = seeded("feel")
    base = directions(rng, 4, N)

    def secondary(share: float) -> np.ndarray:
        rows = np.vstack([base[:2], base[0] + share * base[2]])
        x = level(rng_rows, 1.0)
        found = solve(make_stack(N, [x], Level(rows, rows @ base[3])))
        return found.v - found.main

    rng_rows = rng.normal(size=(2, N))
    for share in (1e-4, 1e-6, 1e-8):
        np.testing.assert_allclose(secondary(share), secondary(-share), atol=1e-6)


def test_rows_of_no_length_and_no_rows():
    rng = seeded("none")
    found = solve(make_stack(N, [level(rng.normal(size=(2, N)), 1.0)]))
    assert (found.rank, found.independence) == (0, 1.0)
    np.testing.assert_array_equal(found.main, 0.0)
    rows = np.vstack([np.zeros(N), rng.normal(size=N)])
    found = solve(make_stack(N, [], Level(rows, np.array([5.0, 1.0]))))
    assert (found.rank, found.independence) == (1, 0.0)
    assert rows[1] @ found.main == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_order_of_independent_rows_does_not_matter(seed):
    rng = seeded("rows", seed)
    rows, rhs, turn = rng.normal(size=(5, N)), rng.normal(size=5), rng.permutation(5)
    v = solve(make_stack(N, [], Level(rows, rhs))).main
    np.testing.assert_allclose(
        solve(make_stack(N, [], Level(rows[turn], rhs[turn]))).main, v, atol=1e-12
    )
