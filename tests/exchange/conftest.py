"""The runs that several tests look at, made once."""

from __future__ import annotations

import pytest

from .runs import Run, simulate


@pytest.fixture(scope="session")
def reference() -> Run:
    """The exchange as its file says."""
    return simulate()


@pytest.fixture(scope="session")
def pouring() -> Run:
    """Two hands turn a bottle and back, with the forces that hold it."""
    return simulate("bottle_pouring", to_the_end=True)


@pytest.fixture(scope="session")
def unsmoothed() -> Run:
    """The same with gains that switch at once and no filter that would hide the steps."""
    return simulate(overrides={"supervisor.smoothing": "off", "limits.acceleration": None})
