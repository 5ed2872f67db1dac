"""Cost blocks to costs, and the collision pairs they watch."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array, read_only
from wbc.contact.grasp import Grasp
from wbc.costs import Collision, Cost, JointLimits
from wbc.errors import ScenarioError, WbcError
from wbc.robot.collision_scene import (
    OBJECT,
    CollisionScene,
    body_name,
    collision_scene,
    with_object,
)
from wbc.robot.model import RobotModel
from wbc.robot.pruning import PairReport, prune
from wbc.robot.srdf import disabled_pairs
from wbc.scenario.kinds import CollisionSpec, JointLimitsSpec, limit_of
from wbc.scenario.load import Loaded
from wbc.scenario.places import pairs_file
from wbc.scenario.schema import Scenario

# Pairs that keep this many safety distances apart wherever the joints go are not watched.
_NEVER = 3.0
# How far the object's convex pieces may stand out of it, [m]: fewer pieces, a little more caution.
_EXCESS = 5e-3
_FLOOR = 0.04  # of the safety distance: where the cost's slope stops growing


def watched_pairs(
    loaded: Loaded, model: RobotModel, grasp: Grasp
) -> tuple[CollisionScene | None, PairReport | None]:
    """The collision scene of all collision costs together; None where there is no such cost."""
    scenario = loaded.scenario
    specs = [c for c in scenario.costs.values() if isinstance(c, CollisionSpec)]
    if not specs:
        return None, None
    pieces = grasp.surface.convex_pieces(excess=_EXCESS) if grasp.count else []
    geometry, added = with_object(model, pieces)
    off = set(scenario.robot.collisions.ignore)
    if scenario.robot.srdf is not None:
        links = {f.name for f in model.pin_model.frames}
        try:
            file = pairs_file(scenario.robot.srdf, loaded.path.parent)
        except WbcError as error:
            raise ScenarioError(f"{loaded.locate(('robot', 'srdf'))}: {error}") from None
        off |= set(disabled_pairs(file, links))
    names = [body_name(model, o) for o in geometry.geometryObjects]
    # a link that ends in a fingertip touches the object: that is what it is for
    tips = {
        model.pin_model.frames[model.frame(scenario.robot.fingers[f])].parentJoint
        for f in grasp.fingers
    }
    off |= {
        (name, OBJECT)
        for name, o in zip(names, geometry.geometryObjects, strict=True)
        if o.parentJoint in tips and name != OBJECT
    }
    margin = _NEVER * max(spec.safety_distance for spec in specs)
    report = prune(
        model, geometry, margin=margin, disabled=sorted(off), seed=scenario.simulation.seed
    )
    listed = scenario.robot.collisions.pairs
    if listed is not None:
        chosen = {frozenset(p) for p in listed}
        kept = tuple(
            (a, b)
            for a in range(len(names))
            for b in range(a + 1, len(names))
            if frozenset((names[a], names[b])) in chosen
        )
        report = report._replace(kept=kept)
    return collision_scene(model, geometry, added, report.kept), report


def safety_distance(scenario: Scenario) -> float | None:
    """The largest of the collision costs, [m]; None where none watches anything."""
    specs = scenario.costs.values()
    return max((c.safety_distance for c in specs if isinstance(c, CollisionSpec)), default=None)


def build_costs(scenario: Scenario, model: RobotModel, scene: CollisionScene | None) -> list[Cost]:
    """The scenario's costs in the order of the file."""
    costs: list[Cost] = []
    for name, spec in scenario.costs.items():
        if isinstance(spec, JointLimitsSpec):
            room = spec.margin * (model.upper - model.lower)
            lower = _bounds(spec, model, "lower", model.lower + room)
            upper = _bounds(spec, model, "upper", model.upper - room)
            if np.any(lower >= upper):
                joint = model.joint_names[int(np.argmax(lower >= upper))]
                raise ScenarioError(f"costs.{name}: lower must be below upper for joint '{joint}'")
            costs.append(
                JointLimits(
                    name,
                    spec.weight,
                    lower,
                    upper,
                    spec.stiffness,
                    spec.delta,
                    printed=spec.form == "printed",
                )
            )
        elif isinstance(spec, CollisionSpec) and scene is not None:
            costs.append(_collision(name, spec, scene))
    return costs


def _bounds(spec: JointLimitsSpec, model: RobotModel, side: str, default: Array) -> Array:
    """Soft bounds by joint; `default` for a joint that is not named."""
    values = getattr(spec, side)
    return read_only(
        [
            default[j] if (value := limit_of(values, joint)) is None else value.value
            for j, joint in enumerate(model.joint_names)
        ]
    )


def _collision(name: str, spec: CollisionSpec, scene: CollisionScene) -> Cost:
    pairs = range(len(scene.pair_names))
    if spec.pairs is not None:
        chosen = {frozenset(p) for p in spec.pairs}
        pairs = [k for k in pairs if frozenset(scene.pair_names[k]) in chosen]  # type: ignore[assignment]
    floor = _FLOOR * spec.safety_distance if spec.floor is None else spec.floor
    return Collision(
        name, spec.weight, np.array(pairs, dtype=np.int64), spec.safety_distance, max(floor, 1e-6),
        spec.stiffness, printed=spec.form == "printed",
    )  # fmt: skip
