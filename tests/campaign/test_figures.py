"""A campaign in numbers: the interval, the reasons, and what goes with failure."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from wbc.campaign.figures import Figures, figures, kind, wilson
from wbc.campaign.trial import trial_seed

from .lines import campaign, trial


@given(st.integers(1, 3000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_is_wilsons(case: tuple[int, int]) -> None:
    successes, trials = case
    found = wilson(successes, trials)
    oracle = binomtest(successes, trials).proportion_ci(method="wilson")
    assert found.share == successes / trials
    assert found.low == pytest.approx(oracle.low, abs=1e-12)
    assert found.high == pytest.approx(oracle.high, abs=1e-12)


def test_200_of_200_is_not_yet_99_percent_for_certain() -> None:
    assert wilson(200, 200).low == pytest.approx(0.9812, abs=1e-4)
    assert wilson(0, 0)[1:] == (0.0, 1.0)


@pytest.mark.parametrize(
    ("reason", "expected"),
    [
        (
            "phase 'close' timed out after 3 s: tip error of 'f3' [m] 0.0123, needed 0.001",
            "phase 'close' timed out after # s",
        ),
        ("the run ended at 0.2 s in phase 'approach'", "the run ended at # s in phase 'approach'"),
        (
            "joint 'a_2' was 1.2e-05 rad beyond its limit at 3 s; parts collided at 4 s",
            "joint 'a_2' was # rad beyond its limit at # s",
        ),
        ("refused: x.yaml: finger 'f1' is 3 mm off", "refused: x.yaml: finger 'f1' is # mm off"),
        ("crashed", "crashed"),
        ("", ""),
    ],
)
def test_reasons_that_differ_in_numbers_are_one(reason: str, expected: str) -> None:
    assert kind(reason) == expected


def test_what_is_counted() -> None:
    found = campaign()
    assert found.numbers == tuple(range(40))
    assert int(found.success.sum()) == 30
    assert found.kinds == [("dropped after # s", 9, 4), ("crashed", 1, 3)]
    error = found.measures["object, error [mm]"]
    assert np.isnan(error[3]) and error[5] == pytest.approx(5.0)
    assert "slip [mm]" not in found.measures


def test_what_failed_first_is_in_front() -> None:
    why = "phase 'carry' timed out after 3 s; the object was dropped at 2.1 s"
    failed = {"failure": "contact_lost", "failure_t": 1.9, "failure_phase": "lift"}
    lines = [
        trial(0, False, {}, why, **failed),
        trial(1, False, {}, "no tick was recorded", failure="no_tick", failure_phase=None),
        trial(2, False, {}, "the object was dropped at 2.4 s", **failed),
        trial(3, True, {}, failure=None),
    ]
    found = figures(lines)
    assert found.kinds == [("contact_lost in phase 'lift'", 2, 0), ("no_tick", 1, 1)]
    assert found.reasons[0] == "contact_lost in phase 'lift': " + why and not found.reasons[3]


def test_what_goes_with_failure_comes_first() -> None:
    found = campaign()
    assert found.comparisons[0].name == "mass"
    assert found.comparisons[0].above > 0.85
    assert found.comparisons[0].p < 1e-4
    assert {c.p for c in found.comparisons if c.name == "friction"}.pop() > 0.01
    assert "delay" not in found.drawn and "seed" not in found.drawn
    assert {"position.x", "position, length"} <= set(found.drawn)


def test_both_ends_of_a_range_may_be_bad() -> None:
    values = np.linspace(0.7, 1.3, 60)
    lines = [
        trial(n, abs(mass - 1.0) < 0.2, {"mass": mass}, reason="dropped")
        for n, mass in enumerate(values.tolist())
    ]
    best = figures(lines).comparisons[0]
    assert best.name == "mass, off the middle" and best.above == 1.0


@pytest.mark.parametrize("good", [0, 2, 38, 40])
def test_too_few_of_a_kind_are_not_compared(good: int) -> None:
    lines = [trial(n, n < good, {"mass": 1.0 + n}) for n in range(40)]
    assert figures(lines).comparisons == ()


def test_a_campaign_of_nothing() -> None:
    found: Figures = figures([])
    assert found.kinds == [] and not found.measures and not found.drawn


def test_seeds_do_not_depend_on_the_number_of_trials_and_differ() -> None:
    seeds = [trial_seed(3, n) for n in range(1000)]
    assert len(set(seeds)) == 1000 and max(seeds) < 2**53
    children: list[Any] = np.random.SeedSequence(3).spawn(5)
    assert seeds[4] == int(children[4].generate_state(1, np.uint64)[0] >> 11)
    assert json.loads(json.dumps(float(seeds[7]))) == seeds[7]
    assert seeds[0] != trial_seed(4, 0)
