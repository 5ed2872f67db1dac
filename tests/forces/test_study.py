"""The variants that Figures 4 to 10 compare, on a part of the pouring."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np
import pytest

from wbc.errors import WbcError
from wbc.forces import GraspForceProblem
from wbc.forces.cost import balance_error
from wbc.forces.study import ALL, CASES, Case, CaseRun, percent, run

from . import reference
from .problems import pouring

HANDS = np.repeat([0, 1], 5)
TICKS = 12
NEWTON = tuple(
    Case("newton " + c.name, c.limits, c.sigma, c.split, c.weighted, "newton") for c in CASES
)


@pytest.fixture(scope="module")
def ticks() -> list[GraspForceProblem]:
    return list(pouring(load=1.0, dt=0.01))[:TICKS]


@pytest.fixture(scope="module")
def runs(ticks: list[GraspForceProblem]) -> dict[str, CaseRun]:
    moments: Iterator[int] = count()
    return run(
        ticks, reference.optimum(ticks[0]), HANDS, cases=(*CASES, *NEWTON), tolerance=1e-7,
        clock=lambda: float(next(moments)),
    )  # fmt: skip


def test_every_tick_of_every_case_balances(
    ticks: list[GraspForceProblem], runs: dict[str, CaseRun]
) -> None:
    for name, case in runs.items():
        assert case.solved.all(), name
        assert case.c.shape == (TICKS, 30) and case.load_force.shape == (TICKS, 2)
        for problem, c in zip(ticks, case.c, strict=True):
            assert balance_error(problem, c) < 1e-9
        assert (case.cone_margin > 0.0).all()
        if "none" not in name:
            assert (case.torque_margin > 0.0).all(), name


def test_newton_and_the_flow_agree(runs: dict[str, CaseRun]) -> None:
    for case in CASES:
        flow, newton = runs[case.name], runs["newton " + case.name]
        if not case.split:  # there, each goes its own way from tick to tick
            np.testing.assert_allclose(flow.phi, newton.phi, rtol=2e-3)
        assert newton.steps.mean() < flow.steps.mean()


def test_what_the_variants_differ_in(runs: dict[str, CaseRun]) -> None:
    every = runs[ALL.name]
    assert (every.active == 60).all() and (runs["none"].active == 0).all()
    chosen = [runs[f"sigma {s}"].active.mean() for s in ("0", "0.5", "0.8")]
    assert 25 < chosen[0] < 40 and chosen[0] > chosen[1] > chosen[2]
    # friction alone presses less, and breaks the limits; the split presses more
    assert (runs["none"].phi < every.phi).all()
    assert runs["none"].torque_margin.min() < every.torque_margin.min()
    for name in ("split", "split weighted"):
        assert (runs[name].phi > every.phi * (1.0 - 2e-3)).all()
    for case in runs.values():
        np.testing.assert_allclose(case.share.sum(axis=1), 1.0)


def test_loads_of_the_hands(ticks: list[GraspForceProblem], runs: dict[str, CaseRun]) -> None:
    case = runs[ALL.name]
    for k, problem in enumerate(ticks):
        one = problem.G[:, :15] @ case.c[k, :15]
        other = problem.h_e - one
        np.testing.assert_allclose(case.load_force[k], [
            np.linalg.norm(one[:3]), np.linalg.norm(other[:3])
        ], rtol=1e-6)  # fmt: skip
        np.testing.assert_allclose(case.load_moment[k], [
            np.linalg.norm(one[3:]), np.linalg.norm(other[3:])
        ], rtol=1e-4)  # fmt: skip


def test_time_is_in_percent_of_the_longest(runs: dict[str, CaseRun]) -> None:
    assert (runs[ALL.name].seconds >= 1.0).all()
    assert percent(runs, ALL.name).max() == pytest.approx(100.0)
    assert (percent(runs, "split") > 0.0).all()


def test_a_tick_that_fails_holds_the_forces(ticks: list[GraspForceProblem]) -> None:
    start = reference.optimum(ticks[0])
    heavy = ticks[1].with_(h_e=100.0 * ticks[1].h_e)
    case = run([ticks[0], heavy, ticks[2]], start, HANDS, cases=[ALL], most=200)[ALL.name]
    assert case.solved.tolist() == [True, False, True]
    np.testing.assert_array_equal(case.c[0], case.c[1])
    assert (case.seconds == 0.0).all()


def test_soft_fingers(ticks: list[GraspForceProblem]) -> None:
    soft = list(pouring("soft_finger", dt=0.01))[:3]
    for case in run(soft, reference.optimum(soft[0]), HANDS, cases=(*CASES, *NEWTON)).values():
        assert case.solved.all() and case.c.shape == (3, 40)


def test_hands_must_fit(ticks: list[GraspForceProblem]) -> None:
    with pytest.raises(WbcError, match="hands"):
        run(ticks, np.zeros(30), HANDS[:4])
