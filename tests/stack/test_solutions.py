"""What the solve returns: against explicit null spaces, optimality conditions, gains and bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stack.problems import (
    EXACT,
    Level,
    conditioned,
    directions,
    level,
    lexicographic,
    make_stack,
    null_space,
    random_levels,
    seeded,
    solve,
)

N = 14
SIZES = [(1,), (3,), (1, 1, 1, 1), (2, 3), (1, 3, 1, 2), (3, 1, 1, 3, 1)]


def separated(rng, sizes, main_rows=3, shared=0):  # type: ignore[no-untyped-def]
    """A stack whose levels keep at least half of each row; `shared` rows lie wholly in those above.

    Returns the stack and the rows that conflict.
    """
    base = directions(rng, N, N)
    main = Level(
        conditioned(rng, main_rows, main_rows, 20.0) @ base[:main_rows], np.ones(main_rows)
    )
    levels, used = [], main_rows
    for m in sizes:
        rows = np.eye(m) @ base[used : used + m] + 0.5 * rng.uniform(-1, 1, (m, used)) @ base[
            :used
        ] / max(used, 1)
        used += m
        levels.append(level(conditioned(rng, m, m, 1.5) @ rows, rng.normal(size=m)))
    for k in range(shared):
        above = np.vstack([main.rows] + [x.rows for x in levels[: k + 1]])
        inside = rng.normal(size=len(above)) @ above
        both = np.vstack([levels[k + 1].rows, inside])
        levels[k + 1] = level(both, rng.normal(size=len(both)))
    return make_stack(N, levels, main, rng.normal(size=N))


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("main_rows", [0, 1, 3])
def test_separated_levels_are_solved_in_order_of_priority(sizes, main_rows):
    rng = seeded("separated", sizes, main_rows)
    for _ in range(5):
        stack = separated(rng, sizes, main_rows)
        np.testing.assert_allclose(solve(stack).v, lexicographic(stack), atol=1e-10)


@pytest.mark.parametrize("sizes", [(1, 1, 1), (2, 3), (3, 2, 1)])
def test_a_level_partly_taken_leaves_the_least_error_in_its_own_units(sizes):
    """Rows inside those above cannot be served; least squares in the task's units says what is."""
    rng = seeded("shared", sizes)
    for _ in range(5):
        stack = separated(rng, sizes, shared=len(sizes) - 1)
        found = solve(stack)
        assert (found.freedom[1:] == 0.0).all()
        np.testing.assert_allclose(found.v, lexicographic(stack), atol=1e-9)


@pytest.mark.parametrize("shared", [0, 1, 2])
def test_optimality_of_each_level(shared):
    """J_hᵀ (J_h v − r_h) lies in the rows above: no motion they leave free lowers the error."""
    rng = seeded("kkt", shared)
    stack = separated(rng, (2, 3, 2), shared=shared)
    v = solve(stack).v
    above = stack.main.rows
    np.testing.assert_allclose(above @ v, stack.main.rhs, atol=1e-12)
    for x in stack.levels:
        free = null_space(above)
        np.testing.assert_allclose(free.T @ x.rows.T @ (x.rows @ v - x.rhs), 0.0, atol=1e-10)
        above = np.vstack([above, x.rows])
    # the rest descends the gradient, and nothing else moves in the null space of all
    free = null_space(above)
    np.testing.assert_allclose(free.T @ (v + stack.gradient), 0.0, atol=1e-10)


def test_main_task_is_the_weighted_pseudo_inverse():
    """Rows divided by √W, v divided by it: J†_W b = W⁻¹ Jᵀ (J W⁻¹ Jᵀ)⁻¹ b of (35)."""
    rng = seeded("weighted")
    for _ in range(10):
        rows, rhs = rng.normal(size=(5, N)), rng.normal(size=5)
        metric = 10.0 ** rng.uniform(-2, 2, N)
        scale = 1.0 / np.sqrt(metric)
        found = solve(make_stack(N, [], Level(rows * scale, rhs))).main * scale
        wanted = (rows / metric).T @ np.linalg.solve((rows / metric) @ rows.T, rhs)
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
        # least in the metric: W v is a combination of the rows
        free = null_space(rows)
        np.testing.assert_allclose(free.T @ (metric * found), 0.0, atol=1e-10)


