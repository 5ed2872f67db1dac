"""The published law: that it is what is printed, and the defects the settled one does without."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from stack.problems import Level, directions, level, make_stack, seeded, solve
from wbc.stack.printed import (
    PrintedLevel,
    PrintedMotion,
    null_projector,
    pseudo_inverse,
    solve_printed,
)

N = 10


def printed(
    main: Level,
    levels: Sequence[Level],
    metric: np.ndarray | None = None,
    gradient: np.ndarray | None = None,
) -> PrintedMotion:
    n = main.rows.shape[1]
    return solve_printed(
        main.rows, main.rhs, np.ones(n) if metric is None else metric,
        [PrintedLevel(x.rows, x.rhs, x.rho) for x in levels],
        np.zeros(n) if gradient is None else gradient,
    )  # fmt: skip


def test_to_the_letter_with_numpy_alone():
    """W = I: the sum of (37) and of the complete form, written out with numpy's pseudo-inverse."""
    rng = seeded("letter")
    j, b, gradient = rng.normal(size=(3, N)), rng.normal(size=3), rng.normal(size=N)
    j1, e1, j2, e2 = (rng.normal(size=s) for s in ((1, N), 1, (2, N), 2))
    pinv, eye = np.linalg.pinv, np.eye(N)
    above = np.vstack([j, j1])
    everything = np.vstack([above, j2])
    wanted = (
        pinv(j) @ b
        + 0.7 * (eye - pinv(j) @ j) @ pinv(j1) @ (5.0 * e1)
        + 0.2 * (eye - pinv(above) @ above) @ pinv(j2) @ (3.0 * e2)
        - (eye - pinv(everything) @ everything) @ gradient
    )
    found = printed(
        Level(j, b), [Level(j1, 5.0 * e1, 0.7), Level(j2, 3.0 * e2, 0.2)], gradient=gradient
    )
    np.testing.assert_allclose(found.total, wanted, atol=1e-12)
    np.testing.assert_allclose(found.main, pinv(j) @ b, atol=1e-13)
    assert found.rank == 3


def test_weighted_right_pseudo_inverse():
    """J J† = I, and of all solutions the one least in the metric; the projector fits it."""
    rng = seeded("weighted")
    rows, metric = rng.normal(size=(4, N)), 10.0 ** rng.uniform(-2, 2, N)
    inverse, rank = pseudo_inverse(rows, metric)
    assert rank == 4
    np.testing.assert_allclose(rows @ inverse, np.eye(4), atol=1e-11)
    gram = (rows / metric) @ rows.T
    np.testing.assert_allclose(
        inverse, (rows / metric).T @ np.linalg.inv(gram), rtol=1e-8, atol=1e-11
    )
    n = null_projector(rows, metric)
    np.testing.assert_allclose(n @ n, n, atol=1e-10)
    np.testing.assert_allclose(rows @ n, 0.0, atol=1e-11)
    np.testing.assert_allclose(metric[:, None] * n, (metric[:, None] * n).T, atol=1e-9)


@pytest.mark.parametrize("weighted", [False, True])
def test_projectors_annihilate_what_is_above(weighted):
    """No term of a level, nor of the gradient, is seen by any above it, dependent rows included."""
    rng = seeded("annihilate", weighted)
    metric = 10.0 ** rng.uniform(-1, 1, N) if weighted else np.ones(N)
    main = Level(rng.normal(size=(3, N)), rng.normal(size=3))
    first = level(rng.normal(size=(2, N)), 1.0)
    double = level(np.vstack([first.rows[0], first.rows[0] + main.rows[1]]), 1.0)
    levels = [first, double, level(np.zeros(N), 1.0), level(rng.normal(size=N), 1.0)]
    above = main.rows
    for h, x in enumerate(levels):
        before = printed(main, levels[:h], metric).total
        np.testing.assert_allclose(
            above @ (printed(main, levels[: h + 1], metric).total - before), 0, atol=1e-10
        )
        above = np.vstack([above, x.rows])
    moved = (
        printed(main, levels, metric, rng.normal(size=N)).total
        - printed(main, levels, metric).total
    )
    np.testing.assert_allclose(above @ moved, 0.0, atol=1e-10)
    assert np.linalg.norm(moved) > 0.1


def test_settled_and_printed_agree_where_nothing_conflicts():
    rng = seeded("agree")
    base = directions(rng, 7, N)
    main = Level(rng.normal(size=(2, 2)) @ base[:2], rng.normal(size=2))
    levels = [level(2.0 * base[2], 0.7), level(base[3:5] * [[0.3], [4.0]], [1.0, -1.0])]
    gradient = rng.normal(size=N)
    settled = solve(make_stack(N, levels, main, gradient))
    found = printed(main, levels, gradient=gradient)
    np.testing.assert_allclose(found.main, settled.main, atol=1e-12)
    np.testing.assert_allclose(found.total, settled.v, atol=1e-12)
    np.testing.assert_allclose(found.eta, 1.0, atol=1e-12)


