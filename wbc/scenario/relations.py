"""What must hold between the keys of one block: order of two values, one key or the other.

Like `crosscheck`, on the plain data, so that one bad value does not hide the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from wbc.scenario.blocks import EVERY
from wbc.scenario.schema import MAX_TICKS, Supervisor
from wbc.scenario.units import NUMBER, QuantityError, read
from wbc.scenario.wording import Faults, KeyPath, clip, listing, mapping

_TARGETED = ("frame_pose", "relative_pose", "frame_orientation")


def check_relations(data: dict[str, Any], faults: Faults) -> None:
    """Add the faults between keys of single blocks of `data`."""
    _supervisor(mapping(data.get("supervisor")), faults)
    _simulation(mapping(data.get("simulation")), faults)
    for name, cost in mapping(data.get("costs")).items():
        if mapping(cost).get("type") == "joint_limits":
            _soft_limits(("costs", name), cost, faults)
    for path, pose in _poses(data):
        if isinstance(pose, dict):
            _pose(path, pose, faults)
    phases = listing(data.get("phases"))
    for i, phase in enumerate(phases):
        if isinstance(phase, dict):
            _durations(("phases", i), phase, faults)
            _ending(("phases", i), phase, i + 1 == len(phases), faults)


def si(raw: Any, *dimensions: str) -> float | None:
    """The value in SI; None when it is missing or cannot be read."""
    try:
        return read(raw, *dimensions).value
    except QuantityError:
        return None


def _supervisor(block: dict[str, Any], faults: Faults) -> None:
    default = Supervisor.model_fields
    above = si(block.get("remove_above", default["remove_above"].default), NUMBER)
    below = si(block.get("insert_below", default["insert_below"].default), NUMBER)
    if above is not None and below is not None and not below < above:
        key = "insert_below" if "insert_below" in block else "remove_above"
        text = f"insert_below ({below:g}) must be below remove_above ({above:g})"
        faults.add(("supervisor", key), text)


def _simulation(block: dict[str, Any], faults: Faults) -> None:
    duration, step = si(block.get("duration"), "time"), si(block.get("step"), "time")
    if duration is None or step is None or not (duration > 0.0 and step > 0.0):
        return
    if step > duration:
        faults.add(("simulation", "step"), "must not be longer than the duration")
    elif duration / step > MAX_TICKS:
        faults.add(("simulation", "step"), f"makes more than {MAX_TICKS} ticks of the duration")


def _soft_limits(path: KeyPath, cost: dict[str, Any], faults: Faults) -> None:
    sides = [
        v if isinstance(v, dict) else {EVERY: v} for v in (cost.get("lower"), cost.get("upper"))
    ]
    for joint in {**sides[0], **sides[1]}:
        low, high = (si(side.get(joint, side.get(EVERY)), "angle", "length") for side in sides)
        if low is not None and high is not None and not low < high:
            what = "" if joint == EVERY else f" of {clip(joint)}"
            faults.add((*path, "lower"), f"the lower limit{what} must be below the upper one")


def _poses(data: dict[str, Any]) -> Iterator[tuple[KeyPath, Any]]:
    yield ("object", "pose"), mapping(data.get("object")).get("pose")
    for name, task in mapping(data.get("tasks")).items():
        if mapping(task).get("type") in _TARGETED:
            yield ("tasks", name, "target"), task.get("target")
    for i, phase in enumerate(listing(data.get("phases"))):
        yield ("phases", i, "object", "target"), mapping(mapping(phase).get("object")).get("target")


def _pose(path: KeyPath, pose: dict[str, Any], faults: Faults) -> None:
    if not pose:
        faults.add(path, "is empty")
    size = len(listing(pose.get("position")))
    for key in ("rpy", "quaternion"):
        if key in pose and size == 2:
            faults.add((*path, key), "a position [x, y] goes with an angle", on="key")
    if "angle" in pose and size == 3:
        text = "a position [x, y, z] goes with rpy or quaternion"
        faults.add((*path, "angle"), text, on="key")
    if "rpy" in pose and "quaternion" in pose:
        faults.add((*path, "quaternion"), "give rpy or quaternion, not both", on="key")


def _durations(path: KeyPath, phase: dict[str, Any], faults: Faults) -> None:
    if "over" not in phase:
        for key in ("reach", "object", "weights"):
            if phase.get(key):
                text = "needs 'over' in this phase, the duration of the motion"
                faults.add((*path, key), text, on="key")
    timeout, until = mapping(phase.get("timeout")), mapping(phase.get("until"))
    after = si(timeout.get("after"), "time")
    if after is None:
        return
    time, over = si(until.get("time"), "time"), si(phase.get("over"), "time")
    if time is not None and not after > time:
        text = "comes no later than until.time, so the phase cannot succeed"
        faults.add((*path, "timeout", "after"), text)
    stops = timeout.get("then") == "stop" and until.get("touch") is None
    if stops and over is not None and after < over:
        text = "comes before the motions' end ('over'), so the phase cannot succeed"
        faults.add((*path, "timeout", "after"), text)


def _ending(path: KeyPath, phase: dict[str, Any], last: bool, faults: Faults) -> None:
    until = phase.get("until")
    # touch: {} asks for a touch by its defaults, residual: {} for nothing
    if isinstance(until, dict) and not any(
        v is not None and (v != {} or key == "touch") for key, v in until.items()
    ):
        text = "is empty: give time, residual, tip_error, distance, force_closure, touch or press"
        faults.add((*path, "until"), text)
    if until is None and phase.get("timeout") is None and not last:
        faults.add(path, "never ends: give it 'until'")
