"""Trials that are no runs: for tests of what is around them, in processes that start quickly."""

from __future__ import annotations

import json
import os

from wbc.campaign.trial import Done, Trial

CRASHES = 2  # a trial


def light(trial: Trial) -> Done:
    """A success that says what it was given."""
    facts = {
        "trial": trial.number,
        "seed": trial.seed,
        "disturbance": dict(trial.varied),
        "summary": {"success": True, "reason": ""},
    }
    return Done(json.dumps(facts), 0.0)


def light_or_crash(trial: Trial) -> Done:
    """The same, but for one that no Python survives."""
    if trial.number == CRASHES:
        os.abort()
    return light(trial)
