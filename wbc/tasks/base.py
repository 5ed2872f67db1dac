"""What a task is: a function σ(q̃) to bring to σ_d, with its Jacobian.

q̃ = [q, ξ]: the joints, then two chart coordinates per finger of the grasp. No task depends on the
ball-and-socket angles θ. A task writes e = σ_d − σ, J = ∂σ/∂q̃ exactly, and the feed-forward
σ̇_d − ∂σ/∂t; the stack asks for σ̇ = gain · e + feed-forward.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.errors import SetupError


class TaskRows(NamedTuple):
    """Where a task writes its rows; views into the stack's arrays, zero on entry.

    Attributes:
        error: (m,) e = σ_d − σ, in the task's units.
        jacobian: (m, nv + 2N) ∂σ/∂q̃.
        rate: (m,) σ̇_d − ∂σ/∂t, in units per second.
        activation: (m,) in [0, 1], how far each row is in force; 1 on entry.
    """

    error: Array
    jacobian: Array
    rate: Array
    activation: Array


def empty_rows(count: int, columns: int) -> TaskRows:
    """Rows to evaluate one task on its own."""
    return TaskRows(np.zeros(count), np.zeros((count, columns)), np.zeros(count), np.ones(count))


@dataclass(frozen=True)
class Task(ABC):
    """A task of the stack. Definitions are immutable; the target is an argument.

    Attributes:
        name: unique in the stack.
        gain: K of (37), [1/s].
        saturation: largest norm of e that enters the law, in the task's units.
    """

    name: str
    gain: float
    saturation: float

    @property
    @abstractmethod
    def rows(self) -> int:
        """Number of rows m."""

    @property
    def separate(self) -> bool:
        """Whether each row is a level of its own (rows that fade one by one) or all m are one."""
        return False

    @property
    def exact_share(self) -> float:
        """Share of a row's squared length that must be left to it for its gain to be exact.

        With less, the task slows rather than drive the joints hard to get its way.
        """
        return 0.1

    @property
    def target(self) -> Array | None:
        """The target from the definition (None: the task has none); may be replaced at run time."""
        return None

    @property
    def target_sizes(self) -> tuple[int, ...]:
        """Sizes that a target may have; none for a task without target."""
        return ()

    def frames_used(self) -> tuple[int, ...]:
        """Places among the tracked frames that the task reads."""
        return ()

    def check(self, kin: ExtendedKinematics) -> None:
        """Whether the definition fits the robot: compiled kernels would not notice.

        Raises:
            SetupError: what does not fit.
        """
        count = len(kin.robot.frames)
        for frame in self.frames_used():
            if not 0 <= frame < count:
                raise SetupError(f"task '{self.name}': frame {frame} is not one of {count} tracked")
        target = self.target
        if target is not None and not (
            target.ndim == 1 and target.size in self.target_sizes and np.isfinite(target).all()
        ):
            sizes = " or ".join(str(size) for size in self.target_sizes)
            raise SetupError(
                f"task '{self.name}': its target must be {sizes} finite numbers, got {target.shape}"
            )

    @abstractmethod
    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        """Fill `out` at the configuration of `kin`."""


@kernel
def fade(depth: float, band: float) -> float:
    """Smooth step: 0 for depth <= 0, 1 for depth >= band, continuous slope between."""
    x = depth / band
    if not x > 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    return x * x * (3.0 - 2.0 * x)


@kernel
def coordinate_rows(
    point: Array,
    jacobian_of_point: Array,
    axes: IntArray,
    target: Array,
    error: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    """Rows of σ = point[axes]: a point (3,) of the robot with its Jacobian (3, nv), [m].

    The target is the point's (3,), or (6,) with its velocity.
    """
    nv = jacobian_of_point.shape[1]
    for r in range(axes.shape[0]):
        a = axes[r]
        error[r] = target[a] - point[a]
        jacobian[r, :nv] = jacobian_of_point[a]
        if target.shape[0] == 6:
            rate[r] = target[3 + a]
