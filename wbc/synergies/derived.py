"""What the chapter's Tables 1 to 5 imply, computed from them alone."""

from __future__ import annotations

from itertools import product
from typing import Any, Final

import numpy as np

from wbc.arrays import Array
from wbc.synergies.synergies import Synergies
from wbc.synergies.tables import tables

_MEASURED: Final = (-10.0, 0.0, 10.0)
"""What the thumb's adduction/abduction was in every reference posture, [deg]: Table 3 says so."""
_ROUNDING: Final = 0.1
"""Two printed numbers of Tables 2 and 3, each rounded to a tenth, are off by less, [deg]."""
_TOUCHES: Final = 1e-7
"""A smaller excess is rounding, not the tables' but the computer's, [deg]."""


def measured_thumb() -> Array:
    """(36,) the measured adduction/abduction of the thumb in C1 to C36, [deg].

    With ĉ of (55) and the error e of Table 3's column "three syn" it is ĉ + e or ĉ − e, and one of
    both is −10, 0 or 10 within the rounding. Where both are, (52) decides: the offsets' products
    with the weights are Σ α (c − c̄) = Ê₁ Σ α², and another choice would change them by far.
    """
    t = tables()
    thumb, error = _thumb_of_three()
    choices = [
        [m for m in _MEASURED if abs(abs(m - c) - e) <= _ROUNDING]
        for c, e in zip(thumb, error, strict=True)
    ]
    squares = (t.weights**2).sum(axis=0)

    def misfit(chosen: tuple[float, ...]) -> float:
        rows = (np.array(chosen) - t.mean[0]) @ t.weights / squares
        return float(np.linalg.norm(rows - t.basis[0]))

    return np.array(min(product(*choices), key=misfit))


def two_synergy_errors() -> tuple[Array, Array]:
    """The columns "two syn" of Tables 3 and 4 from their columns "three syn", 2 × (36,), [deg].

    Without the third synergy the error grows by α₃ e₃, which is orthogonal to what is left:
    Table 3: |± err + α₃ E₁₃|, the sign by `measured_thumb`; Table 4: 15 e is the norm of the
    error, (15 e)² grows by α₃². The third column is taken of length 1, as (52) makes it; Table 1
    prints it 0.2 % too short, by its entry thumb_prox (see `wbc.synergies.consistent`).
    """
    t = tables()
    n, third = len(t.joints), t.weights[:, 2]
    thumb, error = _thumb_of_three()
    signed = np.copysign(error, measured_thumb() - thumb)
    of_thumb: Array = np.abs(signed + third * t.basis[0, 2])
    average: Array = np.hypot(n * t.errors[:, 1], third) / n
    return of_thumb, average


def derived() -> dict[str, Any]:
    """Everything that follows from Tables 1 to 5, in lists and plain numbers, [deg].

    Keys: ``names`` (41, C1 to C36 and G1 to G5), ``joints`` (15, in Table 1's order), ``sigma``
    (σ₁, σ₂, σ₃ of (53) from Tables 2 and 4), ``alpha`` (41 × 3), ``postures_deg`` (41 × 15, (55)),
    ``commanded_deg`` (the same, each joint clipped to its range), ``beyond_limits`` (posture →
    joint → how far above (> 0) or below (< 0) the hand's range, where it is), ``table3_two_syn``
    and ``table4_two_syn`` (36, `two_synergy_errors`), ``thumb_measured_deg`` (36,
    `measured_thumb`), ``ranges_deg`` (15 × 2) and ``synergy_ranges_deg`` (3 × 2, the weights of
    each synergy alone that keep every joint in its range).
    """
    t = tables()
    hand = Synergies.from_table()
    names = (*t.names, *t.new_names)
    alpha = np.vstack((t.weights, t.new_weights))
    postures = t.mean + alpha @ t.basis.T
    commanded = np.clip(postures, t.lower, t.upper)
    excess = postures - commanded
    beyond = {
        name: {
            joint: float(value)
            for joint, value in zip(t.joints, row, strict=True)
            if abs(value) > _TOUCHES
        }
        for name, row in zip(names, excess, strict=True)
    }
    thumb_errors, errors = two_synergy_errors()
    return {
        "names": list(names),
        "joints": list(t.joints),
        "sigma": hand.explained.tolist(),
        "alpha": alpha.tolist(),
        "postures_deg": postures.tolist(),
        "commanded_deg": commanded.tolist(),
        "beyond_limits": {name: joints for name, joints in beyond.items() if joints},
        "table3_two_syn": thumb_errors.tolist(),
        "table4_two_syn": errors.tolist(),
        "thumb_measured_deg": measured_thumb().tolist(),
        "ranges_deg": np.stack((t.lower, t.upper), axis=1).tolist(),
        "synergy_ranges_deg": np.rad2deg(hand.ranges()).tolist(),
    }


def _thumb_of_three() -> tuple[Array, Array]:
    """ĉ of the thumb's adduction/abduction with three synergies, and Table 3's error of it."""
    t = tables()
    return t.mean[0] + t.weights @ t.basis[0], t.thumb_errors[:, 1]
