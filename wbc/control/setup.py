"""Closing the fingers on their contact points before the first tick."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactMode, ContactState
from wbc.errors import SetupError

_STEPS = 300
_EXACT = 1e-11  # [m]: far below any error the loop is asked to hold


def close_grasp(kin: ExtendedKinematics, q_start: Array, contact: ContactState) -> Array:
    """The configuration near q_start in which every finger in contact touches its contact point.

    Damped Gauss-Newton on the tips' positions, joints kept inside the robot's limits; a stretched
    or blocked chain ends with the reason instead of a wrong start.

    Args:
        kin: workspace; its `reference` says where the object is and how far the pads are pressed.
        q_start: (nv,) [rad] or [m].
        contact: modes and chart coordinates at the start.

    Raises:
        SetupError: which finger, how far off, which joints are at a limit.
    """
    model, grasp = kin.robot.model, kin.grasp
    q = np.clip(np.array(q_start, dtype=np.float64), model.lower, model.upper)
    holding = [i for i in range(grasp.count) if contact.mode[i] != ContactMode.FREE]
    if not holding:
        return q
    reference, size = kin.reference, 2 if grasp.planar else 3
    free = contact._replace(mode=np.zeros_like(contact.mode))
    gap = np.zeros((len(holding), size))
    damping = 1e-2
    for _ in range(_STEPS):
        kin.update(q, free, reference)
        for row, i in enumerate(holding):
            point = kin.charts[i, 0] + reference.reach[i] * kin.frame[i, :, 2]
            target = reference.position + reference.rotation @ point
            gap[row] = (target - kin.robot.position[i])[:size]
        error = float(np.linalg.norm(gap))
        if error < _EXACT:
            return q
        jacobian = np.concatenate([kin.robot.linear[i, :size] for i in holding])
        # joints that stand at a limit and would go further are left out of this step
        pull = jacobian.T @ gap.ravel()
        blocked = ((q <= model.lower) & (pull < 0)) | ((q >= model.upper) & (pull > 0))
        jacobian[:, blocked] = 0.0
        # damping that vanishes with the error: quadratic at the end, calm far away
        damping = min(1e-2, error * error)
        gram = jacobian @ jacobian.T + damping * np.eye(gap.size)
        step = jacobian.T @ np.linalg.lstsq(gram, gap.ravel(), rcond=None)[0]
        step *= min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-12))
        q = np.clip(q + step, model.lower, model.upper)
    worst = int(np.argmax(np.linalg.norm(gap, axis=1)))
    at_limit = [
        name
        for name, x, low, high in zip(model.joint_names, q, model.lower, model.upper, strict=True)
        if x <= low + 1e-9 or x >= high - 1e-9
    ]
    raise SetupError(
        f"finger '{grasp.fingers[holding[worst]]}' cannot reach its contact point: "
        f"{np.linalg.norm(gap[worst]) * 1e3:.1f} mm short"
        + (f", joints at a limit: {', '.join(at_limit)}" if at_limit else "")
        + " (move the object or the robot's start nearer)"
    )