@pytest.mark.parametrize("angle", [90, 45, 10, 1])
def test_defect_convergence_at_k_eta(angle):
    """η = |N Jᵀ|² / |J|² = sin² of the angle to the rows above; the settled law keeps K."""
    gain, alpha, e = 4.0, np.deg2rad(angle), np.eye(4)
    row = np.cos(alpha) * e[0] + np.sin(alpha) * e[1]
    main, sigma, dt = level(e[0]), 1.0, 1e-3
    found = printed(main, [level(row, gain * sigma)])
    assert found.eta[0] == pytest.approx(np.sin(alpha) ** 2)
    assert row @ found.total == pytest.approx(gain * np.sin(alpha) ** 2 * sigma)
    for _ in range(200):
        sigma -= dt * float(row @ printed(main, [level(row, gain * sigma)]).total)
    assert sigma == pytest.approx((1.0 - dt * gain * np.sin(alpha) ** 2) ** 200, rel=1e-9)
    settled = solve(make_stack(4, [level(row, gain, exact=1e-4)], main)).v
    assert row @ settled == pytest.approx(gain, rel=1e-9)


def test_defect_eta_depends_on_the_units_of_the_passive_variables():
    """Cheap passive columns take a task's motion, and the projector takes it away again."""
    rng = seeded("units")
    main = Level(np.hstack([rng.normal(size=(3, 5)), rng.normal(size=(3, 3))]), np.zeros(3))
    task = level(np.hstack([rng.normal(size=5), rng.normal(size=3)]), 1.0)
    eta = [
        printed(main, [task], np.concatenate([np.ones(5), np.full(3, w)])).eta[0]
        for w in (1.0, 1e-2, 1e-4)
    ]
    assert 0.3 < eta[0] < 1.0
    assert eta[2] < 0.05 * eta[1] < 0.02 * eta[0]


def jump(law, at: float = 0.0, hair: float = 1e-7) -> float:  # type: ignore[no-untyped-def]
    """|v(at + hair) − v(at)|."""
    return float(np.linalg.norm(law(at + hair) - law(at)))


def test_defect_projector_jumps_when_a_row_vanishes():
    """A row of size s above a level: however small s, the level may not use its direction."""
    e = np.eye(3)
    below = level(e[0] + e[1], 1.0)

    def published(s: float) -> np.ndarray:
        return printed(level(e[2]), [level(s * e[0], 0.0), below]).total

    def settled(s: float) -> np.ndarray:
        fading = level(e[0], 0.0, rho=s)  # the task fades its row before it vanishes
        return solve(make_stack(3, [fading, below], level(e[2]))).v

    assert jump(published) > 0.4
    assert jump(settled) < 1e-6


def test_defect_projector_jumps_when_a_row_turns_into_those_above():
    """The row of a middle level crosses the main task's: its direction is taken up to the cut."""
    e = np.eye(3)
    below = level(e[1] + e[2], 1.0)

    def rows(s: float) -> list[Level]:
        return [level(e[0] + s * e[1], 0.0), below]

    assert jump(lambda s: printed(level(e[0]), rows(s)).total) > 0.4
    assert jump(lambda s: solve(make_stack(3, rows(s), level(e[0]))).v) < 1e-9


def test_defect_a_fading_level_gives_no_freedom_back():
    """ρ scales the term alone: at ρ = 0 the level below is held as at 1, and let go with a jump."""
    e = np.eye(3)
    main, below = level(e[2]), level(e[0], 1.0)

    def moved(rho: float) -> float:
        return float(printed(main, [level(e[0], 0.0, rho), below]).total[0])

    assert moved(1.0) == moved(1e-9) == moved(0.0) == pytest.approx(0.0, abs=1e-12)
    assert printed(main, [below]).total[0] == pytest.approx(1.0)
    fading = [
        solve(make_stack(3, [level(e[0], 0.0, rho), below], main)).v[0] for rho in (1.0, 0.5, 1e-9)
    ]
    np.testing.assert_allclose(fading, [0.0, 0.5, 1.0], atol=1e-8)


def test_no_rows_and_not_a_number():
    main = Level(np.zeros((0, N)), np.zeros(0))
    found = printed(main, [level(np.eye(N)[0], 2.0)], gradient=np.ones(N))
    assert found.rank == 0
    np.testing.assert_allclose(found.total, [2.0, *-np.ones(N - 1)])
    for place in range(3):
        given = [level(np.eye(N)[0], 1.0), level(np.eye(N)[1], 1.0)]
        gradient = np.ones(N)
        target = (given[0].rhs, given[1].rows, gradient)[place]
        target.flat[0] = np.nan
        assert np.isnan(printed(given[0], given[1:], gradient=gradient).total).all()
