"""Strict priority: nothing below a level changes what the level does, however hostile the rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stack.problems import (
    Level,
    Stack,
    conditioned,
    directions,
    level,
    make_stack,
    projector,
    random_levels,
    seeded,
    solve,
)

N = 10
ANGLES = (1e-1, 1.2e-2, 5e-3, 1e-3, 1e-4, 1e-6, 1e-8, 0.0)

# A row whose direction counts as taken in part (φ < 1) has at most this much of its length free,
# and lower levels may use it: the square root of FULL in the solver.
PARTLY = 1e-2


def nearly_parallel(angle: float) -> Callable[[np.random.Generator], Stack]:
    """Single rows, each at `angle` from one of those above, and a block at it from them all."""

    def build(rng: np.random.Generator) -> Stack:
        base = directions(rng, N, N)
        rows = [base[0], base[1]]
        rows += [rows[k] + angle * base[2 + k] for k in range(2)]
        block = np.array([rows[0] - rows[1], rows[2]]) + angle * base[5:7]
        levels = [level(row, rng.normal()) for row in rows] + [level(block, rng.normal(size=2))]
        return make_stack(N, levels, level(base[8:9] + base[0], 0.3))

    return build


def chain(rng: np.random.Generator) -> Stack:
    """Each row nearly along what the one before it took: rounding errors multiply if let."""
    base = directions(rng, N, N)
    rows = [base[0]] + [base[k] + 1.2e-2 * base[k + 1] for k in range(N - 2)]
    return make_stack(N, [level(row, rng.normal()) for row in rows])


def ill_conditioned(rng: np.random.Generator) -> Stack:
    main = Level(conditioned(rng, 4, N, 1e7), rng.normal(size=4))
    blocks = [level(conditioned(rng, 3, N, c), rng.normal(size=3)) for c in (10.0, 1e5)]
    return make_stack(N, blocks, main)


def rank_deficient(rng: np.random.Generator) -> Stack:
    """Zero rows, repeated rows, empty main task, blocks of rank 1 and 0, a row twice over."""
    row, other = rng.normal(size=(2, N))
    block = np.array([row, row, 2.0 * row])
    half = np.array([other, np.zeros(N), row])
    levels = [level(np.zeros(N), 1.0), level(row, 1.0), level(row, -1.0), level(block, [1, 2, 3])]
    levels += [level(half, 1.0), level(np.zeros((2, N)), 1.0), level(-other, 0.5)]
    return make_stack(N, levels)


def scales(rng: np.random.Generator) -> Stack:
    levels = random_levels(rng, N, (1, 2, 1, 1))
    sized = [
        Level(x.rows * s, x.rhs * s, x.rho)
        for x, s in zip(levels, (1e-5, 1e4, 1e4, 1e-5), strict=True)
    ]
    return make_stack(N, sized, level(rng.normal(size=(2, N)) * 1e3, 1.0))


def ordinary(rng: np.random.Generator) -> Stack:
    main = level(rng.normal(size=(3, N)), rng.normal(size=3))
    return make_stack(N, random_levels(rng, N, (1, 2, 1, 3)), main)


HOSTILE: dict[str, Callable[[np.random.Generator], Stack]] = {
    "ordinary": ordinary,
    "chain": chain,
    "ill conditioned": ill_conditioned,
    "rank deficient": rank_deficient,
    "scales": scales,
    **{f"angle {angle:g}": nearly_parallel(angle) for angle in ANGLES},
}
EACH = pytest.mark.parametrize("name", HOSTILE)


def lower_parts(rng: np.random.Generator, stack: Stack, count: int) -> list[tuple[Level, ...]]:
    """What may stand below the first `count` levels: nothing, its own, strangers, its betters."""
    above = [stack.main, *stack.levels[:count]]
    row = rng.normal(size=N)
    betters = [
        level(x.rows[0] + angle * row, 1e2)
        for x in above
        if len(x.rows)
        for angle in (0.0, 1e-8, 1e-3)
    ]
    return [(), stack.levels[count:], tuple(random_levels(rng, N, (4, 1))), tuple(betters)]


def change_of(rows: np.ndarray, before: np.ndarray, after: np.ndarray) -> float:
    """Largest change of what a row does, of its length times what the joints do."""
    length = np.linalg.norm(rows, axis=1)
    moved = np.abs(rows @ (after - before))[length > 0.0] / length[length > 0.0]
    return float(moved.max(initial=0.0) / (np.linalg.norm(before) + np.linalg.norm(after) + 1e-30))


@EACH
def test_nothing_below_changes_a_level(name):
    rng = seeded("priority", name)
    for _ in range(5):
        stack = HOSTILE[name](rng)
        for count in range(len(stack.levels) + 1):
            top = solve(stack.up_to(count))
            for below in lower_parts(rng, stack, count):
                whole = replace(
                    stack, levels=stack.levels[:count] + below, gradient=rng.normal(size=N)
                )
                found = solve(whole)
                assert np.isfinite(found.v).all()
                assert change_of(stack.main.rows, top.v, found.v) < 1e-12
                np.testing.assert_array_equal(found.freedom[:count], top.freedom)
                for x, phi in zip(stack.levels[:count], top.freedom, strict=True):
                    assert change_of(x.rows, top.v, found.v) < (1e-12 if phi == 1.0 else PARTLY)


@EACH
def test_projector_annihilates_every_level_that_had_its_freedom(name):
    rng = seeded("projector", name)
    stack = HOSTILE[name](rng)
    free = solve(stack).freedom
    n = projector(stack)
    np.testing.assert_allclose(n, n.T, atol=1e-12)
    values = np.linalg.eigvalsh(n)
    assert values.min() > -1e-12 and values.max() < 1.0 + 1e-12
    kept = [x.rows for x, phi in zip(stack.levels, free, strict=True) if phi == 1.0]
    rows = np.vstack([stack.main.rows, *kept])
    lengths = np.linalg.norm(rows, axis=1)
    assert np.abs(rows[lengths > 0] @ n).max() < 1e-12 * lengths.max()


@pytest.mark.parametrize("angle", [9e-3, 7e-3, 5.5e-3, 4e-3, 2e-3])
def test_a_direction_taken_in_part_loses_half_a_percent_at_most(angle):
    """The figure beside CUT and FULL: of what a lower level could do alone, at the worst angle."""
    e = np.eye(4)
    stack = make_stack(4, [level(e[0]), level(np.cos(angle) * e[0] + np.sin(angle) * e[1])])
    leak = np.linalg.norm(stack.levels[1].rows @ projector(stack))
    assert 0.0 < leak < 5e-3
    assert 0.0 < solve(stack).freedom[1] < 1.0


def test_levels_above_keep_their_rows_while_others_fade():
    """ρ = 1 is strict wherever it stands, also above, between and below levels that fade."""
    rng = seeded("fading")
    for _ in range(20):
        main = level(rng.normal(size=(2, N)), rng.normal(size=2))
        levels = random_levels(rng, N, (1, 1, 2, 1, 1))
        stack = make_stack(N, levels, main, rng.normal(size=N))
        for fading in (0, 2, 3):
            stack = stack.with_level(fading, rho=rng.uniform(0.01, 0.99))
        top, found = solve(stack.up_to(2)), solve(stack)
        assert change_of(main.rows, top.v, found.v) < 1e-12
        assert change_of(levels[1].rows, top.v, found.v) < 1e-12
        rows = np.vstack([main.rows, levels[1].rows, levels[4].rows])
        assert np.abs(rows @ projector(stack)).max() < 1e-11


def test_rows_dependent_to_rounding_take_no_freedom():
    rng = seeded("dependent")
    rows = rng.normal(size=(3, N))
    mixed = rng.normal(size=(5, 3)) @ rows
    main = level(np.vstack([rows, mixed]), np.concatenate([np.ones(3), mixed @ np.zeros(N)]))
    stack = make_stack(N, [level(mixed[0] + rows[1]), level(mixed)], main)
    found = solve(stack)
    assert found.rank == 3
    assert found.independence < 1e-12
    np.testing.assert_array_equal(found.freedom, 0.0)
    assert np.trace(projector(stack)) == pytest.approx(N - 3, abs=1e-9)


def test_more_rows_than_joints():
    rng = seeded("too many")
    main = level(directions(rng, 3, 4), rng.normal(size=3))
    stack = make_stack(4, random_levels(rng, 4, (1, 1, 3, 1)), main, rng.normal(size=4))
    stack = stack.with_level(0, exact=1e-4)
    found = solve(stack)
    np.testing.assert_allclose(found.v, np.linalg.solve(
        np.vstack([main.rows, stack.levels[0].rows]),
        np.concatenate([main.rhs, stack.levels[0].rhs]),
    ), rtol=1e-9)  # fmt: skip
    assert found.freedom[0] == 1.0
    np.testing.assert_array_equal(found.freedom[1:], 0.0)
