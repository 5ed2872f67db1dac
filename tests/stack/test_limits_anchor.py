"""The filter with an anchor: what is cut short is cut where the main task does not feel it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stack.joints import DEMANDS, Joints, demand, joints, some_joints, somewhere
from stack.problems import directions, seeded


def with_main_task(seed: object) -> tuple[Joints, np.ndarray, np.random.Generator]:
    """Six joints far from their position limits, and two orthonormal rows."""
    rng = seeded("anchor", seed)
    return (
        joints(6, span=50.0, velocity=2.0, acceleration=10.0, dt=0.01),
        directions(rng, 2, 6),
        rng,
    )


def test_the_main_task_of_this_tick_is_done_however_short_the_change_is_cut():
    """J last ≠ J v: the way to the anchor mends that first, the rest is in the null space."""
    limits, rows, rng = with_main_task("done")
    cut = 0
    for _ in range(300):
        last = rng.uniform(-1.0, 1.0, 6)
        wanted = rows.T @ (rows @ last + 0.02 * rng.normal(size=2))
        free = np.eye(6) - rows.T @ rows
        total = wanted + free @ rng.uniform(-1.0, 1.0, 6)
        anchor = wanted + free @ last
        out, done, kept = limits.command_from(anchor, np.zeros(6), last, wanted, total)
        if kept < 1.0 or done.main < 1.0:
            continue
        assert not done.clipped
        np.testing.assert_allclose(rows @ out, rows @ total, atol=1e-8)
        cut += done.change < 1.0
        # without the anchor the object pays
        plain, short = limits.command(np.zeros(6), last, wanted, total)
        if short.change < 0.5:
            assert np.abs(rows @ (plain - total)).max() > 1e-4
    assert cut > 100


def test_where_even_the_anchor_is_out_of_reach_the_way_to_it_is_what_counts():
    limits, rows, rng = with_main_task("reach")
    for _ in range(50):
        last = rng.uniform(-1.0, 1.0, 6)
        anchor = last + rows.T @ rng.normal(size=2)
        out, done, kept = limits.command_from(anchor, np.zeros(6), last, anchor, anchor)
        if done.main < 1.0 or kept == 1.0:
            continue
        np.testing.assert_allclose(out, last + kept * (anchor - last), atol=1e-8)
        assert np.abs(out - last).max() == pytest.approx(10.0 * 0.01)
        assert abs(out[done.joint] - last[done.joint]) == pytest.approx(10.0 * 0.01)


def test_anchored_at_the_last_command_it_is_the_plain_filter():
    limits, _, rng = with_main_task("plain")
    for _ in range(50):
        q, last, main, total = (rng.uniform(-1.5, 1.5, 6) for _ in range(4))
        plain, done = limits.command(q, last, main, total)
        out, found, kept = limits.command_from(last, q, last, main, total)
        assert (found, kept) == (done, 1.0)
        np.testing.assert_array_equal(out, plain)


@settings(max_examples=30, deadline=None)
@given(limits=some_joints(), kind=st.sampled_from(DEMANDS), seed=st.integers(0, 2**32 - 1))
def test_wherever_the_anchor_is_all_limits_are_kept(limits, kind, seed):
    rng = np.random.default_rng(seed)
    q, last = somewhere(limits, rng), np.zeros(limits.n)
    for k in range(300):
        total = demand(kind, k, rng, limits)
        anchor = last + rng.choice([0.0, 1e-3, 1.0]) * rng.normal(size=limits.n)
        out, done, kept = limits.command_from(anchor, q, last, 0.4 * total, total)
        assert np.isfinite(out).all()
        assert 0.0 <= kept <= 1.0 and 0.0 <= done.change <= 1.0
        assert (np.abs(out) <= limits.velocity).all()
        assert (np.abs(out - last) <= limits.acceleration * limits.dt * (1 + 1e-9) + 1e-8).all()
        q, last = q + limits.dt * out, out
        assert (q <= limits.upper + 1e-9).all() and (q >= limits.lower - 1e-9).all()
