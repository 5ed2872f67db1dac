"""How near a hand's own links come to each other in given postures."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wbc.arrays import Array
from wbc.robot.collision_scene import body_name, collision_scene
from wbc.robot.distances import Distances
from wbc.robot.hand import Hand
from wbc.robot.kinematics import Kinematics
from wbc.robot.pruning import prune


class SelfDistance(NamedTuple):
    """The nearest two links of a hand in one posture.

    Attributes:
        distance: of their collision shapes, negative where they penetrate, [m]; inf for a hand
            without a pair to measure.
        first, second: names of the links; "" without a pair.
    """

    distance: float
    first: str
    second: str


def self_distances(hand: Hand, postures: Array) -> tuple[SelfDistance, ...]:
    """The smallest distance between links of the hand in each of the postures (m, n), [rad].

    Measured are all pairs of its links but those that are near in every posture: links joined by a
    joint, a link and the next but one of the same finger (a first phalanx rolls over the palm's
    edge, a folded finger lies on its own root), and pairs that overlap throughout the ranges.
    """
    model = hand.model
    objects = model.geometry.geometryObjects
    kept = [
        (a, b)
        for a, b in prune(model, model.geometry, margin=math.inf).kept
        if {body_name(model, objects[a]), body_name(model, objects[b])} <= hand.links
        and not _next_but_one(hand, objects[a].parentJoint, objects[b].parentJoint)
    ]
    if not kept:
        return (SelfDistance(math.inf, "", ""),) * len(postures)
    scene = collision_scene(model, model.geometry, (), kept)
    kinematics, distances = Kinematics(model, ()), Distances(scene)
    rows = []
    for q in hand.configurations(postures):
        value = distances.update(kinematics.update(q), np.zeros(3), np.eye(3)).value
        least = int(value.argmin())
        rows.append(SelfDistance(float(value[least]), *scene.pair_names[least]))
    return tuple(rows)


def _next_but_one(hand: Hand, a: int, b: int) -> bool:
    """Whether of two of Pinocchio's joints one carries the other with a single one between them."""
    parents = hand.model.pin_model.parents
    return any(i > 0 and parents[i] > 0 and parents[parents[i]] == j for i, j in ((a, b), (b, a)))
