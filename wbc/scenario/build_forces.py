"""The forces block to the planner of a controller."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fnmatch import fnmatchcase

import numpy as np

from wbc.arrays import Array
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.control.force_planner import ForcePlanner, ForceSettings
from wbc.control.load_estimate import LoadEstimate
from wbc.control.payload import Payload, Water
from wbc.control.phases import PhaseSequence
from wbc.robot.model import RobotModel
from wbc.scenario.force_blocks import Contents, Estimate
from wbc.scenario.kinds import CylinderSpec
from wbc.scenario.schema import Object, Scenario


def build_planner(
    scenario: Scenario, kin: ExtendedKinematics, phases: PhaseSequence
) -> ForcePlanner | None:
    """The planner; None where the scenario plans no forces."""
    forces, thing = scenario.forces, scenario.object
    if forces is None or thing is None or thing.mass is None:  # the last two: `check_forces`
        return None
    fingers = kin.grasp.fingers
    limit = torque_limits(forces.torque_limits, kin.robot.model)
    settings = ForceSettings(
        soft=forces.model == "soft_finger",
        mu=np.array([value_for(forces.friction, name) for name in fingers], dtype=np.float64),
        mu_t=np.array([value_for(forces.torsion, name, 1.0) for name in fingers], dtype=np.float64),
        sliding=forces.sliding_friction,
        tau_min=-limit,
        tau_max=limit,
        w_p=forces.w_p,
        w_bF=forces.w_bF,
        w_bT=forces.w_bT,
        margin=forces.margin,
        method=forces.method,
        ramp=forces.ramp,
        estimate=_estimate(forces.estimate, scenario),
    )
    return ForcePlanner(
        kin, build_payload(thing, scenario), settings, phases.phases, scenario.simulation.step
    )


def _estimate(given: Estimate | None, scenario: Scenario) -> LoadEstimate | None:
    """The estimate of what is carried; None where there is to be none."""
    if given is None:
        return None
    names = [phase.name for phase in scenario.phases]
    if given.phase is not None:
        first = names.index(given.phase)
    else:
        first = 1 + next(k for k, phase in enumerate(scenario.phases) if phase.object is not None)
    return LoadEstimate(first, given.smoothing, *given.mass, given.com)


def value_for(values: Mapping[str, float], name: str, default: float = math.nan) -> float:
    """The value for a contact: its own, else that of the first pattern that fits its name."""
    if name in values:
        return values[name]
    return next((v for key, v in values.items() if fnmatchcase(name, key)), default)


def torque_limits(given: Mapping[str, float | None], model: RobotModel) -> Array:
    """(nv,) largest torques; inf where there is no limit."""
    limit = np.where(model.effort > 0.0, model.effort, np.inf)
    for j, name in enumerate(model.joint_names):
        keys = [name] if name in given else [key for key in given if fnmatchcase(name, key)]
        if keys:
            value = given[keys[0]]
            limit[j] = math.inf if value is None else value
    return limit


def build_payload(thing: Object, scenario: Scenario) -> Payload:
    """The object's mass, and what is in it."""
    water = None if thing.contents is None else _water(thing.contents, thing, scenario)
    return Payload(float(thing.mass or 0.0), np.array(thing.com), np.array(thing.inertia), water)


def room_inside(contents: Contents, thing: Object) -> tuple[float, float]:
    """Radius and length of the room; `check_forces` has seen to it that they are known."""
    body = thing.surface
    radius, length = (body.radius, body.length) if isinstance(body, CylinderSpec) else (0.0, 0.0)
    return contents.radius or radius, contents.length or length


def _water(contents: Contents, thing: Object, scenario: Scenario) -> Water:
    radius, length = room_inside(contents, thing)
    pours = contents.pours
    names = [phase.name for phase in scenario.phases]
    return Water(
        mass=contents.mass,
        radius=radius,
        length=length,
        center=np.array(contents.center),
        density=contents.density,
        pours=-1 if pours is None else names.index(pours.phase),
        left=0.0 if pours is None else pours.to,
    )
