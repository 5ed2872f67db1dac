"""What a cost is: a scalar C(q) that grows towards a constraint, with its gradient."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from wbc.arrays import Array
from wbc.robot.distances import Distances
from wbc.robot.kinematics import Kinematics


@dataclass(frozen=True)
class Cost(ABC):
    """A term of C_Σ (38). Definitions are immutable.

    Attributes:
        name: unique in the scenario.
        weight: γ of (38).
    """

    name: str
    weight: float

    @abstractmethod
    def value(self, kin: Kinematics, distances: Distances | None) -> float:
        """C at the configuration of `kin`, without the weight."""

    @abstractmethod
    def add_gradient(self, kin: Kinematics, distances: Distances | None, gradient: Array) -> float:
        """Add γ ∂C/∂q to `gradient`, shape (nv,); returns C without the weight."""
