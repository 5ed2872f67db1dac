"""Task blocks to task functions: one row of `BUILDERS` per type."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from wbc.arrays import Array, IntArray, read_only
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import Grasp
from wbc.rotations import rotation_from_quaternion
from wbc.scenario import kinds
from wbc.scenario.kinds import TaskSpec
from wbc.scenario.patterns import matching
from wbc.scenario.schema import Scenario
from wbc.scenario.synergies import Hands, weights_in
from wbc.tasks import (
    CenterOfMass,
    EquilibriumForce,
    EquilibriumMoment,
    FrameOrientation,
    FramePose,
    FramePosition,
    Manipulability,
    PalmDistance,
    Posture,
    RelativePose,
    Synergy,
    Task,
    TipPosition,
)

_TIP_SATURATION = math.inf
_FRAME_FIELDS = ("frame", "reference")


def tip_frames(scenario: Scenario, grasp: Grasp) -> tuple[str, ...]:
    """The frame of each finger's tip, in the order of the grasp."""
    return tuple(scenario.robot.fingers[name] for name in grasp.fingers)


def tracked_frames(scenario: Scenario, grasp: Grasp) -> tuple[str, ...]:
    """Fingertips in the order of the grasp, then every other frame a task names, once."""
    frames = list(tip_frames(scenario, grasp))
    for spec in scenario.tasks.values():
        for field in _FRAME_FIELDS:
            name = getattr(spec, field, None)
            if isinstance(name, str) and name not in frames:
                frames.append(name)
    return tuple(frames)


def build_tasks(
    scenario: Scenario, names: Sequence[str], kin: ExtendedKinematics, q_start: Array, hands: Hands
) -> list[Task]:
    """The stack's tasks in order of priority, then one tip task per finger."""
    context = Context(scenario, kin, q_start, hands)
    tasks = [
        BUILDERS[type(scenario.tasks[name])](name, scenario.tasks[name], context) for name in names
    ]
    tips = [
        TipPosition(f"tip_{finger}", kin.gain, _TIP_SATURATION, i, kin.grasp.planar)
        for i, finger in enumerate(kin.grasp.fingers)
    ]
    return [*tasks, *tips]


class Context:
    """What builders look at beside their block.

    Attributes:
        scenario, kin: the scenario and the tick's workspace.
        q_start: (nv,) the start, for tasks whose target is where they begin.
        hands: the synergies of each synergy task.
        planar: whether poses have the rows x, y, yaw only.
    """

    def __init__(
        self, scenario: Scenario, kin: ExtendedKinematics, q_start: Array, hands: Hands
    ) -> None:
        self.scenario = scenario
        self.kin = kin
        self.q_start = q_start
        self.hands = hands
        self.planar = kin.robot.model.planar

    def frame(self, name: str) -> int:
        """Place of a tracked frame."""
        return self.kin.robot.index(name)


def _common(name: str, spec: TaskSpec) -> tuple[str, float, float]:
    return name, spec.gain, math.inf if spec.saturation is None else spec.saturation


def _pose(position: Sequence[float], quaternion: Sequence[float]) -> Array:
    rotation = rotation_from_quaternion(np.array(quaternion))
    return read_only(np.concatenate([np.array(position, dtype=np.float64), rotation.ravel()]))


def _axes(names: Sequence[str]) -> IntArray:
    return np.array(sorted("xyz".index(a) for a in names), dtype=np.int64)


def _force(name: str, spec: kinds.EquilibriumForceSpec, context: Context) -> Task:
    return EquilibriumForce(
        *_common(name, spec),
        squared=spec.measure == "squared",
        vector=spec.measure == "vector",
        planar=context.kin.grasp.planar,
    )


def _moment(name: str, spec: kinds.EquilibriumMomentSpec, context: Context) -> Task:
    return EquilibriumMoment(
        *_common(name, spec),
        squared=spec.measure == "squared",
        vector=spec.measure == "vector",
        planar=context.kin.grasp.planar,
        about_contacts=spec.about == "contacts",
    )


