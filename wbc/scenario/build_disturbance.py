"""From a scenario's ranges and seed to what its run meets."""

from __future__ import annotations

from wbc.scenario.disturbance_blocks import Disturbances
from wbc.scenario.schema import Scenario
from wbc.sim.disturbances import Disturbance, Lost, Push, Ranges, draw


def build_disturbance(scenario: Scenario) -> Disturbance | None:
    """What is wrong in the run of a scenario, by its seed; None where it asks for nothing."""
    asked = scenario.simulation.disturbances
    if asked is None:
        return None
    planar = scenario.object is not None and scenario.object.pose.planar
    return draw(ranges_of(asked), scenario.simulation.seed, planar=planar)


def ranges_of(block: Disturbances) -> Ranges:
    """What a trial is drawn from."""
    plain = {name: getattr(block, name) for name in type(block).model_fields}
    plain["pushes"] = tuple(Push(p.at, p.force, p.over) for p in block.pushes)
    plain["lost"] = tuple(Lost(entry.finger, entry.at, entry.over) for entry in block.lost)
    return Ranges(**plain)
