"""The law of a soft fingertip: a spring-damper pad along the normal, stick-slip friction across it.

A pad is the chapter's elastic contact (27): a spring of rest length l with a damper, along the
outward normal of the surface, that turns freely about the tip and never pulls. What it bears goes
through the origin of the tip frame, so that object and finger get opposite forces on one line.

Across the normal a bristle sticks to the surface: a spring-damper whose force stays within the
friction cone. While it would go beyond, the bristle's foot slides such that the force stays on the
cone. The chapter names no tangential contact; without one the object is lost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.compiled import kernel
from wbc.rotations import cross, rotate


class Pads(NamedTuple):
    """The soft fingertips of all N fingers.

    Attributes:
        rest_length: (N,) l [m].
        stiffness, damping: (N,) of the spring along the normal [N/m], [N s/m].
        bristle, bristle_damping: (N,) of the spring across it [N/m], [N s/m].
    """

    rest_length: Array
    stiffness: Array
    damping: Array
    bristle: Array
    bristle_damping: Array


@kernel
def pad_forces(
    near: BoolArray, records: Array, tips: Array, tip_velocity: Array, origin: Array,
    rotation: Array, com: Array, velocity: Array, spin: Array, rest_length: Array,
    stiffness: Array, damping: Array, bristle: Array, bristle_damping: Array, friction: Array,
    deflection: Array, force: Array, rate: Array, slide: Array, wrench: Array,
) -> tuple[float, float]:  # fmt: skip
    """Forces of the tips on the object, and how the bristles move.

    Args:
        near: (N,) tips whose records are fresh; the others do not touch.
        records: (N, 6, 3) chart records below the tips, object frame.
        tips, tip_velocity: (N, 3) in the world [m], [m/s].
        origin, rotation: of the object's frame, (3,) [m], (3, 3).
        com, velocity, spin: (3,) of the object: centre of mass [m], its velocity, turning rate.
        friction: (N,) μ.
        deflection: (N, 3) of the bristles, object frame [m].
        force: (N, 3) filled with the forces on the object, world axes [N].
        rate: (N, 3) filled with the rate of `deflection` [m/s].
        slide: (N,) filled with the speed at which the bristles' feet slide [m/s].
        wrench: (6,) filled with force [N] and moment [Nm] of all on the object about `com`.

    Returns:
        Energy in all springs [J], and the power lost to dampers and sliding [W].
    """
    stored, lost = 0.0, 0.0
    wrench[:] = 0.0
    x, u, normal, across = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(near.shape[0]):
        force[i] = 0.0
        slide[i] = 0.0
        s = deflection[i]
        give_way = bristle[i] / bristle_damping[i]
        pressed = -1.0
        if near[i]:
            rotate(rotation.T, tips[i] - origin, x)
            rotate(rotation.T, tip_velocity[i] - velocity - cross(spin, tips[i] - com), u)
            normal[:] = cross(records[i, 1], records[i, 2])
            normal /= np.sqrt(np.sum(normal * normal))
            pressed = rest_length[i] - np.sum(normal * (x - records[i, 0]))
        stored += 0.5 * bristle[i] * np.sum(s * s)
        if not pressed > 0.0:  # the bristle comes back to rest
            for r in range(3):
                rate[i, r] = -give_way * s[r]
            lost += bristle[i] * give_way * np.sum(s * s)
            continue
        stored += 0.5 * stiffness[i] * pressed * pressed
        press_rate = -np.sum(normal * u)
        press = max(stiffness[i] * pressed + damping[i] * press_rate, 0.0)
        lost += (press - stiffness[i] * pressed) * press_rate
        # what is along the normal, as the normal turns below a sliding tip, fades away
        along = np.sum(normal * s)
        for r in range(3):
            u[r] += press_rate * normal[r]
            across[r] = bristle[i] * (s[r] - along * normal[r]) + bristle_damping[i] * u[r]
        size, most = np.sqrt(np.sum(across * across)), friction[i] * press
        share = 1.0 if size <= most else most / size
        for r in range(3):
            across[r] *= share
            stuck = s[r] - along * normal[r]
            moved = u[r]
            if share < 1.0:
                moved = (across[r] - bristle[i] * stuck) / bristle_damping[i]
            rate[i, r] = moved - give_way * along * normal[r]
            slide[i] += (u[r] - moved) ** 2
            lost += across[r] * u[r] - bristle[i] * s[r] * rate[i, r]
        slide[i] = np.sqrt(slide[i])
        rotate(rotation, across - press * normal, force[i])
        wrench[:3] += force[i]
        wrench[3:] += cross(tips[i] - com, force[i])
    return stored, lost
