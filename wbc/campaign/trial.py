"""What a trial is, to whoever runs it: everything it depends on, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

ATTEMPTS: Final = 3
"""A trial whose process died this often is recorded as crashed."""
CRASHED: Final = "crashed"
"""The reason of such a trial."""

Keep: TypeAlias = Literal["failed", "all", "none"]


class Trial(NamedTuple):
    """One trial. Its result is a function of text, overrides and seed.

    Attributes:
        number: in the campaign, from 0.
        seed: its own.
        text: the scenario file's bytes.
        path: where they came from, for files named beside it.
        shown: that path as faults name it.
        overrides: values set on top, the seed and what varies included.
        varied: the values drawn for `overrides`, in SI.
        folder: where its log goes.
        keep: whose log is kept.
    """

    number: int
    seed: int
    text: bytes
    path: Path
    shown: str
    overrides: Mapping[str, Any]
    varied: Mapping[str, float]
    folder: Path
    keep: Keep


class Done(NamedTuple):
    """What came of a trial.

    Attributes:
        line: JSON on one line; the same bytes wherever it ran.
        seconds: computing time, which is not in the line.
    """

    line: str
    seconds: float


def trial_seed(campaign: int, number: int) -> int:
    """Seed of a trial: that of the campaign's child `number`, whatever the number of trials.

    It has 53 bits, so that also readers of JSON that know doubles only keep it whole.
    """
    child = np.random.SeedSequence(campaign, spawn_key=(number,))
    return int(child.generate_state(1, np.uint64)[0] >> np.uint64(11))
