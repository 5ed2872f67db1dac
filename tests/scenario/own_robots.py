"""Robots of others, where they are installed."""

from __future__ import annotations

from pathlib import Path

import pytest

from wbc.errors import WbcError
from wbc.robot.packages import locate

ROBOTS = "package://example-robot-data/robots"
HAND = f"{ROBOTS}/allegro_hand_description/urdf/allegro_right_hand.urdf"


def need_example_robots() -> None:
    """Skip the test where example-robot-data is not installed."""
    try:
        locate(HAND, Path.cwd())
    except WbcError:
        pytest.skip("example-robot-data is not installed")