def test_whole_law_in_a_metric():
    rng = seeded("law in a metric")
    stack = separated(rng, (1, 2))
    scale = rng.uniform(0.3, 3.0, N)
    scaled = replace(
        stack,
        main=replace(stack.main, rows=stack.main.rows * scale),
        levels=tuple(replace(x, rows=x.rows * scale) for x in stack.levels),
        gradient=stack.gradient * scale,
    )
    v = solve(scaled).v * scale
    for x in (stack.main, *stack.levels):
        np.testing.assert_allclose(x.rows @ v, x.rhs, atol=1e-10)
    assert stack.gradient @ (v - solve(replace(scaled, gradient=np.zeros(N))).v * scale) < 0.0


@pytest.mark.parametrize("free", [1.0, 0.5, EXACT * (1 + 1e-9)])
@pytest.mark.parametrize("m", [1, 2, 4])
def test_gain_is_exact_down_to_the_promised_share(free, m):
    """A level that keeps `exact` of each row's squared length gets its whole rhs."""
    rng = seeded("gain", free, m)
    base = directions(rng, 2 * m, N)
    rows = np.sqrt(1.0 - free) * base[:m] + np.sqrt(free) * base[m:]
    mix = np.linalg.qr(rng.normal(size=(m, m)))[0]
    stack = make_stack(
        N, [level(base[:m], rng.normal(size=m)), level(mix @ rows, np.arange(m) - 1.7)]
    )
    np.testing.assert_allclose(mix @ rows @ solve(stack).v, np.arange(m) - 1.7, atol=1e-12)


@pytest.mark.parametrize("condition", [1.0, 3.0, 10.0, 30.0, 90.0])
@pytest.mark.parametrize("m", [2, 3, 6])
def test_gain_of_a_block_is_exact_whatever_its_own_condition(condition, m):
    """Rows of unequal length or nearly parallel to each other are no conflict with levels above."""
    rng = seeded("block", condition, m)
    base = directions(rng, m + 3, N)
    rows = conditioned(rng, m, m, condition) @ base[3:]
    stack = make_stack(N, [level(rows, rng.normal(size=m))], level(base[:3], 1.0))
    found = solve(stack)
    np.testing.assert_allclose(rows @ found.v, stack.levels[0].rhs, atol=1e-10)
    assert found.freedom[0] == 1.0


@pytest.mark.parametrize("gain", [0.5, 5.0, 20.0])
def test_errors_decay_at_exactly_their_gain(gain):
    """ė = −K e at every level, of linear tasks e = σ_d − J q: e(t + dt) = (1 − K dt) e(t)."""
    rng = seeded("decay", gain)
    stack, dt, q = separated(rng, (1, 2, 3)), 1e-3, np.zeros(N)
    goals = [rng.normal(size=len(x.rhs)) for x in stack.levels]
    errors = [[g - x.rows @ q for g, x in zip(goals, stack.levels, strict=True)]]
    for _ in range(50):
        now = replace(
            stack,
            levels=tuple(
                replace(x, rhs=gain * e) for x, e in zip(stack.levels, errors[-1], strict=True)
            ),
        )
        q = q + dt * solve(now).v
        errors.append([g - x.rows @ q for g, x in zip(goals, stack.levels, strict=True)])
    for first, last in zip(errors[0], errors[-1], strict=True):
        np.testing.assert_allclose(last, first * (1.0 - gain * dt) ** 50, rtol=1e-10)


# |v| ≤ BOUND / √exact · |r| / |j| and the same for blocks with their shortest direction: the
# largest √f (2 − f / exact) / exact over the free share f is at f = 2 exact / 3.
BOUND = 4.0 / 3.0 * np.sqrt(2.0 / 3.0)


