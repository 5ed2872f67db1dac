"""The force problems of a finished run, put together again from its log."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from wbc.arrays import BoolArray, IntArray
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import Grasp
from wbc.control.hand_statics import touches_at
from wbc.forces import ForceStatus, GraspForceProblem, solve
from wbc.forces.study import CASES, run
from wbc.recording import Log
from wbc.recording.force_figures import NEWTON, UNLIMITED, ForceStudy
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel
from wbc.rotations import rotation_from_quaternion
from wbc.scenario import Scenario
from wbc.scenario.build_forces import build_planner
from wbc.scenario.build_phases import build_phases
from wbc.scenario.build_tasks import tracked_frames

_MOST = 300  # ticks that are solved again: enough for a curve, and done in seconds
_NO_GAIN = 1.0  # of the main task, which plans no forces


class Asked(NamedTuple):
    """Force problems of one set of contacts, in the order of time.

    Attributes:
        ticks: (T,) of the log.
        problems: T.
        fingers: (n,) which of the log's contacts these are.
    """

    ticks: IntArray
    problems: list[GraspForceProblem]
    fingers: IntArray


def force_study(log: Log, scenario: Scenario, model: RobotModel, grasp: Grasp) -> ForceStudy | None:
    """The ticks of the run's longest stretch with the same contacts, in every case of section 1.5.

    None where fewer than two of them could be balanced.
    """
    asked = rebuilt(log, scenario, model, grasp)
    if asked is None:
        return None
    tips = [scenario.robot.fingers[log.contact_names[i]] for i in asked.fingers]
    return solved(asked, log, hands(model, tips))


def solved(asked: Asked, log: Log, hand: IntArray) -> ForceStudy | None:
    """The same of problems at hand.

    Args:
        hand: (n,) the hand of each contact, from 0 on.
    """
    problems = asked.problems
    first = problems[0]
    start = solve(first)
    if not start.status.usable:
        return None
    cases = [case for case in (*CASES, NEWTON, UNLIMITED) if hand.any() or not case.split]
    run(problems[:2], start.c, hand, cases=cases)  # compiles; the clock runs after that
    runs = run(problems, start.c, hand, cases=cases, clock=time.thread_time)
    starts = first.first
    frames = np.array([p.G[:3, starts[:, None] + np.arange(3)].swapaxes(0, 1) for p in problems])
    turn = np.array([rotation_from_quaternion(pose[3:]) for pose in log.object_pose[asked.ticks]])
    moved = np.add.reduceat((first.J != 0.0).astype(int), starts, axis=0) > 0
    return ForceStudy(
        t=log.t[asked.ticks],
        names=tuple(log.contact_names[i] for i in asked.fingers),
        hands=hand,
        mu=first.mu,
        frames=np.einsum("tji,tnjk->tnik", turn, frames),
        first=starts,
        own=moved.sum(axis=0) == 1,
        runs=runs,
    )


def rebuilt(log: Log, scenario: Scenario, model: RobotModel, grasp: Grasp) -> Asked | None:
    """What was asked in the longest stretch of the run with the same contacts, without the ticks
    that had no feasible forces; None where fewer than two are left."""
    usable = np.array([status.usable for status in ForceStatus])[log.force_status]
    first, end = longest_hold(log.contact_mode, usable)
    ticks = first + np.flatnonzero(usable[first:end])
    if len(ticks) < 2:
        return None
    few = np.unique(np.linspace(0, len(ticks) - 1, min(len(ticks), _MOST)).round().astype(int))
    ticks = ticks[few]
    robot = Kinematics(model, tracked_frames(scenario, grasp))
    tasks = [*log.meta.task_names, *log.meta.tip_task_names]
    phases = build_phases(scenario, grasp, tasks)
    planner = build_planner(scenario, ExtendedKinematics(robot, grasp, _NO_GAIN), phases)
    if planner is None:
        return None
    mode = log.contact_mode[first]
    dt = log.meta.dt
    v = np.vstack((log.v[:1], log.v[:1], log.v))  # commanded up to a tick: that of the one before
    problems = []
    for k in ticks:
        robot.update(log.q[k])
        touch = touches_at(
            log.contact_points[k], log.contact_normals[k], robot.position[: grasp.count],
            log.object_pose[k, :3],
        )  # fmt: skip
        before, last = v[k], v[k + 1]
        problems.append(
            planner.problem(robot, mode, touch, last, (last - before) / dt, log.wrench_plan[k])
        )
    return Asked(ticks, problems, np.flatnonzero(mode))


def longest_hold(mode: IntArray, usable: BoolArray) -> tuple[int, int]:
    """First tick and end of the stretch with the same contacts that has most usable ticks.

    Args:
        mode: (T, N) ContactMode; all free is no stretch.
        usable: (T,) the tick had feasible forces.
    """
    changed = np.flatnonzero((np.diff(mode, axis=0) != 0).any(axis=1)) + 1
    edges = np.concatenate(([0], changed, [len(mode)])).tolist()
    held = [int(usable[a:b].sum()) * bool(mode[a].any()) for a, b in pairwise(edges)]
    k = int(np.argmax(held))
    return (edges[k], edges[k + 1]) if held[k] else (0, 0)


def hands(model: RobotModel, tips: Sequence[str]) -> IntArray:
    """(n,) the hand of each tip, from 0 on: the branch of the robot after what carries all tips.

    Where a branch carries one tip alone, these are fingers of a hand and not hands: all are 0.
    """
    chains = [model.frame_chain(model.frame(tip)) for tip in tips]
    shared = 0
    while all(len(c) > shared and c[shared] == chains[0][shared] for c in chains):
        shared += 1
    branches = [c[shared] if len(c) > shared else -1 for c in chains]
    order = list(dict.fromkeys(branches))
    if min(branches.count(branch) for branch in order) < 2:
        return np.zeros(len(tips), dtype=np.int64)
    return np.array([order.index(branch) for branch in branches], dtype=np.int64)
