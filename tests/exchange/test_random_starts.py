"""Random starts of the exchange: all of them converge."""

from __future__ import annotations

import pytest

from . import starts

FEW = 3


def judge(number: int, step: str) -> None:
    result = starts.run(number, step)
    print(number, {name: float(f"{x:.3g}") for name, x in starts.figures(result).items()})
    assert starts.faults(result) == []


@pytest.mark.parametrize("number", range(FEW))
def test_a_few_at_a_coarse_tick(number: int) -> None:
    judge(number, "4 ms")


@pytest.mark.slow
@pytest.mark.parametrize("number", range(starts.COUNT))
def test_all(number: int) -> None:
    judge(number, "2 ms")


def test_they_vary() -> None:
    """Sixteen different starts, the same every time."""
    drawn = [starts.variation(number) for number in range(starts.COUNT)]
    assert len({str(overrides) for overrides in drawn}) == starts.COUNT
    assert str(starts.variation(3)) == str(drawn[3])
    aims = [float(overrides["contacts.f3.at"][0].split()[0]) for overrides in drawn]
    assert min(aims) < 12.0 and max(aims) > 38.0
