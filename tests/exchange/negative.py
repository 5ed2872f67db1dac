"""Objects on which the exchange cannot be done, and what an honest end of the run looks like.

Planar chains that may not overlap need grasp lines that do not cross, and the double normals of an
ellipse or a circle all cross. Fingers 1, 2 hold the object where its normals lie on one line, at
+-90 deg, as the waisted contour's do at +-120 deg; left at +-120 deg they would not hold an ellipse
in force closure to begin with, and the sum over four fingers would vanish where no pair balances.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc.cli.session import run_meta
from wbc.recording import Outcome, Recorder, summarize

from .runs import Run, check_laws, equilibrium, finger_distance, link_distances, simulate

# Of the size of the reference object, 1 m x 0.72 m.
SHAPES: dict[str, dict[str, Any]] = {
    "ellipse": {"type": "ellipse", "a": "0.5 m", "b": "0.36 m"},
    "circle": {"type": "circle", "radius": "0.43 m"},
    "small circle": {"type": "circle", "radius": "0.36 m"},
    "large circle": {"type": "circle", "radius": "0.5 m"},
}
SAFETY = 0.05  # [m], of the scenario's collision cost


def overrides(shape: str, *, avoid: bool = True) -> dict[str, Any]:
    """The reference scenario with another object; without collision avoidance if not `avoid`."""
    found: dict[str, Any] = {
        "object.surface": SHAPES[shape],
        "contacts.f1.at": ["90 deg"],
        "contacts.f2.at": ["-90 deg"],
    }
    if not avoid:
        found["costs.collision.weight"] = 0.0
    return found


def run(shape: str, *, avoid: bool = True) -> Run:
    """The exchange tried on a shape."""
    return simulate(overrides=overrides(shape, avoid=avoid))


def summary(result: Run) -> dict[str, Any]:
    """What ``wbc run`` would write."""
    recorder = Recorder(run_meta(result.assembly), len(result.records))
    for record in result.records:
        recorder.append(record)
    controller = result.assembly.controller
    return summarize(recorder.finish(), Outcome.of(controller.phases, result.state.phase))


def figures(result: Run) -> dict[str, float]:
    """Where the run ended and how near anything came."""
    sliding = np.rad2deg(result.state.contact.xi[2:, 0])
    return {
        "eps_34": float(equilibrium(result, ["f3", "f4"])[-1].max()),
        "u3": float(sliding[0]),
        "u4": float(sliding[1]),
        "fingers": float(finger_distance(result).min()),
        "links": float(min(d.min() for d in link_distances(result).values())),
        "object_error": float(result.object_error[result.t > 0.3].max()),
        "events": float(len(result.events)),
    }


def faults(result: Run) -> list[str]:
    """What is dishonest or unsafe about the end of a run that cannot succeed; empty if nothing."""
    found = []
    try:
        check_laws(result)
    except AssertionError as error:
        found.append(f"a law is broken: {str(error).splitlines()[0]}")
    said, reached = summary(result), figures(result)
    if said["success"] or result.state.phase.done:
        found.append("the run says it succeeded")
    if "'slide' timed out" not in said["reason"] or "eps_f" not in said["reason"]:
        found.append(f"the reason given is: {said['reason']}")
    if said["violations"]:
        found.append(f"violated: {'; '.join(said['violations'])}")
    if not reached["links"] > 0.0:
        found.append(f"links overlap by {-reached['links']:.3g} m")
    elif not reached["fingers"] > 0.4 * SAFETY:
        found.append(f"fingers {reached['fingers']:.3g} m apart")
    if not reached["object_error"] < 1e-6:
        found.append(f"the object is {reached['object_error']:.3g} m off")
    if not reached["eps_34"] > 1e-4:
        found.append("fingers 3, 4 reached force closure")
    return found
