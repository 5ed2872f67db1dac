"""A campaign in numbers: how many succeed, what fails first, how large errors are, and why."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from wbc.arrays import Array, BoolArray

_Z: Final = 1.959963984540054  # 95 % of a normal distribution lie within
_FEWEST: Final = 3  # successes and failures each, before their values are compared
_NUMBER: Final = re.compile(r"(?<![\w'.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w'])")
_MEASURES: Final = (
    ("object, error [mm]", ("object_error_max_m",), 1e3),
    ("object, turned by [mrad]", ("object_error_max_rad",), 1e3),
    ("object at the hand-over, error [mm]", ("object_error_handover_m",), 1e3),
    ("object at the hand-over, turned by [mrad]", ("object_error_handover_rad",), 1e3),
    ("object at rest, creep [mm/s]", ("creep_m_per_s",), 1e3),
    ("object by the fingers, error [mm]", ("object_error", "settled", "position"), 1e3),
    ("object by the fingers, turned by [mrad]", ("object_error", "settled", "orientation"), 1e3),
    ("slip [mm]", ("slip_max_m",), 1e3),
    ("contact lost for [s]", ("contact_lost_s",), 1.0),
    ("smallest distance [mm]", ("distance", "min"), 1e3),
    ("torque, share of its limit [%]", ("tau_max_ratio",), 1e2),
    ("duration [s]", ("duration",), 1.0),
)
"""Name, place in a summary, factor to the unit of the name; those a campaign has none of go."""


class Interval(NamedTuple):
    """A share and its 95 % confidence interval."""

    share: float
    low: float
    high: float


class Comparison(NamedTuple):
    """A drawn quantity, where trials failed against where they did not.

    Attributes:
        name: of the quantity.
        success, failure: medians.
        above: how often a failure's value is above a success's; 0.5 says nothing.
        p: of the Mann-Whitney test, for one quantity looked at alone.
    """

    name: str
    success: float
    failure: float
    above: float
    p: float


@dataclass(frozen=True)
class Figures:
    """What the lines of a campaign say.

    Attributes:
        numbers, seeds: of the trials.
        success: (T,) whether each succeeded.
        reasons: of each, empty for a success.
        measures: name to (T,) values, NaN where a trial has none.
        drawn: name to (T,) values of what differs among the trials.
        comparisons: of `drawn`, the most telling first; empty if there is too little to compare.
    """

    numbers: tuple[int, ...]
    seeds: tuple[int, ...]
    success: BoolArray
    reasons: tuple[str, ...]
    measures: Mapping[str, Array]
    drawn: Mapping[str, Array]
    comparisons: tuple[Comparison, ...]

    @property
    def rate(self) -> Interval:
        """How many succeed."""
        return wilson(int(self.success.sum()), len(self.success))

    @property
    def kinds(self) -> list[tuple[str, int, int]]:
        """What failed first: kind of reason, how often, the first trial it befell."""
        kinds = [kind(reason) for reason in self.reasons]
        counts = Counter(k for k in kinds if k)
        return [(k, n, self.numbers[kinds.index(k)]) for k, n in counts.most_common()]


def figures(lines: Iterable[str]) -> Figures:
    """Read the lines of trials.jsonl."""
    trials = [json.loads(line) for line in lines]
    success = np.array([bool(t["summary"]["success"]) for t in trials], dtype=np.bool_)
    drawn = _differing([_flat(t["disturbance"]) for t in trials])
    measures = {
        name: np.array([_at(t["summary"], path, times) for t in trials])
        for name, path, times in _MEASURES
    }
    return Figures(
        numbers=tuple(t["trial"] for t in trials),
        seeds=tuple(t["seed"] for t in trials),
        success=success,
        reasons=tuple(_reason(t["summary"]) for t in trials),
        measures={name: v for name, v in measures.items() if not np.isnan(v).all()},
        drawn=drawn,
        comparisons=_compared(drawn, success),
    )


def wilson(successes: int, trials: int) -> Interval:
    """Wilson's score interval of a share; 0 to 1 without trials.

    It stays within [0, 1] and is not empty where all or none succeed.
    """
    if not trials:
        return Interval(math.nan, 0.0, 1.0)
    share, z2 = successes / trials, _Z**2 / trials
    middle = (share + z2 / 2.0) / (1.0 + z2)
    half = _Z * math.sqrt(share * (1.0 - share) / trials + z2 / trials / 4.0) / (1.0 + z2)
    low = 0.0 if successes == 0 else middle - half
    return Interval(share, low, 1.0 if successes == trials else middle + half)


def kind(reason: str) -> str:
    """A reason without its numbers and details; of several faults the first."""
    first = reason.partition("; ")[0]
    if not first.startswith(("refused: ", "internal error: ")):
        first = first.partition(": ")[0]
    text = _NUMBER.sub("#", first)
    return text if len(text) <= 120 else text[:117] + "..."


def _reason(summary: Mapping[str, Any]) -> str:
    """Why a trial failed, what failed first in front; empty for a success."""
    why = "" if summary["success"] else str(summary["reason"])
    first, phase = summary.get("failure"), summary.get("failure_phase")
    if not why or first is None:
        return why
    return f"{first} in phase '{phase}': {why}" if phase else f"{first}: {why}"


def _at(summary: Mapping[str, Any], path: tuple[str, ...], times: float) -> float:
    value: Any = summary
    for key in path:
        value = value.get(key) if isinstance(value, Mapping) else None
    return times * float(value) if isinstance(value, int | float) else math.nan


def _flat(drawn: Mapping[str, Any]) -> dict[str, float]:
    """Numbers by name; of a vector its coordinates and its length."""
    flat: dict[str, float] = {}
    for name, value in drawn.items():
        if name == "seed" or isinstance(value, bool):
            continue
        if isinstance(value, int | float):
            flat[name] = float(value)
        elif name in ("position", "rotation"):
            flat |= {f"{name}.{axis}": float(v) for axis, v in zip("xyz", value, strict=True)}
            flat[f"{name}, length"] = math.hypot(*value)
    return flat


def _differing(rows: list[dict[str, float]]) -> dict[str, Array]:
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: np.array([row.get(name, math.nan) for row in rows]) for name in names}
    return {name: v for name, v in columns.items() if np.nanmax(v) > np.nanmin(v)}


def _compared(drawn: Mapping[str, Array], success: BoolArray) -> tuple[Comparison, ...]:
    found = []
    for name, values in drawn.items():
        known = ~np.isnan(values)
        good, bad = values[known & success], values[known & ~success]
        if min(len(good), len(bad)) >= _FEWEST:
            found.append(_comparison(name, good, bad))
            if not name.endswith("length"):  # both ends may be bad, and the middle good
                middle = 0.5 * (values[known].min() + values[known].max())
                far = f"{name}, off the middle"
                found.append(_comparison(far, np.abs(good - middle), np.abs(bad - middle)))
    return tuple(sorted(found, key=lambda c: (c.p, c.name)))


def _comparison(name: str, good: Array, bad: Array) -> Comparison:
    from scipy.stats import mannwhitneyu

    result = mannwhitneyu(bad, good)
    above = float(result.statistic) / (len(good) * len(bad))
    return Comparison(
        name, float(np.median(good)), float(np.median(bad)), above, float(result.pvalue)
    )
