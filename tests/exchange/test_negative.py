"""Convex objects: no exchange without crossing links, and the run says so."""

from __future__ import annotations

import pytest

from . import negative

slow = pytest.mark.slow


@pytest.mark.parametrize(
    "shape",
    [
        "ellipse",
        "circle",
        pytest.param("small circle", marks=slow),
        pytest.param("large circle", marks=slow),
    ],
)
def test_it_ends_honestly(shape: str) -> None:
    result = negative.run(shape)
    said = negative.summary(result)
    print(shape, negative.figures(result), said["reason"])
    assert negative.faults(result) == []
    assert said["timeouts"] == ["slide"] and not said["success"]
    # held after the timeout, not left drifting
    late = result.t > result.t[-1] - 0.2
    assert result.object_error[late].max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["ellipse", "circle"])
def test_without_avoidance_the_links_would_cross(shape: str) -> None:
    """So it is the collision cost that stops the run, and nothing else."""
    result = negative.run(shape, avoid=False)
    reached = negative.figures(result)
    print(shape, reached)
    assert reached["eps_34"] < 1e-6
    assert reached["links"] < 0.0
    assert negative.summary(result)["violations"]  # watched all the same, and reported