@pytest.mark.parametrize("exact", [0.3, 0.1, 1e-3])
def test_bound_on_the_speed_of_a_row_is_met_and_not_passed(exact):
    rng = seeded("speed", exact)
    base = directions(rng, 3, N)
    speeds = []
    for free in np.concatenate([np.geomspace(1e-8, 1.0, 400), [2.0 * exact / 3.0]]):
        row = np.sqrt(1.0 - free) * base[0] + np.sqrt(free) * base[1]
        stack = make_stack(N, [level(base[0]), level(3.0 * row, 6.0, exact=exact)])
        speeds.append(np.linalg.norm(solve(stack).v) / 2.0)
    assert max(speeds) == pytest.approx(BOUND / np.sqrt(exact), rel=1e-9)
    assert pytest.approx(1.0887, abs=1e-4) == BOUND


@settings(max_examples=60, deadline=None)
@example(seed=1, m=3, angle=-1.75, condition=2.0, rho=0.999)  # without a bound on the whole step
@given(
    seed=st.integers(0, 2**32 - 1), m=st.integers(1, 4), angle=st.floats(-9.0, 0.0),
    condition=st.floats(0.0, 3.0), rho=st.sampled_from([1.0, 0.999, 0.5, 1e-3]),
)  # fmt: skip
def test_bound_on_the_speed_of_a_block(seed, m, angle, condition, rho):
    """Also below levels that fade: |Δv| ≤ 1.09 / √exact · |r − J v| / (shortest direction of J).

    Directions shorter than √1e-3 of the longest count as that long.
    """
    rng = np.random.default_rng(seed)
    above = level(directions(rng, m, N), rng.normal(size=m), rho)
    near = rng.normal(size=(m, m)) @ above.rows / np.sqrt(m) + 10.0**angle * rng.normal(size=(m, N))
    near = conditioned(rng, m, m, 10.0**condition) @ near
    here = level(near, rng.normal(size=m))
    before = solve(make_stack(N, [above])).v
    moved = solve(make_stack(N, [above, here])).v - before
    values = np.linalg.svd(near, compute_uv=False)
    shortest = max(values[-1], np.sqrt(1e-3) * values[0] if m > 1 else 0.0)
    missing = np.linalg.norm(here.rhs - near @ before)
    assert np.linalg.norm(moved) <= BOUND / np.sqrt(EXACT) * missing / shortest * (1 + 1e-9)


def test_order_of_rows_in_a_block_and_of_levels_in_memory_do_not_matter():
    rng = seeded("order")
    stack = make_stack(
        N, random_levels(rng, N, (3, 1, 4)), level(rng.normal(size=(2, N)), 1.0),
        rng.normal(size=N),
    )  # fmt: skip
    stack = stack.with_level(0, rho=0.6)
    v = solve(stack).v
    turned = stack
    for k, x in enumerate(stack.levels):
        turn = np.linalg.qr(rng.normal(size=(len(x.rhs), len(x.rhs))))[0]
        turned = turned.with_level(k, rows=turn @ x.rows, rhs=turn @ x.rhs)
    np.testing.assert_allclose(solve(turned).v, v, atol=1e-11)
    shuffled = replace(stack, levels=tuple(stack.levels[k] for k in (2, 0, 1)))
    np.testing.assert_allclose(solve(shuffled, order=(1, 2, 0)).v, v, atol=1e-12)
    # levels left out of the order are absent
    alone = replace(stack, levels=stack.levels[:1])
    np.testing.assert_allclose(solve(stack, order=(0,)).v, solve(alone).v, atol=1e-14)


def test_independent_levels_may_change_places():
    rng = seeded("places")
    base = directions(rng, 6, N)
    levels = [level(base[:2], 1.0), level(base[2:5], -2.0), level(base[5], 3.0)]
    v = solve(make_stack(N, levels)).v
    for order in ((1, 0, 2), (2, 1, 0)):
        np.testing.assert_allclose(solve(make_stack(N, levels), order=order).v, v, atol=1e-13)


def test_not_a_number_never_raises():
    """What to do about it is for the tick to say: the command is not finite."""
    rng = seeded("nan")
    for sizes in ((1,), (3,)):
        for place in ("rows", "rhs"):
            x = random_levels(rng, N, sizes)[0]
            getattr(x, place)[0] = np.nan
            assert not np.isfinite(solve(make_stack(N, [x, *random_levels(rng, N, (2,))])).v).all()
