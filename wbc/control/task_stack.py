"""The tasks of a stack, evaluated into one block of preallocated rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.stack.projection import task_rows
from wbc.tasks import Task, TaskRows
from wbc.tasks.tip_position import TipPosition


@final
class TaskStack:
    """Rows of all tasks, and how they form levels. A workspace: `evaluate` overwrites it.

    Attributes:
        tasks: the M tasks; a level belongs to `level_task`.
        level_start, level_size, level_task: (L,) rows and owner of each level.
        jacobian, rhs: (R, nv), (R,) rows over the joints, scaled by the metric.
        error: (R,) e of each task, unsaturated.
        row_activation: (R,).
    """

    def __init__(self, tasks: Sequence[Task], fingers: int, metric: Array) -> None:
        self.tasks = tuple(tasks)
        nv = len(metric)
        levels: list[tuple[int, int, int]] = []
        start = 0
        self.task_slices: list[slice] = []
        for k, task in enumerate(self.tasks):
            self.task_slices.append(slice(start, start + task.rows))
            if task.separate:
                levels += [(start + r, 1, k) for r in range(task.rows)]
            else:
                levels.append((start, task.rows, k))
            start += task.rows
        self.task_first = np.array([s.start for s in self.task_slices], dtype=np.int64)
        self.task_last = np.array([s.stop for s in self.task_slices], dtype=np.int64)
        table = np.array(levels, dtype=np.int64).reshape(len(levels), 3)
        self.level_start, self.level_size, self.level_task = (
            np.ascontiguousarray(table[:, c]) for c in range(3)
        )
        self.gain = np.array([self.tasks[k].gain for k in self.level_task])
        led = [isinstance(self.tasks[k], TipPosition) for k in self.level_task]
        self._led = np.array(led, dtype=np.bool_)  # they only keep up with a reference
        self.saturation = np.array([self.tasks[k].saturation for k in self.level_task])
        self.exact = np.array([self.tasks[k].exact_share for k in self.level_task])
        self.scale: Array = 1.0 / np.sqrt(metric)
        width = nv + 2 * fingers
        self._written: Array = np.zeros(start * (width + 2))  # one block, cleared at once
        self.error: Array = self._written[:start]
        self.rate: Array = self._written[start : 2 * start]
        self.jacobian_ext: Array = self._written[2 * start :].reshape(start, width)
        self.row_activation: Array = np.ones(start)
        self.jacobian: Array = np.zeros((start, nv))
        self.rhs: Array = np.zeros(start)
        self._slots = [
            TaskRows(self.error[s], self.jacobian_ext[s], self.rate[s], self.row_activation[s])
            for s in self.task_slices
        ]

    def evaluate(
        self, kin: ExtendedKinematics, targets: Sequence[Array | None], active: Sequence[bool],
        pace: float = 1.0,
    ) -> None:  # fmt: skip
        """All rows at `kin`. Tasks that are neither in nor fading (`active` false) stay zero.

        Args:
            pace: share of its speed with which every task but the tips descends its error.
        """
        self._written.fill(0.0)
        self.row_activation.fill(1.0)
        for task, slot, target, on in zip(self.tasks, self._slots, targets, active, strict=True):
            if on:
                task.evaluate(kin, target, slot)
        n = kin.grasp.count
        gain = self.gain if pace == 1.0 else np.where(self._led, self.gain, pace * self.gain)
        task_rows(
            self.jacobian_ext, self.error, self.rate, gain, self.saturation,
            self.level_start, self.level_size, kin.xi_jacobian.reshape(2 * n, len(self.scale)),
            kin.xi_drift.reshape(2 * n), self.scale, self.jacobian, self.rhs,
        )  # fmt: skip

    def level_order(self, tasks: Sequence[int]) -> IntArray:
        """Levels in the order of their tasks, highest priority first."""
        return np.array(
            [level for k in tasks for level in np.flatnonzero(self.level_task == k)],
            dtype=np.int64,
        )
