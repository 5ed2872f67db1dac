"""Names of a scenario that only the robot can judge."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Literal

from wbc.errors import follower_refusal
from wbc.scenario.blocks import EVERY
from wbc.scenario.kinds import (
    CollisionSpec,
    FrameOrientationSpec,
    FramePoseSpec,
    FramePositionSpec,
    JointLimitsSpec,
    PalmDistanceSpec,
    PostureSpec,
    RelativePoseSpec,
)
from wbc.scenario.patterns import matching
from wbc.scenario.schema import Scenario
from wbc.scenario.units import Coordinate
from wbc.scenario.wording import Fault, Faults, KeyPath

_FRAMED = (
    PalmDistanceSpec,
    FramePoseSpec,
    FramePositionSpec,
    FrameOrientationSpec,
    RelativePoseSpec,
)


def check_names(
    scenario: Scenario,
    joints: Collection[str],
    frames: Collection[str],
    links: Collection[str],
    prismatic: Collection[str] = (),
    followers: Mapping[str, str] | None = None,
) -> list[Fault]:
    """Joints, frames and links that the robot does not have, as faults that `Loaded.error` locates.

    Args:
        scenario: the scenario.
        joints: names of the actuated joints, and `prismatic` those of them that take a length.
        frames: names of all frames.
        links: names of the bodies that can collide.
        prismatic: a subset of `joints`.
        followers: joints that follow another (mimic), each with the one to name in its place.
    """
    faults, driven = Faults(), followers or {}
    named: list[tuple[KeyPath, str, Literal["key", "value"]]] = [
        *((path, joint, "key") for path, joint in _joints(scenario)),
        *((path, joint, "value") for path, joint in _listed_joints(scenario)),
    ]
    for path, joint, on in named:
        if on == "value" and "*" in joint and matching([joint], joints):
            continue
        if joint in driven:
            faults.add(path, follower_refusal(joint, driven[joint]), on=on)
        elif joint not in joints:
            faults.unknown(path, "joint", joint, joints, on=on)
    for table, keys in _patterns(scenario):
        for joint in keys:
            if joint in driven:
                faults.add((*table, joint), follower_refusal(joint, driven[joint]), on="key")
            elif joint != EVERY and not matching([joint], joints):
                faults.unknown((*table, joint), "joint", joint, joints, on="key")
    for path, joint, value in _positions(scenario):
        wanted = "length" if joint in prismatic else "angle"
        if joint in joints and value.dimension not in (wanted, "any"):
            faults.add(path, f"joint '{joint}' takes {'an' if wanted == 'angle' else 'a'} {wanted}")
    for path, frame in _frames(scenario):
        if frame not in frames:
            faults.unknown(path, "frame", frame, frames)
    _links(scenario, links, faults)
    return faults.found


def _patterns(scenario: Scenario) -> Iterator[tuple[KeyPath, Mapping[str, float | None]]]:
    """The tables by joint or pattern."""
    if scenario.forces is not None:
        yield ("forces", "torque_limits"), scenario.forces.torque_limits
    physics, second = scenario.simulation.physics, scenario.force_control
    yield ("simulation", "physics", "armature"), physics.armature
    yield ("simulation", "physics", "joint_damping"), physics.joint_damping
    if second is not None:
        yield ("force_control", "damping"), second.damping
        yield ("force_control", "arms", "stiffness"), second.arms.stiffness
        yield ("force_control", "arms", "damping"), second.arms.damping


def _positions(scenario: Scenario) -> Iterator[tuple[KeyPath, str, Coordinate]]:
    yield from _entries(("robot", "start"), scenario.robot.start)
    for name, task in scenario.tasks.items():
        if isinstance(task, PostureSpec) and task.target is not None:
            yield from _entries(("tasks", name, "target"), task.target)
    for name, cost in scenario.costs.items():
        if isinstance(cost, JointLimitsSpec):
            yield from _entries(("costs", name, "lower"), cost.lower)
            yield from _entries(("costs", name, "upper"), cost.upper)


def _entries(
    path: KeyPath, values: Mapping[str, Coordinate]
) -> Iterator[tuple[KeyPath, str, Coordinate]]:
    return (((*path, joint), joint, value) for joint, value in values.items() if joint != EVERY)


def _joints(scenario: Scenario) -> Iterator[tuple[KeyPath, str]]:
    yield from ((path, joint) for path, joint, _ in _positions(scenario))
    yield from ((("robot", "metric", joint), joint) for joint in scenario.robot.metric)


def _listed_joints(scenario: Scenario) -> Iterator[tuple[KeyPath, str]]:
    for name, task in scenario.tasks.items():
        if isinstance(task, PostureSpec):
            for i, joint in enumerate(task.joints or ()):
                yield ("tasks", name, "joints", i), joint


def _frames(scenario: Scenario) -> Iterator[tuple[KeyPath, str]]:
    for finger, frame in scenario.robot.fingers.items():
        yield ("robot", "fingers", finger), frame
    for name, task in scenario.tasks.items():
        if isinstance(task, _FRAMED):
            yield ("tasks", name, "frame"), task.frame
        if isinstance(task, RelativePoseSpec):
            yield ("tasks", name, "reference"), task.reference


def _links(scenario: Scenario, links: Collection[str], faults: Faults) -> None:
    # The object takes part in collisions like a link.
    known = [*links, *(["object"] if scenario.object is not None else [])]
    for path, pair in _pairs(scenario):
        for i, link in enumerate(pair):
            if link not in known:
                faults.unknown((*path, i), "link", link, known)
        if pair[0] == pair[1]:
            faults.add(path, "pairs a link with itself")


def _pairs(scenario: Scenario) -> Iterator[tuple[KeyPath, tuple[str, str]]]:
    collisions = scenario.robot.collisions
    lists: list[tuple[KeyPath, Iterable[tuple[str, str]]]] = [
        (("robot", "collisions", "pairs"), collisions.pairs or ()),
        (("robot", "collisions", "ignore"), collisions.ignore),
    ]
    for name, cost in scenario.costs.items():
        if isinstance(cost, CollisionSpec):
            lists.append((("costs", name, "pairs"), cost.pairs or ()))
    for path, pairs in lists:
        for i, pair in enumerate(pairs):
            yield (*path, i), pair
