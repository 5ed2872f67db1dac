"""v is continuous in every gain, in the rows and through every change of rank.

A step is looked for by bisection: of an interval the half over which v changes more is kept, until
its ends are one rounding error apart. What has changed over it then is the step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest

from stack.problems import Level, directions, level, make_stack, random_levels, seeded, solve

N = 9
Path = Callable[[float], np.ndarray]

# of the largest v on the path: what a slope of 1e6 changes over the last interval
STEP = 1e-5


def largest_step(v: Path, samples: int = 120, deepest: int = 42, worst: int = 4) -> float:
    """The largest step of v (n,) over [0, 1], relative to the largest v on the way."""
    places = np.linspace(0.0, 1.0, samples)
    values = [v(s) for s in places]
    assert np.isfinite(values).all()
    changes = [np.linalg.norm(b - a) for a, b in pairwise(values)]
    found = 0.0
    for k in np.argsort(changes)[-worst:]:
        (a, va), (b, vb) = (places[k], values[k]), (places[k + 1], values[k + 1])
        for _ in range(deepest):
            c = 0.5 * (a + b)
            vc = v(c)
            if np.linalg.norm(vc - va) > np.linalg.norm(vb - vc):
                b, vb = c, vc
            else:
                a, va = c, vc
        found = max(found, float(np.linalg.norm(vb - va)))
    return found / max(np.linalg.norm(x) for x in values)


def slope(v: Path, samples: int = 200) -> float:
    """The largest |Δv| / Δs between neighbours."""
    values = np.array([v(s) for s in np.linspace(0.0, 1.0, samples)])
    return float(np.linalg.norm(np.diff(values, axis=0), axis=1).max() * (samples - 1))


def varied(rng: np.random.Generator, angle: float) -> list[Level]:
    """Rows and blocks, each pair of neighbours at `angle` in one of its directions."""
    base = directions(rng, N, N)
    return [
        level(base[0], 1.0),
        level(np.array([base[0] + angle * base[1], base[2]]), [-1.0, 0.4]),
        level(base[2] + angle * base[3], 0.7),
        level(np.array([base[3] - base[0], base[4], base[2] + base[5]]), [0.3, 0.2, -0.9]),
    ]


@pytest.mark.parametrize("angle", [1.0, 3e-2, 3e-3, 1e-5, 0.0])
@pytest.mark.parametrize("place", range(4))
def test_in_every_gain(place, angle):
    rng = seeded("gain", place, angle)
    stack = make_stack(
        N, varied(rng, angle), level(rng.normal(size=(2, N)), 1.0), rng.normal(size=N)
    )
    other = (place + 1) % 4
    for rho in (1.0, 0.5):
        there = stack.with_level(other, rho=rho)
        assert largest_step(lambda s, x=there: solve(x.with_level(place, rho=s)).v) < STEP


@pytest.mark.parametrize("angle", [1.0, 3e-3, 0.0])
def test_in_all_gains_at_once(angle):
    rng = seeded("gains", angle)
    stack = make_stack(N, varied(rng, angle), gradient=rng.normal(size=N))
    for _ in range(3):
        ends = np.round(rng.uniform(0.0, 1.0, (2, 4)))

        def v(s: float, ends=ends) -> np.ndarray:
            moved = stack
            for k, rho in enumerate((1.0 - s) * ends[0] + s * ends[1]):
                moved = moved.with_level(k, rho=rho)
            return solve(moved).v

        assert largest_step(v) < STEP


def test_in_the_activation_of_rows():
    """A level's row activation multiplies its ρ; of a block the first row's counts for all."""
    rng = seeded("rows")
    stack = make_stack(N, varied(rng, 3e-3), gradient=rng.normal(size=N))
    for place in range(4):

        def v(s: float, place=place) -> np.ndarray:
            return solve(stack, fading=[s if k == place else 1.0 for k in range(4)]).v

        assert largest_step(v) < STEP
        np.testing.assert_allclose(v(0.3), solve(stack.with_level(place, rho=0.3)).v, atol=1e-14)


@pytest.mark.parametrize("exact", [0.3, 0.1, 1e-3])
@pytest.mark.parametrize("angle", [1e-1, 1e-2, 1e-3, 1e-5, 1e-8, 0.0])
def test_a_level_fades_above_a_nearly_parallel_one(angle, exact):
    """No step. What the lower level does sideways alone goes within 1 − ρ of about angle squared.

    It is of size angle / exact, and nothing at angles that are cut: there the slope is a plain one.
    """
    rng = seeded("fades", angle, exact)
    base = directions(rng, 2, N)
    lower = level(np.cos(angle) * base[0] + np.sin(angle) * base[1], -1.0, exact=exact)

    def v(s: float) -> np.ndarray:
        return solve(make_stack(N, [level(base[0], 1.0, 1.0 - s), lower])).v

    assert largest_step(v) < STEP
    assert slope(v) < 4.0 + (8.0 / (angle * exact) if angle >= 1e-2 else 0.0)
    assert base[0] @ v(1.0) == pytest.approx(-np.cos(angle) / 1.0, rel=1e-9)


@pytest.mark.parametrize("rho", [0.2, 0.5, 0.85])
def test_what_a_fading_level_leaves_of_its_own_direction(rho):
    """Of what it misses, a parallel level below makes up for the share gᵀg / d = 1 − ρ."""
    row, other = np.arange(1.0, 5.0), np.array([4.0, -3.0, 2.0, -1.0])
    fading = level(row, 2.0, rho)
    found = solve(make_stack(4, [fading, level(3.0 * row, -9.0)])).v
    wanted = 2.0 * rho + (1.0 - rho) * (-3.0 - 2.0 * rho)
    assert row @ found == pytest.approx(wanted, rel=1e-12)
    # one direction of a block, the other being all its own
    block = level(np.array([row + other, row - other]), [-3.0 + 0.7, -3.0 - 0.7])
    found = solve(make_stack(4, [fading, block])).v
    assert row @ other == 0.0
    np.testing.assert_allclose([row @ found, other @ found], [wanted, 0.7], rtol=1e-12)


@pytest.mark.parametrize("place", range(4))
def test_at_zero_a_level_is_absent(place):
    rng = seeded("absent", place)
    for angle in (1.0, 3e-3, 0.0):
        stack = make_stack(N, varied(rng, angle), gradient=rng.normal(size=N))
        out = solve(stack.with_level(place, rho=0.0))
        rest = tuple(x for k, x in enumerate(stack.levels) if k != place)
        absent = solve(make_stack(N, rest, gradient=stack.gradient)).v
        np.testing.assert_array_equal(out.v, absent)
        assert out.freedom[place] == 0.0
        hair = solve(stack.with_level(place, rho=1e-9)).v
        np.testing.assert_allclose(hair, absent, atol=1e-5)


@pytest.mark.parametrize("rho", [1.0, 0.6])
@pytest.mark.parametrize("m", [1, 2, 3])
def test_rows_turn_through_those_above(rho, m):
    """Rank changes at s = 1/2: one row of the level comes to lie in those above and leaves them."""
    rng = seeded("turn", rho, m)
    base = directions(rng, N, N)
    above = level(base[:2], [1.0, -0.5], rho)

    def v(s: float, wide: float) -> np.ndarray:
        rows = base[:m] + 0.0
        rows[0] = base[0] + wide * (s - 0.5) * base[4]
        rows[1:] = base[5 : 4 + m] + 0.3 * base[1]
        here = level(rows, np.arange(m) + 1.0)
        return solve(make_stack(N, [above, here, level(base[4] + base[0], 0.8)])).v

    for wide in (2.0, 0.05, 1e-3):
        assert largest_step(lambda s, w=wide: v(s, w)) < STEP
    # the angle at which the direction is given up is 0.06 to 0.6 degrees; v changes by O(1) there
    assert slope(lambda s: v(s, 0.05), 2000) < 0.05 * 2e3


def test_rows_of_a_block_turn_through_each_other():
    rng = seeded("block")
    base = directions(rng, 4, N)

    def v(s: float, wide: float) -> np.ndarray:
        rows = np.array([base[0], base[0] + wide * (s - 0.5) * base[1], base[2]])
        return solve(
            make_stack(N, [level(rows, [1.0, 1.5, -1.0]), level(base[1] + base[2], 0.8)])
        ).v

    for wide in (2.0, 0.1, 1e-2):
        assert largest_step(lambda s, w=wide: v(s, w)) < STEP


@pytest.mark.parametrize("coupling", [1e-2, 1e-4, 1e-6])
def test_eigenvalues_of_a_block_cross_while_levels_above_fade(coupling):
    """Eigenvectors spin where eigenvalues nearly meet; v must not take part.

    One direction is half faded, the other at 45 degrees to a level in force: equal eigenvalues of
    J N Jᵀ, but not equal shares left. Over a window as narrow as the coupling v may change no more.
    """
    e = np.eye(N)

    def v(s: float) -> np.ndarray:
        free = 0.5 + 20.0 * coupling * (s - 0.5)
        rows = np.array([e[0], np.sqrt(1.0 - free) * e[1] + np.sqrt(free) * e[3]])
        rows[0] += coupling * e[3]
        return solve(make_stack(N, [level(e[:1], 0.0, 0.5), level(e[1]), level(rows, [1, -0.5])])).v

    assert slope(v) < 20.0 * 5.0 * coupling


@pytest.mark.parametrize("m", [1, 2])
def test_a_row_passes_through_zero_length(m):
    """Tasks fade such rows out in time; should one fail to, v stays finite and continuous.

    The rows shrink below 1e-6, shorter than anything a task means.
    """
    rng = seeded("zero", m)
    base = directions(rng, 4, N)

    def v(s: float, wide: float) -> np.ndarray:
        rows = base[1 : m + 1] + 0.0
        rows[0] = base[0]
        rows *= wide * (s - 0.5)
        return solve(make_stack(N, [level(rows, 1.0), level(base[0] + base[1], 0.3)])).v

    for wide in (1e-4, 1e-5, 1e-6, 1e-8):
        assert largest_step(lambda s, w=wide: v(s, w)) < STEP
    np.testing.assert_array_equal(
        v(0.5, 1.0), solve(make_stack(N, [level(base[0] + base[1], 0.3)])).v
    )


@pytest.mark.parametrize("m", [1, 3])
def test_in_the_rows_and_their_velocity(m):
    """From one stack of random rows to another, levels in force, half in force and out."""
    rng = seeded("rows and rhs", m)
    ends: Sequence[list[Level]] = [random_levels(rng, N, (m, 1, 2)) for _ in range(2)]
    main = [level(rng.normal(size=(2, N)), rng.normal(size=2)) for _ in range(2)]

    def v(s: float) -> np.ndarray:
        here = [
            Level((1 - s) * a.rows + s * b.rows, (1 - s) * a.rhs + s * b.rhs, rho)
            for a, b, rho in zip(*ends, (1.0, 0.5, 1.0), strict=True)
        ]
        rows, rhs = (
            (1 - s) * getattr(main[0], k) + s * getattr(main[1], k) for k in ("rows", "rhs")
        )
        return solve(make_stack(N, here, Level(rows, rhs), np.ones(N))).v

    assert largest_step(v) < STEP
