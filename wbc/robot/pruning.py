"""Which pairs of collision shapes are worth watching."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from wbc.robot.distances import OBJECT, body_name
from wbc.robot.model import RobotModel

_SAMPLES = 600


class PairReport(NamedTuple):
    """What became of every pair of shapes; names are links (``object`` for the object).

    Attributes:
        kept: index pairs to watch.
        adjacent: pairs of links that share a joint.
        always: pairs in collision at every sampled configuration.
        never: pairs that stay clear of the margin at every sampled configuration.
        disabled: pairs switched off by the SRDF or the scenario.
    """

    kept: tuple[tuple[int, int], ...]
    adjacent: tuple[tuple[str, str], ...]
    always: tuple[tuple[str, str], ...]
    never: tuple[tuple[str, str], ...]
    disabled: tuple[tuple[str, str], ...]


def prune(
    model: RobotModel,
    geometry: Any,
    *,
    margin: float,
    disabled: Collection[tuple[str, str]] = (),
    seed: int = 0,
) -> PairReport:
    """Sort all pairs of shapes; robot pairs are sampled over the joint limits with a fixed seed.

    Pairs with the object are never dropped by sampling: the object moves.

    Args:
        geometry: pin.GeometryModel, as from `with_object`.
        margin: pairs that never come closer than this in the samples are dropped, [m].
        disabled: pairs of link names to leave out, in either order.
    """
    objects = geometry.geometryObjects
    names = [body_name(model, o) for o in objects]
    off = {frozenset(p) for p in disabled}
    candidates: list[tuple[int, int]] = []
    adjacent, switched_off = set(), set()
    for a in range(len(names)):
        for b in range(a + 1, len(names)):
            pair = (names[a], names[b])
            if names[a] == names[b]:
                continue
            if frozenset(pair) in off:
                switched_off.add(pair)
            elif OBJECT not in pair and _adjacent(model, objects[a], objects[b]):
                adjacent.add(pair)
            else:
                candidates.append((a, b))
    low, high = _sampled_range(model, geometry, candidates, seed)
    kept, always, never = [], set(), set()
    for k, (a, b) in enumerate(candidates):
        pair = (names[a], names[b])
        if OBJECT in pair:
            kept.append((a, b))
        elif high[k] < 0.0:
            always.add(pair)
        elif low[k] > margin:
            never.add(pair)
        else:
            kept.append((a, b))
    return PairReport(
        tuple(kept), *(tuple(sorted(s)) for s in (adjacent, always, never, switched_off))
    )


def _adjacent(model: RobotModel, a: Any, b: Any) -> bool:
    """Whether two shapes ride on the same joint, on neighbours, or on joints at one place."""
    i, j = a.parentJoint, b.parentJoint
    parents, placements = model.pin_model.parents, model.pin_model.jointPlacements
    if i == j or (i > 0 and parents[i] == j) or (j > 0 and parents[j] == i):
        return True
    if i == 0 or j == 0 or parents[i] != parents[j]:
        return False
    return bool(np.linalg.norm(placements[i].translation - placements[j].translation) < 1e-6)


def _sampled_range(
    model: RobotModel, geometry: Any, pairs: list[tuple[int, int]], seed: int
) -> tuple[Any, Any]:
    """Least and largest sampled distance of each pair."""
    geometry = geometry.copy()
    geometry.removeAllCollisionPairs()
    for a, b in pairs:
        geometry.addCollisionPair(pin.CollisionPair(a, b))
    data, geometry_data = model.pin_model.createData(), pin.GeometryData(geometry)
    results = [geometry_data.distanceResults[k] for k in range(len(pairs))]
    low, high = np.full(len(pairs), np.inf), np.full(len(pairs), -np.inf)
    random = np.random.default_rng(seed)
    for _ in range(_SAMPLES if pairs else 0):
        q = random.uniform(model.lower, model.upper)
        pin.updateGeometryPlacements(model.pin_model, data, geometry, geometry_data, q)
        pin.computeDistances(geometry, geometry_data)
        d = np.array([r.min_distance for r in results])
        np.minimum(low, d, out=low)
        np.maximum(high, d, out=high)
    return low, high
