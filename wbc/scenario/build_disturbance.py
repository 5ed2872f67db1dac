"""From a scenario's ranges and seed to what its run meets."""

from __future__ import annotations

from wbc.scenario.schema import Scenario
from wbc.sim.disturbances import Disturbance, draw


def build_disturbance(scenario: Scenario) -> Disturbance | None:
    """What is wrong in the run of a scenario, by its seed; None where it asks for nothing."""
    asked = scenario.simulation.disturbances
    if asked is None:
        return None
    planar = scenario.object is not None and scenario.object.pose.planar
    return draw(asked.ranges, scenario.simulation.seed, planar=planar)
