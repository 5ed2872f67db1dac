"""Quantities: every unit reads back what was written, and nothing else is accepted."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.scenario.units import EXAMPLES, UNITS, QuantityError, read, units_of

DIMENSIONS = sorted({unit.dimension for unit in UNITS.values()})


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("110 deg", "angle", math.radians(110)),
        ("180 deg", "angle", math.pi),
        ("-76deg", "angle", math.radians(-76)),
        ("1.92 rad", "angle", 1.92),
        (0, "angle", 0.0),
        ("5 mm", "length", 0.005),
        ("5 cm", "length", 0.05),
        (" .5  m ", "length", 0.5),
        (2, "length", 2.0),
        ("2 ms", "time", 0.002),
        ("0.1 s", "time", 0.1),
        ("20 /s", "rate", 20.0),
        ("20/s", "rate", 20.0),
        ("5e4 N/m", "stiffness", 5e4),
        ("20 N", "force", 20.0),
        ("60 rad/s^2", "angular acceleration", 60.0),
        ("-3", "length", -3.0),
        ("30 %", "share", 0.3),
        (0.3, "share", 0.3),
        ("0.2 mrad", "angle", 2e-4),
    ],
)
def test_known_quantities(text: object, dimension: str, value: float) -> None:
    assert read(text, dimension).value == value


@given(st.floats(allow_nan=False, allow_infinity=False, width=32), st.sampled_from(sorted(UNITS)))
def test_a_quantity_comes_back_in_its_unit(number: float, name: str) -> None:
    unit = UNITS[name]
    found = read(f"{number!r} {name}", unit.dimension)
    assert found.dimension == unit.dimension
    assert found.value * unit.per / unit.times == pytest.approx(number, rel=1e-15)


@given(st.integers(-(10**6), 10**6))
def test_thousandths_are_rounded_correctly(count: int) -> None:
    # The literal is the double nearest to the decimal; 0.001 * count often is not.
    assert read(f"{count} mm", "length").value == float(f"{count}e-3")


@given(st.sampled_from(sorted(UNITS)), st.sampled_from(DIMENSIONS))
def test_only_the_right_dimension_is_accepted(name: str, dimension: str) -> None:
    if UNITS[name].dimension == dimension:
        assert read(f"1 {name}", dimension).value > 0.0
    else:
        with pytest.raises(QuantityError, match=f"must be an? {dimension} such as"):
            read(f"1 {name}", dimension)


@given(st.text(max_size=30) | st.none() | st.booleans() | st.lists(st.integers()) | st.floats())
def test_anything_is_read_or_refused_in_one_line(raw: object) -> None:
    for dimensions in ((DIMENSIONS[0],), ("number",), ("angle", "length")):
        try:
            assert math.isfinite(read(raw, *dimensions).value)
        except QuantityError as fault:
            assert str(fault) and str(fault).isprintable()


@pytest.mark.parametrize(
    "raw",
    [True, False, None, math.nan, math.inf, 10**400, "nan m", "inf", "1e400 m", "1 2 m", "1_0 m",
     "0x10 m", "m", "", "1 m " + " " * 200 + "m", "9" * 500, [1], {"m": 1}],
)  # fmt: skip
def test_refused(raw: object) -> None:
    with pytest.raises(QuantityError):
        read(raw, "length")


def test_an_angle_must_name_its_unit() -> None:
    for raw in (37, 1.92, "37"):
        with pytest.raises(QuantityError) as fault:
            read(raw, "angle")
        assert str(fault.value) == "an angle needs its unit: write '110 deg' or '1.92 rad'"
    assert read(0, "angle", "length").dimension == "any"


def test_the_table_is_whole() -> None:
    for dimension in set(DIMENSIONS) - {"share"}:  # a whole one is a bare 1
        assert "1.0" in {f"{UNITS[u].times / UNITS[u].per}" for u in units_of(dimension)}
        assert read(EXAMPLES[dimension], dimension).value > 0.0
