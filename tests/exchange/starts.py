"""Random starts of the exchange: what varies, by how much, and what converging means.

Fingers 3, 4 aim at contact points anywhere in [5, 45] and [-45, -5] deg, so that they slide over 15
to 55 deg of the contour. Beyond that every joint of the robot starts within 3 deg of the reference
start (fingers 1, 2 are then closed on the object, the others begin off it, up to 15 cm from where
they begin in the reference) and the object within 3 cm and 3 deg. Further away fingers 1, 2 soon
cannot reach the object at all, which is another matter. A start is numbered: its number seeds it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc.scenario import load

from .runs import REFERENCE, Run, check_laws, equilibrium, finger_distance, simulate

COUNT = 16
_JOINT = 3.0  # [deg]
_PLACE = 0.03  # [m]
_TURN = 3.0  # [deg]
_APART = 0.05  # [m], the safety distance; the goals of fingers 3, 4 may start 0.1 m apart


def variation(number: int) -> dict[str, Any]:
    """Overrides that make random start `number` of the reference scenario."""
    random = np.random.default_rng(number)
    third, fourth = random.uniform(5.0, 45.0, 2)
    position = random.uniform(-_PLACE, _PLACE, 2)
    overrides: dict[str, Any] = {
        "contacts.f3.at": [f"{third} deg"],
        "contacts.f4.at": [f"{-fourth} deg"],
        "object.pose.position": position,
        "object.pose.angle": f"{random.uniform(-_TURN, _TURN)} deg",
    }
    for joint, value in load(REFERENCE).scenario.robot.start.items():
        angle = np.rad2deg(value.value) + random.uniform(-_JOINT, _JOINT)
        overrides[f"robot.start.{joint}"] = f"{angle} deg"
    return overrides


def run(number: int, step: str = "2 ms") -> Run:
    """The exchange from random start `number`."""
    return simulate(overrides={**variation(number), "simulation.step": step})


def figures(result: Run) -> dict[str, float]:
    """What is asked of a random start, measured."""
    eps = result.series("residuals").max(axis=1)
    above = np.flatnonzero(eps >= 1e-6)
    sliding = np.rad2deg(result.state.contact.xi[2:, 0])
    return {
        "u3": float(np.rad2deg(result.assembly.start.contact.xi[2, 0])),
        "u4": float(np.rad2deg(result.assembly.start.contact.xi[3, 0])),
        "converged": float(result.t[above[-1]]) if len(above) else 0.0,
        "eps": float(eps[-1]),
        "eps_34": float(equilibrium(result, ["f3", "f4"])[-1].max()),
        "off_goal": float(np.abs(sliding - [60.0, -60.0]).max()),
        "object_error": float(result.object_error[result.t > 0.3].max()),
        "apart": float(finger_distance(result).min()),
        "joint": float(np.rad2deg(np.abs(result.q).max())),
        "step": float(result.velocity_steps.max()),
        "events": float(len(result.events)),
    }


def faults(result: Run) -> list[str]:
    """Why a random start did not do what it must; empty if it did."""
    found = []
    try:
        check_laws(result)
    except AssertionError as error:
        found.append(f"a law is broken: {str(error).splitlines()[0]}")
    phase = result.state.phase
    if not phase.done or phase.timeouts:
        name = result.assembly.controller.phases.phases[phase.current].name
        found.append(f"ended in phase '{name}', timed out: {', '.join(phase.timeouts) or 'none'}")
    reached = figures(result)
    for name, most in (("converged", 3.3), ("eps", 1e-6), ("eps_34", 1e-6), ("off_goal", 0.01),
                       ("object_error", 1e-6), ("joint", 115.0)):  # fmt: skip
        if not reached[name] <= most:
            found.append(f"{name} {reached[name]:.3g}, at most {most:.3g} wanted")
    if not reached["apart"] >= _APART:
        found.append(f"fingers {reached['apart']:.3g} m apart")
    return found
