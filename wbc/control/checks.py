"""What must fit together before the first tick: compiled kernels do not check sizes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.arrays import Array
from wbc.control.law import Law
from wbc.control.phases import PhaseSequence
from wbc.errors import SetupError

if TYPE_CHECKING:
    from wbc.control.controller import Settings


def vector(name: str, values: Any, size: int, *, finite: bool = True) -> Array:
    """`values` as a new vector of doubles. Raises SetupError unless it has that size."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise SetupError(f"{name} must be {size} numbers") from None
    if array.shape != (size,):
        raise SetupError(f"{name} must have shape ({size},), got {array.shape}")
    if np.isnan(array).any() or (finite and not np.isfinite(array).all()):
        raise SetupError(f"{name} must be finite, got {array[~np.isfinite(array)][0]}")
    return array


def controller(
    law: Law, phases: PhaseSequence, priority: Sequence[int], settings: Settings
) -> None:
    """Sizes and order of everything a controller is made of.

    Raises:
        SetupError: what does not fit, and what would.
    """
    model, tasks, fingers = law.kin.robot.model, law.stack.tasks, law.kin.grasp.count
    for name in ("lower", "upper", "velocity", "acceleration"):
        vector(f"settings.{name}", getattr(settings, name), model.nv, finite=name == "velocity")
    if (settings.lower > settings.upper).any() or (settings.velocity < 0.0).any():
        raise SetupError("settings: lower must not be above upper, nor a velocity limit below 0")
    if (settings.acceleration < 0.0).any():
        raise SetupError("settings: an acceleration limit must not be below 0")
    if not 0.0 < settings.dt < np.inf:
        raise SetupError(f"settings.dt must be positive and finite, got {settings.dt}")
    names = [task.name for task in tasks]
    if len(set(names)) < len(names):
        raise SetupError(f"two tasks have one name: {', '.join(sorted(names))}")
    first = len(tasks) - fingers
    if sorted(priority) != list(range(first)):
        raise SetupError(
            f"priority must name each of the first {first} tasks once, by index; the last "
            f"{fingers} are the fingers' tips, in their order; got {list(priority)}"
        )
    for task in tasks:
        task.check(law.kin)
    if not phases.phases:
        raise SetupError("a controller needs a phase, if only one that never ends")
    for phase in phases.phases:
        for name, size in (("mode", fingers), ("reach", fingers), ("pad", fingers)):
            if np.shape(getattr(phase, name)) != (size,):
                raise SetupError(f"phase '{phase.name}': {name} must have shape ({size},)")
        if np.shape(phase.offset) != (fingers, 3):
            raise SetupError(f"phase '{phase.name}': offset must have shape ({fingers}, 3)")
        if np.shape(phase.wanted) != (len(tasks),):
            raise SetupError(f"phase '{phase.name}': wanted must have shape ({len(tasks)},)")
        if any(not 0 <= k < len(tasks) for k, _ in phase.until.residuals):
            raise SetupError(f"phase '{phase.name}': a residual's task index is out of range")
        for k, goal, _ in phase.task_motions:
            sizes = tasks[k].target_sizes if 0 <= k < len(tasks) else ()
            if np.ndim(goal) != 1 or not {len(goal), 2 * len(goal)} <= set(sizes):
                raise SetupError(
                    f"phase '{phase.name}': no task {k} has a target of {np.size(goal)} numbers "
                    "that can be led"
                )
