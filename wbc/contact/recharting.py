"""Another chart for a contact that slides towards a pole of its own.

A pure change of coordinates: the contact point, the object's pose by the finger and every velocity
stay what they are. ξ, the contact frame, and with it the pivot R_FC, take new values.
"""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.contact.grasp import ContactMode, ContactState
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.base import D_U, D_V
from wbc.contact.surfaces.gauss import gauss_frames


def recharted(
    surface: Surface, contact: ContactState, rates: Array
) -> tuple[ContactState, Array] | None:
    """The same contacts and rates with every sliding contact in a chart that suits it.

    With R_OC of the old chart and of the new one, R_FC' = R_FC R_OCᵀ R_OC' leaves R_o of (30) as it
    is; ξ̇' gives the contact point the velocity on the object that ξ̇ gave it, and θ̇' differs from
    θ̇ by what the two contact frames turn on the object.

    Args:
        rates: (nv + 5N,) velocity of q̃ as in `wbc.control.law.Motion`.

    Returns:
        None where every contact stays in its chart.
    """
    if not surface.poles:
        return None
    changed = []
    for i in np.flatnonzero(contact.mode == ContactMode.SLIDING).tolist():
        found = surface.rechart(contact.xi[i], int(contact.face[i]))
        if found is not None:
            changed.append((i, *found))
    if not changed:
        return None
    n = len(contact.mode)
    first = len(rates) - 5 * n
    xi, pivot, face = contact.xi.copy(), contact.pivot.copy(), contact.face.copy()
    rates = rates.copy()
    xi_rate = rates[first : first + 2 * n].reshape(n, 2)
    turn_rate = rates[first + 2 * n :].reshape(n, 3)
    for i, xi_new, face_new in changed:
        charts = surface.charts(np.stack([xi[i], xi_new]), np.array([face[i], face_new]))
        frame, normal_xi, spin = np.empty((2, 3, 3)), np.empty((2, 3, 2)), np.empty((2, 3, 2))
        gauss_frames(charts, frame, normal_xi, spin)
        old, new = charts[0, [D_U, D_V]].T, charts[1, [D_U, D_V]].T
        turn_rate[i] -= pivot[i] @ (spin[0] @ xi_rate[i])
        pivot[i] = pivot[i] @ frame[0].T @ frame[1]
        xi_rate[i] = np.linalg.lstsq(new, old @ xi_rate[i], rcond=None)[0]
        turn_rate[i] += pivot[i] @ (spin[1] @ xi_rate[i])
        xi[i], face[i] = xi_new, face_new
    return contact._replace(xi=xi, pivot=pivot, face=face), rates
