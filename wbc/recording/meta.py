"""What a run was: the part of a log that does not change from tick to tick."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import platform
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any

from wbc.errors import WbcError

_PACKAGES = ("wbc", "pin", "coal", "numpy", "scipy", "numba", "mujoco", "pydantic", "PyYAML")


def installed_versions() -> dict[str, str]:
    """Versions of Python and of the packages a run depends on; those not installed are left out."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


@dataclass(frozen=True)
class RunMeta:
    """Names, limits and origin of a run; saved with the log as one JSON text.

    Attributes:
        scenario: its name.
        dt: the tick, [s].
        joint_names: of the active joints, in the order of q and v.
        contact_names: the fingers, in the order of every (N,) array.
        task_names: the stack's secondary tasks, as the controller lists them, without the tips.
        tip_task_names: the tip tasks, which follow them in the controller's (M,) arrays.
        main_task: name of the task above them, e.g. ``"object"``; None if there is none.
        phase_names: the phases in order.
        scenario_text: the scenario as it was run.
        source: the file it came from.
        seed: of the run's random numbers.
        versions: package to version.
        q_lower, q_upper, v_limit: (n,) hard limits of the joints, [rad] or [m] and per second;
            empty where unknown.
        task_units: units of the errors of main and secondary tasks; empty where unknown.
        remove_above, insert_below: the supervisor's thresholds of the cost.
        safety_distance: below which the collision cost acts, [m].
        tau_min, tau_max: (n,) torque limits of the joints, [Nm]; empty, as all that follows, where
            no contact forces are planned.
        mu, mu_t: (N,) friction coefficients of the contacts, [1], and about the normal, [m].
        contact_models: (N,) ``"point"`` or ``"soft_finger"``.
    """

    scenario: str
    dt: float
    joint_names: tuple[str, ...]
    contact_names: tuple[str, ...]
    task_names: tuple[str, ...]
    tip_task_names: tuple[str, ...]
    main_task: str | None
    phase_names: tuple[str, ...]
    scenario_text: str = ""
    source: str = ""
    seed: int | None = None
    versions: Mapping[str, str] = field(default_factory=installed_versions)
    q_lower: tuple[float, ...] = ()
    q_upper: tuple[float, ...] = ()
    v_limit: tuple[float, ...] = ()
    task_units: tuple[str, ...] = ()
    remove_above: float | None = None
    insert_below: float | None = None
    safety_distance: float | None = None
    tau_min: tuple[float, ...] = ()
    tau_max: tuple[float, ...] = ()
    mu: tuple[float, ...] = ()
    mu_t: tuple[float, ...] = ()
    contact_models: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.dt) and self.dt > 0.0):
            raise WbcError(f"dt must be positive, got {self.dt}")
        joints, contacts = len(self.joint_names), len(self.contact_names)
        for name, size in (
            ("q_lower", joints), ("q_upper", joints), ("v_limit", joints),
            ("task_units", len(self.log_task_names)), ("tau_min", joints), ("tau_max", joints),
            ("mu", contacts), ("mu_t", contacts), ("contact_models", contacts),
        ):  # fmt: skip
            if len(getattr(self, name)) not in (0, size):
                raise WbcError(f"{name} has {len(getattr(self, name))} entries, expected {size}")

    @property
    def log_task_names(self) -> tuple[str, ...]:
        """Task names in the order of the log: the main task first."""
        return self.task_names if self.main_task is None else (self.main_task, *self.task_names)

    @property
    def scenario_hash(self) -> str:
        """SHA-256 of the scenario's text, in hexadecimal."""
        return hashlib.sha256(self.scenario_text.encode("utf-8", "surrogatepass")).hexdigest()

    def to_json(self) -> str:
        """One JSON object; infinite limits become null."""
        data: dict[str, Any] = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name in _MISSING_LIMIT:
            data[name] = [x if math.isfinite(x) else None for x in map(float, data[name])]
        data["versions"] = dict(sorted(self.versions.items()))
        data["scenario_sha256"] = self.scenario_hash
        return json.dumps(data, sort_keys=True, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> RunMeta:
        """The inverse of `to_json`; a text that is anything else raises `WbcError`."""
        try:
            data = json.loads(text, parse_constant=_no_number)
        except (ValueError, RecursionError) as error:
            raise WbcError("its 'meta' is not JSON") from error
        if not isinstance(data, dict):
            raise WbcError("its 'meta' is not a JSON object")
        hints = typing.get_type_hints(cls)
        values = {}
        for f in dataclasses.fields(cls):
            if f.name in _OF_FORCES and f.name not in data:
                continue  # logs of format 1 plan none
            if f.name not in data:
                raise WbcError(f"its 'meta' lacks '{f.name}'")
            try:
                values[f.name] = _typed(f.name, data[f.name], hints[f.name])
            except OverflowError as error:
                raise WbcError(f"its 'meta' has a bad '{f.name}'") from error
        return cls(**values)


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is not JSON")


_OF_FORCES = ("tau_min", "tau_max", "mu", "mu_t", "contact_models")
_MISSING_LIMIT = {
    "q_lower": -math.inf, "q_upper": math.inf, "v_limit": math.inf, "tau_min": -math.inf,
    "tau_max": math.inf,
}  # fmt: skip


def _typed(name: str, value: Any, hint: Any) -> Any:
    """`value` out of JSON as the field's type."""
    if hint == tuple[str, ...] and _all(value, str):
        return tuple(value)
    if hint == tuple[float, ...] and isinstance(value, list):
        filled: list[Any] = [_MISSING_LIMIT.get(name) if x is None else x for x in value]
        if _all(filled, (int, float)):
            return tuple(map(float, filled))
    if hint == Mapping[str, str] and isinstance(value, dict) and _all([*value.values()], str):
        return value
    options = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    if value is None and type(None) in options:
        return None
    if float in options and _all([value], (int, float)):
        return float(value)
    if int in options and _all([value], int):
        return value
    if str in options and isinstance(value, str):
        return value
    raise WbcError(f"its 'meta' has a bad '{name}'")


def _all(values: Any, kind: type | tuple[type, ...]) -> bool:
    # a bool is an int to Python, never to a log
    return isinstance(values, list) and all(
        isinstance(x, kind) and not isinstance(x, bool) for x in values
    )
