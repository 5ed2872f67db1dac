"""Check of the ``<mimic>`` tags of a URDF, and the joints they couple."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

from wbc.robot.strict_xml import Faults, Node, Scope, shown
from wbc.robot.urdf_joint import Joint, Limits


@final
@dataclass(frozen=True)
class Coupling:
    """A joint that follows another: its position is ratio times its master's plus offset.

    Attributes:
        master: the independent joint at the head of the chain of mimics.
        ratio: the product of the multipliers along the chain.
        offset: [rad] or [m].
    """

    master: str
    ratio: float
    offset: float


def couplings(joints: list[Joint], faults: Faults) -> dict[str, Coupling]:
    """The moving joints that follow another, by name; chains of mimics are followed to their head.

    A fault is a mimic of an unknown or a fixed joint, a ring of mimics, and a multiplier of 0,
    which would be a fixed joint.
    """
    by_name = {joint.name: joint for joint in joints if joint.name is not None}
    # the file's own words: name of the leader, multiplier, offset
    links = {
        name: (follow, joint.multiplier, joint.offset)
        for name, joint in by_name.items()
        if (follow := _leader(joint, by_name, faults)) is not None and joint.moves
    }
    return {
        name: coupling
        for name in links
        if (coupling := _followed(by_name[name], links, faults)) is not None
    }


def _leader(joint: Joint, by_name: dict[str, Joint], faults: Faults) -> str | None:
    """The joint that `joint` mimics; None where it mimics none that can lead."""
    mimic = joint.node.first("mimic")
    leader = None if mimic is None else mimic.attributes.get("joint")
    if mimic is None or leader is None:
        return None
    scope = Scope(faults, joint.where)
    if leader not in by_name:
        what = f"mimics the unknown joint '{shown(leader)}'{faults.hint(leader, by_name)}"
        scope.fault(mimic, what, "name a <joint> of this file")
    elif leader == joint.name:
        scope.fault(mimic, "mimics itself", "name the joint to follow, or remove <mimic>")
    elif by_name[leader].type == "fixed" and joint.moves:
        what = f"mimics '{shown(leader)}', which is fixed"
        scope.fault(mimic, what, "name a moving joint, or remove <mimic>")
    else:
        return leader
    return None


def _followed(
    joint: Joint, links: dict[str, tuple[str, float, float]], faults: Faults
) -> Coupling | None:
    """q = ratio s + offset along a chain of mimics; None where the chain is a ring."""
    assert joint.name is not None
    way = [joint.name]
    ratio, offset = 1.0, 0.0
    while way[-1] in links:
        leader, multiplier, shift = links[way[-1]]
        ratio, offset = ratio * multiplier, ratio * shift + offset
        if leader in way:
            ring = way[way.index(leader) :]
            if joint.name == min(ring):  # once per ring
                through = ", ".join(f"'{shown(name)}'" for name in ring[:8])
                what = f"the joints {through} mimic each other"
                Scope(faults, joint.where).fault(_tag(joint), what, "one of them has to lead")
            return None
        way.append(leader)
    if not (ratio != 0.0 and math.isfinite(ratio) and math.isfinite(offset)):
        # a multiplier of 0 is a fault of the joint that has it, not of those that follow this one
        if 0.0 not in [links[name][1] for name in way[1:-1]]:
            what = f"follows '{shown(way[-1])}' by {ratio:g} times its position"
            remedy = "write another multiplier, or make the joint fixed"
            Scope(faults, joint.where).fault(_tag(joint), what, remedy)
        return None
    return Coupling(way[-1], ratio, offset)


def narrowed(joints: list[Joint], found: dict[str, Coupling], faults: Faults) -> dict[str, Limits]:
    """Limits of the joints that lead others, such that these keep theirs too.

    A fault where nothing is left.
    """
    by_name = {joint.name: joint for joint in joints if joint.name is not None}
    limits: dict[str, Limits] = {}
    for name, coupling in found.items():
        master, ratio, offset = coupling.master, coupling.ratio, coupling.offset
        own, lead = by_name[name].limits, limits.get(master, by_name[master].limits)
        if own is None or lead is None:
            continue  # missing limits are a fault of their own
        low, high = sorted(((own.lower - offset) / ratio, (own.upper - offset) / ratio))
        rest = Limits(
            max(lead.lower, low) + 0.0,  # no -0.0, which NumPy's samples take for less than 0.0
            min(lead.upper, high) + 0.0,
            min(lead.velocity, own.velocity / abs(ratio)),
        )
        if rest.lower > rest.upper:
            what = (
                f"its limits ask '{shown(master)}' to stay in [{low:.6g}, {high:.6g}], "
                f"which is outside [{lead.lower:.6g}, {lead.upper:.6g}]"
            )
            remedy = "change the multiplier, the offset or the limits"
            Scope(faults, by_name[name].where).fault(_tag(by_name[name]), what, remedy)
            continue
        limits[master] = rest
    return limits


def _tag(joint: Joint) -> Node:
    return joint.node.first("mimic") or joint.node
