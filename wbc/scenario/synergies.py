"""The synergies that tasks name, whether they fit the robot, and weights by their names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np

from wbc.arrays import Array
from wbc.errors import WbcError, follower_refusal
from wbc.robot.model import RobotModel
from wbc.robot.packages import at_home, is_file
from wbc.scenario.kinds import SynergySpec
from wbc.scenario.schema import Scenario
from wbc.scenario.wording import Faults, KeyPath, clip
from wbc.synergies import Synergies, tables, weights_of

PUBLISHED: Final = "dexmart"
"""The name of the synergies that travel with wbc."""

_ROUNDING: Final = 1e-9  # [rad] by which a limit may be passed

Hands: TypeAlias = Mapping[str, Synergies]
"""The synergies of each synergy task."""


def tasks_of(scenario: Scenario) -> Iterator[tuple[str, SynergySpec]]:
    """The synergy tasks with their names."""
    return ((name, spec) for name, spec in scenario.tasks.items() if isinstance(spec, SynergySpec))


def read_hands(scenario: Scenario, folder: Path, faults: Faults) -> dict[str, Synergies]:
    """The synergies of every task whose can be read; a fault for each other.

    Args:
        folder: where the scenario's file lies.
    """
    hands = {}
    for name, spec in tasks_of(scenario):
        path: KeyPath = ("tasks", name, "synergies")
        file = folder / at_home(spec.synergies)
        if spec.synergies == PUBLISHED:
            hands[name] = Synergies.from_table()
        elif not is_file(file):
            near = [p.name for p in folder.glob("*.json")]
            remedy = faults.remedy(spec.synergies, [PUBLISHED, *near])
            faults.add(path, f"no such file, and no synergies of that name: {remedy}")
        else:
            try:
                hands[name] = Synergies.load(file)
            except WbcError as error:
                faults.add(path, str(error).replace(str(file), spec.synergies))
    return hands


def weights_named(name: str, hand: Synergies, *, published: bool) -> Array:
    """(k,) the weights of a name, [rad].

    Args:
        name: ``open``, the projection of all joints at zero (56); ``zero_offset``, α = 0; and of
            the published synergies the grasps C1 to C36 and G1 to G5.

    Raises:
        KeyError: no such name.
    """
    if name == "open":
        return hand.project(np.zeros(len(hand.joints)))
    if name == "zero_offset":
        return np.zeros(hand.count)
    if name not in known_names(published=published):
        raise KeyError(name)
    return weights_of(name)


def known_names(*, published: bool) -> tuple[str, ...]:
    """What `weights_named` knows."""
    grasps = (*tables().names, *tables().new_names) if published else ()
    return ("open", "zero_offset", *grasps)


def weights_in(given: Sequence[float] | str, spec: SynergySpec, hand: Synergies) -> Array:
    """(k,) weights as a checked scenario gives them, [rad]."""
    if isinstance(given, str):
        return weights_named(given, hand, published=spec.synergies == PUBLISHED)
    return np.array(given, dtype=np.float64)


def check_hands(scenario: Scenario, hands: Hands, model: RobotModel, faults: Faults) -> None:
    """Add a fault for every joint, range and weight of a synergy task that does not fit.

    Args:
        hands: from `read_hands`.
    """
    for name, spec in tasks_of(scenario):
        if name not in hands:
            continue
        hand, before = hands[name], len(faults.found)
        if spec.measure == "outside" and hand.count == len(hand.joints):
            text = f"{hand.count} synergies span all joints: nothing is outside them"
            faults.add(("tasks", name, "measure"), text)
        _check_joints(name, spec, hand, model, faults)
        fits = len(faults.found) == before
        for path, given in _weights(scenario, name, spec):
            weights = _checked(path, given, spec, hand, faults)
            if weights is not None and fits and spec.measure == "weights":
                _check_limits(path, spec, hand, weights, model, faults)


def _weights(
    scenario: Scenario, name: str, spec: SynergySpec
) -> Iterator[tuple[KeyPath, Sequence[float] | str]]:
    """Where weights are given for a task, and what."""
    if spec.weights is not None:
        yield ("tasks", name, "weights"), spec.weights
    for i, phase in enumerate(scenario.phases):
        if name in phase.weights:
            yield ("phases", i, "weights", name), phase.weights[name]


def _check_joints(
    name: str, spec: SynergySpec, hand: Synergies, model: RobotModel, faults: Faults
) -> None:
    here: KeyPath = ("tasks", name, "prefix" if spec.prefix else "synergies")
    missing = [j for j in hand.joints if spec.prefix + j not in model.joint_names]
    if len(missing) == len(hand.joints) and not any(
        spec.prefix + j in model.followers for j in missing
    ):
        others = _prefixes(hand, model)
        near = f"did you mean prefix: {' or '.join(others)}?" if others else "another hand's?"
        text = f"the robot has none of the synergies' joints, '{clip(spec.prefix + missing[0])}' "
        faults.add(here, f"{text}and so on ({near})")
        return
    for joint in missing:
        full = spec.prefix + joint
        if full in model.followers:
            faults.add(here, follower_refusal(full, model.followers[full]))
        else:
            faults.unknown(here, "joint", full, model.joint_names)
    for j, joint in enumerate(hand.joints):
        if joint in missing:
            continue
        k = model.joint(spec.prefix + joint)
        if model.is_prismatic(int(model.own[k])):
            faults.add(here, f"joint '{spec.prefix}{joint}' is prismatic: synergies are of angles")
        elif hand.lower[j] > model.upper[k] or hand.upper[j] < model.lower[k]:
            text = f"the range of joint '{spec.prefix}{joint}' in the synergies lies outside its "
            faults.add(here, text + "limits in the robot (are they of another hand?)")


def _prefixes(hand: Synergies, model: RobotModel) -> list[str]:
    """Those with which the robot has all joints of the hand."""
    first, known = hand.joints[0], set(model.joint_names)
    starts = [name.removesuffix(first) for name in model.joint_names if name.endswith(first)]
    return [p or "''" for p in starts if all(p + joint in known for joint in hand.joints)]


def _checked(
    path: KeyPath, given: Sequence[float] | str, spec: SynergySpec, hand: Synergies, faults: Faults
) -> Array | None:
    published = spec.synergies == PUBLISHED
    if isinstance(given, str):
        if given not in known_names(published=published):
            faults.unknown(path, "weights", given, known_names(published=published))
            return None
    elif len(given) != hand.count:
        count = f"{hand.count} weights" if hand.count > 1 else "1 weight"
        faults.add(path, f"must be {count}, one for each synergy, got {len(given)}")
        return None
    return weights_in(given, spec, hand)


def _check_limits(
    path: KeyPath, spec: SynergySpec, hand: Synergies, weights: Array, model: RobotModel,
    faults: Faults,
) -> None:  # fmt: skip
    places = [model.joint(spec.prefix + joint) for joint in hand.joints]
    posture, lower, upper = hand.posture(weights), model.lower[places], model.upper[places]
    beyond = np.abs(posture - np.clip(posture, lower, upper))
    j = int(np.argmax(beyond))
    if beyond[j] <= _ROUNDING:
        return
    limit = lower[j] if posture[j] < lower[j] else upper[j]
    at, far, end = (float(np.rad2deg(x)) for x in (posture[j], beyond[j], limit))
    more = int(np.sum(beyond > _ROUNDING)) - 1
    others = f", {more} more beyond theirs" if more else ""
    faults.add(
        path,
        f"take joint '{spec.prefix}{hand.joints[j]}' to {at:.4g} deg, {far:.3g} deg beyond its "
        f"limit {end:.4g} deg{others} (give smaller ones, or measure: posture, which stops there)",
    )