def _manipulability(name: str, spec: kinds.ManipulabilitySpec, context: Context) -> Task:
    names = list(context.scenario.robot.fingers)
    chosen = names if spec.fingers is None else list(spec.fingers)
    chosen = [finger for finger in chosen if finger in context.kin.grasp.fingers]
    tips = [context.scenario.robot.fingers[finger] for finger in chosen]
    return Manipulability(
        *_common(name, spec),
        fingers=np.array([context.frame(tip) for tip in tips], dtype=np.int64),
        threshold=spec.threshold,
        band=spec.band,
        planar=context.planar,
        squared=spec.measure == "squared",
    )


def _palm(name: str, spec: kinds.PalmDistanceSpec, context: Context) -> Task:
    from wbc.scenario.build import build_surface

    return PalmDistance(
        *_common(name, spec), context.frame(spec.frame), build_surface(spec.region), spec.band
    )


def _frame_pose(name: str, spec: kinds.FramePoseSpec, context: Context) -> Task:
    frame = context.frame(spec.frame)
    if spec.target is not None:
        goal = _pose(spec.target.xyz, spec.target.xyzw)
    else:
        robot = context.kin.robot.update(context.q_start)
        goal = read_only(np.concatenate([robot.position[frame], robot.rotation[frame].ravel()]))
    return FramePose(*_common(name, spec), frame, goal, context.planar)


def _frame_position(name: str, spec: kinds.FramePositionSpec, context: Context) -> Task:
    return FramePosition(
        *_common(name, spec), context.frame(spec.frame), _axes(spec.axes), read_only(spec.target)
    )


def _frame_orientation(name: str, spec: kinds.FrameOrientationSpec, context: Context) -> Task:
    goal = read_only(rotation_from_quaternion(np.array(spec.target.xyzw)).ravel())
    return FrameOrientation(*_common(name, spec), context.frame(spec.frame), goal, context.planar)


def _relative_pose(name: str, spec: kinds.RelativePoseSpec, context: Context) -> Task:
    return RelativePose(
        *_common(name, spec), context.frame(spec.frame), context.frame(spec.reference),
        _pose(spec.target.xyz, spec.target.xyzw), context.planar,
    )  # fmt: skip


def _posture(name: str, spec: kinds.PostureSpec, context: Context) -> Task:
    model = context.kin.robot.model
    target = spec.target or {}
    joints = None if spec.joints is None else matching(spec.joints, model.joint_names)
    if joints is None:
        joints = model.joint_names if "*" in target or not target else tuple(target)
    goal = [
        value.value if (value := kinds.limit_of(target, joint)) is not None
        else context.q_start[model.joint(joint)]
        for joint in joints
    ]  # fmt: skip
    indices = np.array([model.joint(joint) for joint in joints], dtype=np.int64)
    return Posture(*_common(name, spec), indices, read_only(goal))


def _synergy(name: str, spec: kinds.SynergySpec, context: Context) -> Task:
    hand, model = context.hands[name], context.kin.robot.model
    joints = np.array([model.joint(spec.prefix + j) for j in hand.joints], dtype=np.int64)
    if spec.weights is None:
        goal = hand.project(context.q_start[joints])
    else:
        goal = weights_in(spec.weights, spec, hand)
    return Synergy(
        *_common(name, spec), joints, hand.mean, hand.basis,
        read_only(np.maximum(hand.lower, model.lower[joints])),
        read_only(np.minimum(hand.upper, model.upper[joints])), read_only(goal), spec.measure,
    )  # fmt: skip


def _center_of_mass(name: str, spec: kinds.CenterOfMassSpec, context: Context) -> Task:
    return CenterOfMass(*_common(name, spec), _axes(spec.axes), read_only(spec.target))


BUILDERS: dict[type, Callable[[str, Any, Context], Task]] = {
    kinds.EquilibriumForceSpec: _force,
    kinds.EquilibriumMomentSpec: _moment,
    kinds.ManipulabilitySpec: _manipulability,
    kinds.PalmDistanceSpec: _palm,
    kinds.FramePoseSpec: _frame_pose,
    kinds.FramePositionSpec: _frame_position,
    kinds.FrameOrientationSpec: _frame_orientation,
    kinds.RelativePoseSpec: _relative_pose,
    kinds.PostureSpec: _posture,
    kinds.SynergySpec: _synergy,
    kinds.CenterOfMassSpec: _center_of_mass,
}
"""Every task type but object_pose, which is the main task's rows themselves."""
