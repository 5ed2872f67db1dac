"""What must be there for a scenario to run under torques. Like `crosscheck`, on the plain data."""

from __future__ import annotations

from typing import Any

from wbc.scenario.force_checks import by_contact
from wbc.scenario.relations import si
from wbc.scenario.wording import Faults, listing, mapping

_BY_CONTACT = ("position", "force", "integral", "windup")


def check_dynamics(data: dict[str, Any], faults: Faults) -> None:
    """Add the faults of `force_control`, of `simulation.physics` and of what an engine needs."""
    simulation = mapping(data.get("simulation"))
    physics, second = mapping(simulation.get("physics")), mapping(data.get("force_control"))
    contacts = [name for name in mapping(data.get("contacts")) if isinstance(name, str)]
    for key in ("friction", "sliding_friction"):
        if isinstance(physics.get(key), dict):
            by_contact(("simulation", "physics", key), physics[key], contacts, faults)
    for key in _BY_CONTACT:
        if isinstance(second.get(key), dict):
            by_contact(("force_control", key), second[key], contacts, faults)
    engine = simulation.get("engine", "kinematic")
    if engine not in ("compliant", "mujoco"):
        return
    if engine == "mujoco" and physics.get("control") == "continuous":
        text = "continuous is of the compliant engine: this one takes a torque at a time"
        faults.add(("simulation", "physics", "control"), text)
    table = physics.get("table")
    if isinstance(table, dict) and table.get("height") is None and not listing(table.get("posts")):
        faults.add(("simulation", "physics", "table"), "needs a 'height', 'posts' or both")
    position = listing(mapping(mapping(data.get("object")).get("pose")).get("position"))
    if table is not None and len(position) == 2:
        faults.add(("simulation", "physics", "table"), "an object in the plane lies on nothing")
    if isinstance(physics.get("fixture"), str):
        names = [str(mapping(phase).get("name")) for phase in listing(data.get("phases"))]
        if physics["fixture"] not in names:
            faults.unknown(("simulation", "physics", "fixture"), "phase", physics["fixture"], names)
    _needs(data, engine, faults)


def _needs(data: dict[str, Any], engine: str, faults: Faults) -> None:
    """A free object with mass and inertia, who touches it, and gains."""
    path = ("simulation", "engine")
    for block in ("object", "contacts", "force_control"):
        if block not in data:
            faults.add(path, f"{engine} needs a block '{block}'")
    thing = data.get("object")
    if not isinstance(thing, dict):
        return
    if thing.get("mass") is None:
        faults.add(path, f"{engine} needs 'mass' in the block 'object'")
    planar = len(listing(mapping(thing.get("pose")).get("position"))) == 2
    moments = [si(raw, "inertia") for raw in listing(thing.get("inertia"))]
    if any(m is None for m in moments):
        return  # said already
    wanted = moments[2:] if planar else moments
    if not wanted or not all((m or 0.0) > 0.0 for m in wanted):
        what = "about z" if planar else "about all three axes"
        faults.add(path, f"{engine} needs the object's 'inertia' {what}")
