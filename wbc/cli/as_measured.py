"""A run under torques as its joints and its object were, in place of as they were commanded."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactState, Grasp, ObjectReference, equilibrium_residuals
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.base import POINT
from wbc.contact.surfaces.closest import follow
from wbc.contact.surfaces.foot import flat, is_foot, sought
from wbc.control.task_stack import TaskStack
from wbc.recording import Log
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel
from wbc.rotations import rotation_from_quaternion
from wbc.scenario import Scenario
from wbc.scenario.build_tasks import build_tasks, tip_frames, tracked_frames

_SUBTASKS: Final = (
    "equilibrium_force", "equilibrium_moment", "manipulability", "palm_distance",
)  # fmt: skip
"""Tasks that are functions of where things are, and of no target that moved in the run."""
_NO_GAIN: Final = 1.0  # nothing is moved here


def as_measured(log: Log, scenario: Scenario, model: RobotModel, grasp: Grasp) -> Log:
    """The log with the curves of Figures 15, 17 and 18 as they were measured.

    Of the fingers that touch, the object's pose error is that of the extended finger (29) at the
    measured joints and the commanded contact variables: what the finger knows of the object. The
    residuals and the tasks of the chapter's case study are those at the measured joints and the
    true object, contacts where the fingertips truly were. Tasks of other kinds stay as commanded;
    ticks in which anything is not finite are NaN.

    Args:
        log: of a run under torques.
    """
    finger, truth = _Knows(scenario, model, grasp), _Truth(scenario, model, grasp, log)
    error = np.full_like(log.object_error, np.nan)
    residual, tasks = np.full((log.ticks, 2), np.nan), np.array(log.task_error)
    tasks[:, truth.columns] = np.nan
    for k in range(log.ticks):
        if np.isfinite(log.q_meas[k]).all() and np.isfinite(log.object_pose_true[k]).all():
            error[k] = finger.error(log, k)
            residual[k], tasks[k, truth.columns] = truth.values(log, k)
    return replace(
        log, object_error=error, eps_f=residual[:, 0], eps_m=residual[:, 1], task_error=tasks
    )


def _pose(pose: Array, grasp: Grasp) -> ObjectReference:
    still = np.zeros(6), np.array(grasp.rest_length), np.zeros(grasp.count)
    return ObjectReference(np.array(pose[:3]), rotation_from_quaternion(pose[3:]), *still)


def _local(points: Array, pose: Array) -> Array:
    out: Array = (points - pose[:3]) @ rotation_from_quaternion(pose[3:])
    return out


def _touching(kin: ExtendedKinematics, state: ContactState, q: Array, pose: Array) -> ContactState:
    """Bring `kin` to q with every finger seeing the object at a pose, and the state of that."""
    n, reference = kin.grasp.count, _pose(pose, kin.grasp)
    kin.update(q, state._replace(mode=np.zeros(n, dtype=np.int64)), reference)
    pivot = np.array([kin.touch(i) for i in range(n)]).reshape(n, 3, 3)
    state = state._replace(pivot=pivot)
    kin.update(q, state, reference)
    return state


@final
class _Feet:
    """Chart coordinates of surface points nearest to points that move."""

    def __init__(self, surface: Surface, count: int) -> None:
        self._surface = surface
        self._records: Array = np.full((count, 6, 3), np.nan)
        self._xi: Array = np.zeros((count, 2))
        self._face: IntArray = np.zeros(count, dtype=np.int64)

    def at(self, points: Array, mode: IntArray) -> ContactState:
        """Contacts at the feet of points (N, 3) in the object frame [m]; pivots not known yet."""
        self._follow(points)
        none = np.zeros_like(points)
        turn = np.tile(np.eye(3), (len(points), 1, 1))
        return ContactState(mode, self._xi.copy(), turn, self._face.copy(), none)

    def found(self, points: Array, mode: IntArray) -> ContactState:
        """The same, what the points are beside their feet taken for where the surface was found."""
        state = self.at(points, mode)
        return state._replace(shift=points - self._records[:, POINT])

    def _follow(self, points: Array) -> None:
        surface, points = self._surface, flat(self._surface, points)
        started = bool(np.isfinite(self._records).all())
        if started:
            follow(surface, points, self._xi, self._face, self._records)
        for i, p in enumerate(points):
            there = self._xi[i], int(self._face[i]), self._records[i]
            if not (started and is_foot(surface, *there, p)):
                self._xi[i], self._face[i], self._records[i] = sought(surface, p)


@final
class _Knows:
    """The object by each finger: measured joints, commanded contact variables."""

    def __init__(self, scenario: Scenario, model: RobotModel, grasp: Grasp) -> None:
        kin = Kinematics(model, tip_frames(scenario, grasp))
        self._kin = ExtendedKinematics(kin, grasp, _NO_GAIN)
        self._feet = _Feet(grasp.surface, grasp.count)

    def error(self, log: Log, k: int) -> Array:
        """(N, 2) position [m] and orientation [rad]; NaN where free."""
        kin, mode, commanded = self._kin, log.contact_mode[k], log.object_pose[k]
        state = self._feet.found(_local(log.contact_points[k], commanded), mode)
        state = _touching(kin, state, log.q[k], commanded)
        # how far pads are pressed is not recorded: it drops out of the difference
        pressed = kin.position - commanded[:3]
        kin.update(log.q_meas[k], state, _pose(log.object_pose_ref[k], kin.grasp))
        found = np.column_stack((
            np.linalg.norm(kin.error[:, :3] + pressed, axis=1),
            np.linalg.norm(kin.error[:, 3:], axis=1),
        ))  # fmt: skip
        found[mode == 0] = np.nan
        return found


@final
class _Truth:
    """Residuals and subtasks at the measured joints and the true object.

    Attributes:
        columns: of the log's tasks that are evaluated.
    """

    def __init__(self, scenario: Scenario, model: RobotModel, grasp: Grasp, log: Log) -> None:
        names = [n for n in log.meta.task_names if scenario.tasks[n].type in _SUBTASKS]
        self.columns = [log.task_names.index(name) for name in names]
        frames = tracked_frames(scenario, grasp)
        self._kin = ExtendedKinematics(Kinematics(model, frames), grasp, _NO_GAIN)
        tasks = build_tasks(scenario, names, self._kin, np.zeros(model.nv), {})[: len(names)]
        self._stack = TaskStack(tasks, grasp.count, np.ones(model.nv))
        self._feet = _Feet(grasp.surface, grasp.count)

    def values(self, log: Log, k: int) -> tuple[Array, list[float]]:
        """ε_f and ε_m (44)-(45), and the norms of the tasks' errors."""
        kin, stack, true = self._kin, self._stack, log.object_pose_true[k]
        mode, count = log.contact_mode[k], len(self._stack.tasks)
        kin.robot.update(log.q_meas[k])
        tips = _local(kin.robot.position[: kin.grasp.count], true)
        planned = _local(log.contact_points[k], log.object_pose[k])
        contacts = self._feet.at(np.where((mode != 0)[:, None], tips, planned), mode)
        _touching(kin, contacts, log.q_meas[k], true)
        stack.evaluate(kin, [None] * count, [True] * count)
        residuals = equilibrium_residuals(
            kin.charts[:, 0], kin.frame[:, :, 2], np.asarray(kin.grasp.share)
        )
        return np.array(residuals), [float(np.linalg.norm(stack.error[s]))
                                     for s in stack.task_slices]  # fmt: skip
