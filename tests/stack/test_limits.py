"""The limit filter: limits kept whatever is demanded, and what it did said truly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from stack.joints import DEMANDS, Joints, demand, joints, some_joints, somewhere
from stack.problems import directions, seeded
from wbc.stack.limits import NOT_LIMITED, Limited, stuck

TICKS = 500


def check_report(limits, q, last, main, total, out, done):  # type: ignore[no-untyped-def]
    """The command is what the shares say, and the joint named is the one that bound."""
    low, high = limits.bounds(q)
    assert (low <= 0.0).all() and (high >= 0.0).all()
    for share in (done.main, done.secondary, done.change):
        assert 0.0 <= share <= 1.0
    if done == NOT_LIMITED:
        np.testing.assert_allclose(out, total, atol=2e-9, rtol=2e-9)
        return
    if done.clipped:
        return
    aim = done.main * main + done.secondary * (total - main)
    said = last + done.change * (aim - last)
    size = 1.0 + np.abs(aim).max() + np.abs(main).max() + np.abs(total).max()
    np.testing.assert_allclose(out, said, atol=4e-9 * size)
    j = done.joint
    assert j >= 0
    if done.change < 1.0:
        assert abs(out[j] - last[j]) == pytest.approx(
            limits.acceleration[j] * limits.dt, abs=4e-9 * size
        )
    else:
        assert min(abs(out[j] - low[j]), abs(out[j] - high[j])) < 4e-9 * size


@settings(max_examples=30, deadline=None)
@given(limits=some_joints(), kind=st.sampled_from(DEMANDS), seed=st.integers(0, 2**32 - 1))
def test_from_rest_inside_all_limits_are_kept_whatever_is_demanded(limits, kind, seed):
    rng = np.random.default_rng(seed)
    q, last = somewhere(limits, rng), np.zeros(limits.n)
    for k in range(TICKS):
        total = demand(kind, k, rng, limits)
        main = total * rng.choice([0.0, 0.3, 1.0]) + 0.1 * rng.normal(size=limits.n)
        out, done = limits.command(q, last, main, total)
        assert np.isfinite(out).all()
        check_report(limits, q, last, main, total, out, done)
        assert (np.abs(out) <= limits.velocity).all()
        assert (np.abs(out - last) <= limits.acceleration * limits.dt * (1 + 1e-9) + 1e-8).all()
        q, last = q + limits.dt * out, out
        assert (q <= limits.upper + 1e-9).all() and (q >= limits.lower - 1e-9).all()


@settings(max_examples=30, deadline=None)
@given(limits=some_joints(), kind=st.sampled_from(DEMANDS), seed=st.integers(0, 2**32 - 1))
def test_from_any_state_positions_and_velocities_come_first(limits, kind, seed):
    """Too fast, too close, beyond: the acceleration gives way, and no joint goes further out."""
    rng = np.random.default_rng(seed)
    q = somewhere(limits, rng) + rng.choice([0.0, -0.3, 0.3], limits.n)
    last = rng.uniform(-1.5, 1.5, limits.n) * limits.velocity
    for k in range(TICKS):
        total = demand(kind, k, rng, limits)
        out, done = limits.command(q, last, 0.5 * total, total)
        assert np.isfinite(out).all()
        check_report(limits, q, last, 0.5 * total, total, out, done)
        assert (np.abs(out) <= limits.velocity).all()
        low, high = np.minimum(limits.lower, q), np.maximum(limits.upper, q)
        q, last = q + limits.dt * out, out
        assert (q <= high + 1e-9).all() and (q >= low - 1e-9).all()


def braking_distance(v: float, a: float, dt: float) -> float:
    """Way of a joint that moves at v for a tick and slows by a dt at each of the next."""
    way = 0.0
    while v > 0.0:
        way += v * dt
        v -= a * dt
    return way


@pytest.mark.parametrize("dt", [1e-3, 0.1])
@pytest.mark.parametrize("a", [0.5, 40.0])
def test_bound_on_the_velocity_is_the_braking_distance_to_the_tick(a, dt):
    """Neither less (the joint would have to brake harder) nor more room than is needed."""
    for steps in np.concatenate([np.geomspace(1e-3, 300.0, 60), [1.0, 3.0, 6.0, 2.999999]]):
        room = steps * a * dt * dt
        limits = joints(span=room, velocity=np.inf, acceleration=a, dt=dt)
        low, high = limits.bounds(np.zeros(1))
        assert braking_distance(high[0], a, dt) == pytest.approx(room, rel=1e-9)
        assert low[0] == -high[0]


def test_bounds_without_an_acceleration_limit_and_without_a_position_limit():
    low, high = joints(span=0.01, velocity=50.0, acceleration=np.inf).bounds(np.array([0.004]))
    assert (low[0], high[0]) == (pytest.approx(-7.0), pytest.approx(3.0))
    for a in (10.0, np.inf):
        low, high = joints(span=np.inf, acceleration=a).bounds(np.zeros(1))
        assert (low[0], high[0]) == (-2.0, 2.0)
    low, high = joints(acceleration=0.0).bounds(np.zeros(1))
    assert (low[0], high[0]) == (0.0, 0.0)


@pytest.mark.parametrize("a", [3.0, 30.0, np.inf])
def test_a_joint_driven_at_its_limit_gets_there_in_the_shortest_time_and_stops(a):
    limits = joints(acceleration=a)
    q, last, ticks = np.array([-1.0]), np.zeros(1), 0
    while q[0] < 1.0 - 1e-6:
        last, _ = limits.command(q, last, np.full(1, 99.0), np.full(1, 99.0))
        q, ticks = q + limits.dt * last, ticks + 1
        assert ticks < 2000
    way, v, shortest = 2.0, 2.0, 0.0
    if np.isfinite(a):
        peak = min(v, np.sqrt(a * way))
        shortest = 2.0 * peak / a + (way - peak * peak / a) / peak
    else:
        shortest = way / v
    assert ticks * limits.dt < shortest + 6 * limits.dt
    for _ in range(10):
        last, _ = limits.command(q, last, np.full(1, 99.0), np.full(1, 99.0))
        q = q + limits.dt * last
    assert q[0] == pytest.approx(1.0, abs=1e-9)
    assert abs(last[0]) < 1e-6


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("a", [5.0, np.inf])
def test_a_start_beyond_a_limit_never_goes_further_and_returns_when_asked_to(side, a):
    limits = joints(acceleration=a)
    q, last = np.array([1.2 * side]), np.array([1.0 * side])
    out, done = limits.command(q, last, last, last)
    assert out[0] == 0.0
    assert done.main == 0.0 or done.clipped
    for k in range(TICKS):
        wanted = np.array([-0.7 * side if k > 50 else 5.0 * side])
        out, _ = limits.command(q, out, wanted, wanted)
        before, q = q, q + limits.dt * out
        assert abs(q[0]) <= abs(before[0]) or abs(q[0]) <= 1.0 + 1e-9
    assert abs(q[0]) < 1.0


def test_direction_of_the_main_task_is_kept():
    """Whatever is cut, the main task sees its own velocity, slowed: J out = share · J v_main."""
    rng = seeded("direction")
    limits = joints(6, span=3.0, velocity=1.0, acceleration=np.inf)
    base = directions(rng, 6, 6)
    rows = rng.normal(size=(2, 2)) @ base[:2]
    seen = set()
    for _ in range(300):
        main = rng.uniform(0.1, 3.0) * rng.normal(size=2) @ base[:2]
        total = main + rng.uniform(0.0, 3.0) * rng.normal(size=4) @ base[2:]
        out, done = limits.command(np.zeros(6), np.zeros(6), main, total)
        assert not done.clipped
        np.testing.assert_allclose(rows @ out, done.main * (rows @ main), atol=1e-8)
        if done.main < 1.0:
            assert done.secondary == 0.0
        seen.add((done.main < 1.0, 0.0 < done.secondary < 1.0))
    assert seen == {(False, False), (False, True), (True, False)}


def test_shares_are_the_largest_that_fit():
    limits = joints(2, span=10.0, velocity=1.0, acceleration=np.inf)
    q, rest = np.zeros(2), np.zeros(2)

    def shares(main: list[float], total: list[float]) -> tuple[float, float, float, int]:
        done = limits.command(q, rest, np.array(main), np.array(total))[1]
        return done.main, done.secondary, done.change, done.joint

    assert shares([0.5, 0.0], [0.5, 1.0]) == (1.0, 1.0, 1.0, -1)
    assert shares([0.5, 0.0], [0.5, -4.0]) == (1.0, 0.25, 1.0, 1)
    assert shares([-2.0, 0.5], [0.0, 4.0]) == (0.5, 0.0, 1.0, 0)
    # a secondary motion that brings the main task inside its limits is not held against it
    assert shares([1.5, 0.0], [0.5, 0.0]) == (1.0, 1.0, 1.0, -1)


def test_a_change_faster_than_the_acceleration_is_made_in_proportion():
    limits = joints(3, span=10.0, velocity=5.0, acceleration=10.0, dt=0.01)
    last, wanted = np.array([0.3, -0.2, 0.0]), np.array([0.7, -0.3, 0.05])
    out, done = limits.command(np.zeros(3), last, wanted, wanted)
    assert done == Limited(1.0, 1.0, pytest.approx(0.25), False, 0)
    np.testing.assert_allclose(out, last + 0.25 * (wanted - last))


def test_a_joint_that_must_brake_now_is_clipped_and_the_others_are_not():
    """It cannot wait for the others: the direction of the main task is lost, and that is said."""
    limits = joints(2, span=1.0, velocity=5.0, acceleration=10.0, dt=0.01)
    q = np.array([0.95, 0.0])
    last = np.array([limits.bounds(q - 0.01)[1][0], 0.0])
    wanted = np.array([0.0, 3.0])
    out, done = limits.command(q, last, wanted, wanted)
    assert done.clipped and done.joint == 0
    assert out[0] == limits.bounds(q)[1][0]
    assert out[1] == pytest.approx(0.1)


def test_a_velocity_limit_of_zero_locks_a_joint():
    velocity = np.array([1.0, 0.0, 1.0])
    limits = Joints(np.full(3, -1.0), np.full(3, 1.0), velocity, np.full(3, np.inf), 2e-3)
    main, more, rest = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.3, 0.2]), np.zeros(3)
    # only the secondary motion would move it: that goes, the main task stays
    out, done = limits.command(rest, rest, main, main + more)
    np.testing.assert_array_equal(out, main)
    assert (done.main, done.secondary, done.joint) == (1.0, 0.0, 1)
    # the main task would move it: it cannot be done
    out, done = limits.command(rest, rest, main + more, main + more)
    np.testing.assert_array_equal(out, 0.0)
    assert (done.main, done.joint) == (0.0, 1)


@pytest.mark.parametrize("where", ["locked", "at its bound"])
def test_a_rounding_error_of_one_joint_does_not_stop_the_others(where):
    velocity = np.array([1.0, 0.0 if where == "locked" else 1.0])
    limits = Joints(np.full(2, -1.0), np.full(2, 1.0), velocity, np.full(2, 20.0), 2e-3)
    q = np.array([0.0, 0.0 if where == "locked" else 1.0])
    wanted = np.array([0.03, 1e-16])
    out, done = limits.command(q, np.zeros(2), wanted, wanted)
    assert done == NOT_LIMITED
    np.testing.assert_array_equal(out, [0.03, 0.0])


@settings(max_examples=100, deadline=None)
@given(limits=some_joints(), seed=st.integers(0, 2**32 - 1))
def test_what_fits_passes_unchanged(limits, seed):
    rng = np.random.default_rng(seed)
    q = somewhere(limits, rng)
    low, high = limits.bounds(q)
    assume(np.isfinite(high).all())
    last = low + rng.random(limits.n) * (high - low)
    near = np.clip(
        last + rng.uniform(-1, 1, limits.n) * np.minimum(limits.acceleration, 1e3) * limits.dt,
        low,
        high,
    )
    out, done = limits.command(q, last, rng.random() * near, near)
    assert done == NOT_LIMITED
    np.testing.assert_allclose(out, near, rtol=1e-15)


def test_nothing_but_the_command_is_written():
    limits = joints(2)
    main, total, last, q = (np.array([3.0, -1.0]) * s for s in (1.0, 2.0, 0.1, 0.2))
    copies = [x.copy() for x in (main, total, last, q)]
    limits.command(q, last, main, total)
    for x, copy in zip((main, total, last, q), copies, strict=True):
        np.testing.assert_array_equal(x, copy)


def test_a_small_velocity_limit_is_not_a_position_limit():
    """Slower than one tick's braking and far from its limits: a joint is not stuck for that."""
    position, wide, one = np.zeros(2), np.full(2, np.inf), np.ones(2)
    for velocity, fixed in ((1e-3, False), (0.0, True)):
        free = one.copy()
        found = stuck(position, 5.0 * one, -one, one, velocity * one, 60.0 * one, 2e-3, free)
        assert found == fixed and (free == float(not fixed)).all()
    for room, fixed in ((2e-4, True), (0.0, True), (3e-4, False)):
        free = one.copy()
        limits = np.array([room, np.inf])
        found = stuck(position, 5.0 * one, -limits, limits, 1e-3 * one, 60.0 * one, 2e-3, free)
        assert found == fixed and free.tolist() == [float(not fixed), 1.0]
    assert not stuck(position, one, -wide, wide, one, wide, 2e-3, one.copy())
