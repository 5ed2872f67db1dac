"""Which fingers may touch the object, how each one touches now, and what kind of grasp that is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.circle import Circle
from wbc.contact.surfaces.sphere import Sphere


class ContactMode(IntEnum):
    """How a finger touches: which of the contact variables may change."""

    FREE = 0
    """Not in contact."""
    FIXED = 1
    """The tip pivots about its contact point: θ moves, ξ stays."""
    SLIDING = 2
    """The tip also slides on the surface: θ and ξ move."""


@dataclass(frozen=True)
class Grasp:
    """Object surface and the fingers that may ever touch it.

    Attributes:
        surface: the object's surface, in the object frame.
        fingers: names; finger i's tip is tracked frame i of the `Kinematics`.
        at: (N, 2) chart coordinates of the planned contact points.
        face: (N,) charts that `at` is in, indices into the surface's `faces`.
        stiffness: (N,) of the elastic pads, k of Δl = f_n / k, [N/m].
        rest_length: (N,) l of (27), [m].
        share: (N,) s > 0, how hard each finger presses beside the others where they balance.
        planar: one chart coordinate, one pivot angle, rows x, y, ω_z.
    """

    surface: Surface
    fingers: tuple[str, ...]
    at: Array
    face: IntArray
    stiffness: Array
    rest_length: Array
    share: Array
    planar: bool

    @property
    def count(self) -> int:
        """Number of fingers, N."""
        return len(self.fingers)

    @property
    def n_xi(self) -> int:
        """Chart coordinates that a sliding contact moves: 1 in the plane, 2 in space."""
        return 1 if self.planar else 2

    @property
    def n_rows(self) -> int:
        """Rows of (33) per finger: 3 in the plane, 6 in space."""
        return 3 if self.planar else 6


def no_grasp(planar: bool) -> Grasp:
    """A grasp without fingers, for scenarios without an object."""
    none = np.zeros(0)
    surface = Circle(1.0) if planar else Sphere(1.0)  # never evaluated at a contact
    return Grasp(
        surface, (), np.zeros((0, 2)), np.zeros(0, dtype=np.int64), none, none, none, planar
    )


class ContactState(NamedTuple):
    """The contact variables η of all N fingers.

    Attributes:
        mode: (N,) ContactMode of each finger.
        xi: (N, 2) chart coordinates ξ.
        pivot: (N, 3, 3) R_FC, the ball-and-socket angles θ as a rotation: no singular attitude.
        face: (N,) the chart that each contact is in now.
        shift: (N, 3) where each finger found the surface beside where it is believed, object frame
            [m]; its contact point is c(ξ) + shift.
    """

    mode: IntArray
    xi: Array
    pivot: Array
    face: IntArray
    shift: Array

    @classmethod
    def planned(cls, grasp: Grasp, mode: IntArray) -> ContactState:
        """The planned contact points, touched as `mode` (N,) says; pivots not known yet."""
        pivot = np.tile(np.eye(3), (grasp.count, 1, 1))
        shift = np.zeros((grasp.count, 3))
        return cls(mode, np.array(grasp.at), pivot, np.array(grasp.face), shift)


class ObjectReference(NamedTuple):
    """Where the object should be, and how much each pad should be pressed.

    Attributes:
        position: (3,) p_WO [m].
        rotation: (3, 3) R_WO.
        twist: (6,) linear then angular velocity of O in the world's axes [m/s, rad/s].
        reach: (N,) l − Δl of each pad [m].
        reach_rate: (N,) its rate [m/s].
    """

    position: Array
    rotation: Array
    twist: Array
    reach: Array
    reach_rate: Array


class GraspClass(NamedTuple):
    """What kind of grasp (33) describes; made by `wbc.contact.classify`.

    Attributes:
        fingers: those in contact.
        rows, columns: size of J̃ (34): all joints, and the contact variables free to move.
        rank: numerical rank of J̃.
        smallest_singular_value, condition: of J̃ in SI units; condition is largest over smallest.
        redundant_fingers: those whose own [J_F J_η] has a null space.
        free_motions: dimension of the motions of object and passive joints that remain while every
            active joint is locked.
        residuals: ε_f [1] and ε_m [m²] of (44)-(45) over the fingers in contact.
        friction_needed: least friction coefficient of point contacts with which the grasp is force
            closed; 0 where any nonzero one will do, inf where none does.
    """

    fingers: tuple[str, ...]
    rows: int
    columns: int
    rank: int
    smallest_singular_value: float
    condition: float
    redundant_fingers: tuple[str, ...]
    free_motions: int
    residuals: tuple[float, float]
    friction_needed: float

    @property
    def redundant(self) -> bool:
        """Active and passive joints of some finger can move while the object is locked."""
        return bool(self.redundant_fingers)

    @property
    def indeterminate(self) -> bool:
        """The object can move while the active joints are locked."""
        return self.free_motions > 0

    def force_closed(self, mu: float | None = None) -> bool:
        """Whether point contacts of friction `mu` hold the object against any small wrench.

        Without `mu`: whether any nonzero friction will do, as in the chapter's case study.
        """
        return self.friction_needed == 0.0 if mu is None else self.friction_needed < mu


def equilibrium_residuals(points: Array, normals: Array, share: Array) -> tuple[float, float]:
    """ε_f and ε_m of the frictionless equilibrium (44)-(45).

    Args:
        points: (n, 3) contact points in the object frame, [m].
        normals: (n, 3) outward unit normals in the object frame.
        share: (n,) s of each finger, 1 in the chapter.

    Returns:
        ½ fᵀf (no unit) and ½ mᵀm [m²] with f = Σ s n̂ and m = Σ c × s n̂.
    """
    forces = share[:, None] * normals
    f = forces.sum(axis=0)
    m = np.cross(points, forces).sum(axis=0)
    return 0.5 * float(f @ f), 0.5 * float(m @ m)
