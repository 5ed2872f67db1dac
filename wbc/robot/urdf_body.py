"""Check of the rigid bodies of a URDF: links joined by fixed joints move as one.

Pinocchio adds the inertias of such links into one; that sum is judged here, so that a massless
or idealised helper link passes wherever the body it belongs to is sound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from wbc.arrays import Array
from wbc.robot.strict_xml import Faults
from wbc.robot.urdf_joint import Joint
from wbc.robot.urdf_link import Link

_TRIANGLE_SLACK = 0.3
"""Identified inertias of sound robots miss the triangle inequality by up to a quarter."""
_RELATIVE = 1e-9
_GYRATION = 1e-6
"""Smallest radius of gyration [m] taken for more than rounding."""


@final
class _Sum:
    """Mass, its first and its second moments of a body, about the frame of the body."""

    def __init__(self) -> None:
        self.mass = 0.0
        self.first: Array = np.zeros(3)
        self.second: Array = np.zeros((3, 3))

    def add(self, link: Link, R: Array, p: Array) -> None:
        """Add a link whose frame lies at rotation `R` and position `p` of the body frame."""
        if link.inertia is None:
            return
        c = R @ link.frame.position + p
        turned = R @ link.frame.rotation
        self.mass += link.mass
        self.first = self.first + link.mass * c
        self.second = self.second + turned @ link.inertia @ turned.T + link.mass * _parallel(c)

    def central(self) -> Array:
        """3x3 inertia about the centre of mass [kg m^2]."""
        if self.mass <= 0:
            return self.second
        return self.second - self.mass * _parallel(self.first / self.mass)

    def moments(self) -> tuple[float, float, float]:
        """Principal moments, ascending [kg m^2]; those within rounding are 0."""
        central = self.central()
        scale = float(np.abs(central).max())
        if scale == 0.0:
            return 0.0, 0.0, 0.0
        values = np.asarray(np.linalg.eigvalsh(central / scale), dtype=np.float64) * scale
        # Steiner terms cancel in `central`; what is left of them is rounding as well.
        spread = float(np.abs(self.second).max())
        noise = max(_RELATIVE * scale, 1e-14 * spread, _GYRATION**2 * self.mass)
        low, middle, high = (float(v) for v in np.where(np.abs(values) < noise, 0.0, values))
        return low, middle, high


def check_bodies(
    links: Mapping[str, Link],
    roots: Sequence[str],
    joints: Sequence[Joint],
    below: Mapping[str, Sequence[Joint]],
    faults: Faults,
) -> None:
    """Note bodies that forward dynamics cannot move.

    Args:
        links: all links by name.
        roots: the links without parent.
        joints: all joints; between existing links and without loops.
        below: the joints under each link.
        faults: where to note them.
    """
    for root in roots:
        _check_body(root, None, links, below, faults)
    for joint in joints:
        if joint.moves and joint.child is not None:
            _check_body(joint.child, joint, links, below, faults)


def _check_body(
    main: str,
    joint: Joint | None,
    links: Mapping[str, Link],
    below: Mapping[str, Sequence[Joint]],
    faults: Faults,
) -> None:
    """Check the body that starts with link `main`, moved by `joint` (None: the base)."""
    total = _Sum()
    members: list[Link] = []
    is_last = True
    open_links = [(main, np.eye(3), np.zeros(3))]
    while open_links:
        name, R, p = open_links.pop()
        members.append(links[name])
        total.add(links[name], R, p)
        for next_ in below[name]:
            is_last = is_last and not next_.moves
            if not next_.moves and next_.child is not None:
                open_links.append(
                    (next_.child, R @ next_.frame.rotation, R @ next_.frame.position + p)
                )
    if any(link.faulty for link in members):
        return  # already reported; the sum means nothing
    if joint is not None and total.mass == 0 and (is_last or total.second.any()):
        what = f"{links[main].where} moves but has no mass, in {joint.where}"
        remedy = "write its mass in kg in an <inertial>, or make the joint fixed"
        faults.add(links[main].mass_line, f"{what}; {remedy}")
        return
    # A body on the way to others may be a point mass; the last one would spin without inertia.
    defect = _defect(total, definite=is_last and joint is not None)
    if defect is not None:
        culprit = next((m for m in members if _defect(_alone(m)) == defect), links[main])
        faults.add(culprit.inertia_line, f"{defect[0]}, in {culprit.where}; {defect[1]}")


def _alone(link: Link) -> _Sum:
    total = _Sum()
    total.add(link, np.eye(3), np.zeros(3))
    return total


def _defect(total: _Sum, *, definite: bool = False) -> tuple[str, str] | None:
    """What no body can have, and the remedy."""
    low, middle, high = total.moments()
    if low < 0 or (low == 0 and definite):
        what = "the inertia matrix is not positive definite"
        return what, "check the entries of <inertia>, their order and signs"
    if high > (low + middle) * (1 + _TRIANGLE_SLACK) and middle > 0:
        what = "one principal moment of inertia exceeds the sum of the other two"
        return what, "check the entries of <inertia>, their frame and units"
    return None


def _parallel(c: Array) -> Array:
    """Inertia per kg of a point at `c` [m^2]."""
    point: Array = float(c @ c) * np.eye(3) - np.outer(c, c)
    return point
