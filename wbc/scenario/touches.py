"""Check of how fingers come to the object: a contact begins where the tip already is."""

from __future__ import annotations

from itertools import pairwise

from wbc.scenario.schema import Scenario
from wbc.scenario.wording import Fault, Faults


def check_touches(scenario: Scenario) -> list[Fault]:
    """Faults of fingers that are away from their contact point when a phase makes them touch.

    From then on the contact's rows take the tip to be on the surface: a distance that is left would
    be an error of the object's pose, and closed at the full gain of the main task. The fingers of
    the first phase are closed on the object before the run.
    """
    faults = Faults([])
    for i, (before, phase) in enumerate(pairwise(scenario.phases), start=1):
        for finger in phase.contacts:
            if finger in before.contacts:
                continue
            goal = before.reach.get(finger)
            if goal is None:
                what = f"does not touch in phase '{before.name}' and reaches for nothing there"
            elif goal.clearance != 0.0:
                what = f"is {1e3 * goal.clearance:.3g} mm away when phase '{before.name}' ends"
            elif any(goal.offset):
                what = f"is beside its contact point when phase '{before.name}' ends"
            else:
                continue
            remedy = "let it reach with clearance 0 m in the phase before it touches"
            faults.add(("phases", i, "contacts", finger), f"the finger {what}: {remedy}", on="key")
    return faults.found
