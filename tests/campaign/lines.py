"""Lines of a campaign that nobody ran: a heavy object is dropped, trial 3 crashed."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from wbc.campaign.figures import Figures, figures


def trial(
    number: int, success: bool, drawn: dict[str, Any], reason: str = "dropped", **summary: Any
) -> str:
    facts = {
        "trial": number,
        "seed": 100 + number,
        "disturbance": drawn,
        "summary": {"success": success, "reason": "" if success else reason, **summary},
    }
    return json.dumps(facts)


def lines() -> list[str]:
    random = np.random.default_rng(1)
    found = []
    for number in range(40):
        heavy = number % 4 == 0 and number > 0
        drawn = {
            "mass": float(random.uniform(1.15, 1.3) if heavy else random.uniform(0.7, 1.2)),
            "friction": float(random.uniform(0.7, 1.3)),
            "position": random.uniform(-1, 1, 3).tolist(),
            "delay": 0.003,
            "pushes": [],
            "seed": int(random.integers(2**32)),
        }
        if number == 3:
            found.append(trial(number, False, drawn, "crashed"))
            continue
        error = 1e-3 * number
        reason = f"dropped after {0.1 * number:.3g} s: <too heavy>"
        found.append(
            trial(number, not heavy, drawn, reason, object_error_max_m=error, duration=2.0)
        )
    return found


def campaign() -> Figures:
    return figures(lines())
