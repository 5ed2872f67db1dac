"""Values that differ from trial to trial."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import kstest

from wbc.campaign.vary import drawn, read_variations
from wbc.errors import WbcError
from wbc.scenario import load

LOADED = load("planar_exchange")


@pytest.mark.parametrize(
    ("text", "middle", "most", "unit"),
    [
        ("object.pose.position[0]=2 cm", 0.0, 0.02, "m"),
        ("object.pose.position.0=±2cm", 0.0, 0.02, "m"),
        ("contacts.f3.at[0]=20 deg", None, math.radians(20.0), "rad"),
        ("simulation.step=10 %", 0.002, 0.0002, "s"),
        ("supervisor.remove_above=0.01", None, 0.01, ""),
    ],
)
def test_a_range_is_about_the_value(
    text: str, middle: float | None, most: float, unit: str
) -> None:
    variation = read_variations([text], LOADED)[0]
    if middle is not None:
        assert variation.value == pytest.approx(middle)
    assert (variation.most, variation.unit) == (pytest.approx(most), unit)
    values = np.array([variation.draw(seed) for seed in range(1000)])
    place = (values - variation.value) / variation.most
    assert kstest(place, "uniform", (-1.0, 2.0)).pvalue > 1e-3


def test_what_is_drawn_is_what_is_run() -> None:
    both = ["object.pose.position[0]=2 cm", "contacts.f3.at[0]=10 deg"]
    variations = read_variations(both, LOADED)
    overrides, values = drawn(variations, 5)
    scenario = load("planar_exchange", overrides).scenario
    assert scenario.object is not None
    assert scenario.object.pose.xyz[0] == values["object.pose.position[0]"]
    assert scenario.contacts["f3"].at[0].value == values["contacts.f3.at[0]"]
    alone, _ = drawn(read_variations(both[1:], LOADED), 5)
    assert alone.items() < overrides.items()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("object.pose.position[0]", "write KEY=RANGE"),
        ("=3", "write KEY=RANGE"),
        ("object.pose.position[7]=2 cm", "no such value"),
        ("object.poes.position[0]=2 cm", "no such value"),
        ("object.pose=2 cm", "needs a number or a quantity, got a mapping"),
        ("contacts.f3.at[0]=2 mm", "a range of length does not fit the value, of angle"),
        ("object.pose.position[0]=2 mn", "unknown unit 'mn' (did you mean"),
        ("object.pose.position[0]=wide", "needs a number or a quantity, got 'wide'"),
        ("object.pose.position[0]=-2 cm", "must be above 0"),
        ("object.pose.position[0]=0", "must be above 0"),
        ("object.pose.position[0]=nan", "must be above 0"),
        ("object.pose.position[0]=inf", "must be above 0 and finite"),
        ("contacts.f3.at[0]=0.1", "does not fit the value"),
        ("name=3", "needs a number or a quantity, got 'planar_exchange'"),
    ],
)  # fmt: skip
def test_a_bad_range_is_one_line(text: str, why: str) -> None:
    with pytest.raises(WbcError) as error:
        read_variations([text], LOADED)
    assert why in str(error.value) and "\n" not in str(error.value)
    assert str(error.value).startswith(f"--vary '{text}': ")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("object.pose.position[0]=2 deg", "object.pose.position[0]: must be a length"),
        ("simulation.step=3 ms", "simulation.step: must be above 0"),
        ("limits.velocity_scale=0.2", "must be at most 1"),
    ],
)
def test_a_range_that_leaves_what_a_scenario_may_say(text: str, why: str) -> None:
    loaded = load("planar_exchange", {"limits.velocity_scale": 0.9})
    with pytest.raises(WbcError) as error:
        read_variations([text], loaded)
    assert str(error.value).startswith("--vary, at an end: ") and why in str(error.value)


def test_all_faults_at_once() -> None:
    with pytest.raises(WbcError) as error:
        read_variations(["a=1", "simulation.step=10 %", "simulation.step=1 %", "b=1"], LOADED)
    lines = str(error.value).splitlines()
    assert len(lines) == 3 and "varied twice" in lines[1]


def test_the_seed_is_not_for_varying() -> None:
    loaded = load("planar_exchange", {"simulation.seed": "4"})
    with pytest.raises(WbcError, match="its own seed"):
        read_variations(["simulation.seed=2"], loaded)
