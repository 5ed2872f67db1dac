"""What the planned contact points alone tell, before anything moves.

Only what needs no configuration of the robot: whether the straight ways of the tips to their
contact points go through the object, and whether the contact points can hold it at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, final

import numpy as np

from wbc.arrays import Array
from wbc.contact.classify import friction_needed
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactMode
from wbc.contact.surfaces import Surface
from wbc.control.phases import Phase
from wbc.forces import ForceStatus

_STEP = 1e-3  # between the points at which a way is looked at, [m]
_MOST_POINTS = 500
_GRAZE = 5e-4  # a way that goes no deeper than this is not said to go through the object, [m]
_PLAUSIBLE = 1.0  # a friction coefficient above this few pads have: it is a warning
_CORNER = 5e-3  # one that goes no deeper cuts a corner, which a pad may take; it is a warning, [m]


@final
@dataclass(frozen=True)
class Fault:
    """Why an exchange cannot be carried out.

    Attributes:
        about: what to change first: the robot's start, the object's pose, a phase, a contact.
        text: one sentence: who, where, how far, and in brackets a remedy.
        phase: index of the phase; None at the start.
        finger: whose contact it is about; None where no single one is to blame.
        grave: False for a warning: it can be carried out, but perhaps not as it was meant.
    """

    about: Literal["start", "object", "phase", "contact"]
    text: str
    phase: int | None = None
    finger: str | None = None
    grave: bool = True


class Inside(NamedTuple):
    """How a straight way goes through the object.

    Attributes:
        depth: its deepest point below the surface, [m].
        left: from where it comes in to its end, [m].
    """

    depth: float
    left: float


def through(surface: Surface, start: Array, end: Array) -> Inside | None:
    """Where the straight way from `start` to `end`, (3,) [m], object frame, goes through it.

    None where it stays outside, and where a coordinate is no number.
    """
    length = float(np.linalg.norm(end - start))
    if not math.isfinite(length):
        return None
    points = np.linspace(start, end, min(_MOST_POINTS, math.ceil(length / _STEP)) + 1)
    levels = np.array([surface.level(point) for point in points])
    if not levels.min() < -_GRAZE:
        return None
    first = int(np.argmax(levels < 0.0)) / max(len(points) - 1, 1)
    return Inside(-float(levels.min()), (1.0 - first) * length)


def way_fault(phase: Phase, index: int, finger: str, inside: Inside) -> Fault:
    """The sentence about a way through the object; a warning where it only cuts a corner."""
    return Fault(
        "contact",
        f"phase '{phase.name}': the straight way of finger '{finger}' goes through the object, "
        f"{1e3 * inside.depth:.1f} mm below its surface, {1e3 * inside.left:.0f} mm before its end "
        "(put its contact point on the side it comes from, or let a reach with an offset lead it "
        "round)",
        index,
        finger,
        inside.depth > _CORNER,
    )


def loose_fault(
    phase: Phase, index: int, fingers: tuple[str, ...], friction: float
) -> Fault | None:
    """The sentence about a grasp that needs the given friction; None where it is plausible."""
    if friction <= _PLAUSIBLE:
        return None
    *others, last = (f"'{finger}'" for finger in fingers)
    who = f"{', '.join(others)} and {last}" if others else last
    if math.isinf(friction):
        what = f"{'do' if others else 'does'} not hold the object: the grasp is not force closed, "
        what += "whatever the friction"
    else:
        what = f"hold the object only with a friction above {friction:.2f}"
    remedy = "put contact points on opposite sides of the object"
    text = f"phase '{phase.name}': {who} {what} ({remedy})"
    return Fault("contact", text, index, fingers[0], math.isinf(friction))


def load_fault(phase: Phase, index: int, load: tuple[ForceStatus, float]) -> Fault | None:
    """The sentence about an object that cannot be held at rest; None where it can.

    Args:
        load: from `ForcePlanner.at_rest`.
    """
    status, factor = load
    weak = "the joints are too weak for what they carry"
    if factor > 0.0:
        weak = f"the joints are too weak: they hold {factor:.2g} of the object's weight"
    found = {
        ForceStatus.INFEASIBLE_TORQUE_LIMITS: (
            weak, "lighten it, or raise forces.torque_limits or forces.friction"
        ),
        ForceStatus.INFEASIBLE_FRICTION: (
            "friction cannot hold the object's weight", "raise it, or choose other contact points"
        ),
        ForceStatus.RANK_DEFICIENT: (
            "these contacts cannot resist every load", "give it three, or two soft fingers"
        ),
    }  # fmt: skip
    if status not in found:
        return None
    what, remedy = found[status]
    return Fault("phase", f"phase '{phase.name}': {what} ({remedy})", index)


def plan_faults(phases: tuple[Phase, ...], kin: ExtendedKinematics, tips: Array) -> list[Fault]:
    """Ways through the object and grasps that cannot hold it, each told once.

    What depends on where a contact has slid to, or where a tip is that nothing leads, is left out.

    Args:
        phases: all, in order.
        kin: updated at the start, with the planned contact points.
        tips: (N, 3) where each tip is then, [m], object frame.
    """
    grasp, tips = kin.grasp, tips.copy()
    planned = np.ones(grasp.count, dtype=np.bool_)  # the contact point is where it was planned
    said: set[tuple[str, ...]] = set()
    faults: list[Fault] = []
    for index, phase in enumerate(phases):
        for i, finger in enumerate(grasp.fingers):
            planned[i] &= phase.mode[i] != ContactMode.SLIDING
            goal = phase.tip_goal(grasp, i, kin.charts[i, 0], kin.frame[i, :, 2])
            goal = goal if planned[i] else np.full(3, np.nan)
            if phase.mode[i] == ContactMode.FREE and (finger,) not in said:
                inside = through(grasp.surface, tips[i], goal)
                if inside is not None:
                    faults.append(way_fault(phase, index, finger, inside))
                    said.add((finger,))
            tips[i] = goal
        held = np.flatnonzero(phase.mode != ContactMode.FREE)
        fingers = tuple(grasp.fingers[i] for i in held)
        if not len(held) or not planned[held].all() or ("hold", *fingers) in said:
            continue
        said.add(("hold", *fingers))
        points, normals = kin.charts[held, 0], kin.frame[held, :, 2]
        friction = friction_needed(points, normals, planar=grasp.planar)
        loose = loose_fault(phase, index, fingers, friction)
        faults += [] if loose is None else [loose]
    return faults
