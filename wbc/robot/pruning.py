"""Which pairs of collision shapes are worth watching."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from wbc.robot.collision_scene import OBJECT, body_name, round_about, slide
from wbc.robot.model import RobotModel

_SAMPLES = 200
_SAME = 1e-6  # joints that are no further apart are at one place, [m]


class PairReport(NamedTuple):
    """What became of every pair of shapes; names are links (``object`` for the object).

    Attributes:
        kept: index pairs to watch.
        adjacent: pairs of links that share a joint.
        always: pairs in collision at every sampled configuration.
        never: pairs that cannot come within the margin, however the joints turn.
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
    """Sort all pairs of shapes.

    A pair is dropped as never near only where the links' lengths forbid it: samples would miss
    rare meetings. Samples over the joint limits, with a fixed seed, find the pairs that overlap
    always. Pairs with the object are never dropped: the object moves.

    Args:
        geometry: pin.GeometryModel, as from `with_object`.
        margin: pairs that cannot come closer than this are dropped, [m].
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
    high = _largest_sampled(model, geometry, candidates, seed)
    kept, always, never = [], set(), set()
    for k, (a, b) in enumerate(candidates):
        pair = (names[a], names[b])
        if OBJECT in pair:
            kept.append((a, b))
        elif high[k] < 0.0:
            always.add(pair)
        elif _least_possible(model, objects[a], objects[b]) > margin:
            never.add(pair)
        else:
            kept.append((a, b))
    return PairReport(
        tuple(kept), *(tuple(sorted(s)) for s in (adjacent, always, never, switched_off))
    )


def _adjacent(model: RobotModel, a: Any, b: Any) -> bool:
    """Whether two shapes ride on the same joint, on neighbours, or on joints at one place."""
    i, j = a.parentJoint, b.parentJoint
    if i == j or j in _neighbours(model, i) or i in _neighbours(model, j):
        return True
    parents, placements = model.pin_model.parents, model.pin_model.jointPlacements
    if i == 0 or j == 0 or parents[i] != parents[j]:
        return False
    return bool(np.linalg.norm(placements[i].translation - placements[j].translation) < _SAME)


def _neighbours(model: RobotModel, joint: int) -> list[int]:
    """Pinocchio's joint before this one, and before that as long as they turn at one place."""
    found = []
    while joint > 0:
        before = model.pin_model.parents[joint]
        found.append(before)
        if before == 0 or model.is_prismatic(before - 1) or _length(model, joint - 1) > _SAME:
            break
        joint = before
    return found


def _least_possible(model: RobotModel, a: Any, b: Any) -> float:
    """A distance that two shapes keep whatever the joints do, [m]; negative where nothing is known.

    It holds for joints that follow others all the more: here they are free.

    Seen from the last joint that carries both, each shape stays in a ball about the origin of the
    first joint that carries it alone, as wide as its way along the links.
    """
    chains = [model.chain(o.parentJoint) for o in (a, b)]
    shared = 0
    while shared < min(map(len, chains)) and chains[0][shared] == chains[1][shared]:
        shared += 1
    centers, radii = [], []
    for o, chain in zip((a, b), chains, strict=True):
        ends, radius, _ = round_about(o)
        far = max(np.linalg.norm(ends[:3]), np.linalg.norm(ends[3:])) + radius
        own = chain[shared:]
        if not own:  # carried by the shared joint itself: it does not move
            centers.append(0.5 * (ends[:3] + ends[3:]))
            radii.append(0.5 * np.linalg.norm(ends[:3] - ends[3:]) + radius)
            continue
        centers.append(model.pin_model.jointPlacements[own[0] + 1].translation)
        slides = sum(slide(model, joint) for joint in own)
        radii.append(far + sum(_length(model, joint) for joint in own[1:]) + slides)
    return float(np.linalg.norm(centers[0] - centers[1]) - radii[0] - radii[1])


def _length(model: RobotModel, joint: int) -> float:
    return float(np.linalg.norm(model.pin_model.jointPlacements[joint + 1].translation))


def _largest_sampled(
    model: RobotModel, geometry: Any, pairs: list[tuple[int, int]], seed: int
) -> Any:
    """Largest sampled distance of each pair."""
    geometry = geometry.copy()
    geometry.removeAllCollisionPairs()
    for a, b in pairs:
        geometry.addCollisionPair(pin.CollisionPair(a, b))
    data, geometry_data = model.pin_model.createData(), pin.GeometryData(geometry)
    results = [geometry_data.distanceResults[k] for k in range(len(pairs))]
    high = np.full(len(pairs), -np.inf)
    random = np.random.default_rng(seed)
    for _ in range(_SAMPLES if pairs else 0):
        q = model.full(random.uniform(model.lower, model.upper))
        pin.updateGeometryPlacements(model.pin_model, data, geometry, geometry_data, q)
        pin.computeDistances(geometry, geometry_data)
        np.maximum(high, [r.min_distance for r in results], out=high)
    return high
