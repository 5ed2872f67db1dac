"""A complete scenario to break, and the faults that loading a text reports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from wbc.errors import ScenarioError
from wbc.scenario import load

COMPLETE = """\
name: hold
robot:
  urdf: planar_bimanual
  fingers: {f1: tip_1, f2: tip_2}
  start: {j1: 10 deg, j2: 5 cm}
object:
  surface: {type: circle, radius: 10 cm}
  pose: {position: [0, 0.5], angle: 90 deg}
contacts:
  f1: {at: [0]}
  f2: {at: [180 deg]}
tasks:
  main: {type: object_pose, gain: 50 /s}
  wrist: {type: frame_position, frame: wrist, target: [1, 2 cm, 0], axes: [x, y], gain: 5}
costs:
  soft: {type: joint_limits, lower: -110 deg, upper: {j1: 90 deg}, stiffness: 5, delta: 2}
stack: {priority: [main, wrist]}
supervisor: {remove_above: 0.05, insert_below: 0.02, smoothing: 'off'}
phases:
  - name: hold
    contacts: {f1: fixed, f2: fixed}
    tasks: [wrist]
    until: {time: 1 s}
    timeout: {after: 2 s, then: stop}
  - name: lift
    contacts: {f1: fixed}
    reach: {f2: {clearance: 1 cm}}
    object: {target: {position: [0, 0.1], angle: 0}, relative: true}
    over: 1 s
simulation: {duration: 3 s, step: 2 ms}
"""


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str | bytes], Path]:
    """Writes t.yaml in a folder that is the working one, so that faults begin with 't.yaml:'."""
    monkeypatch.chdir(tmp_path)

    def writer(text: str | bytes) -> Path:
        path = tmp_path / "t.yaml"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return writer


@pytest.fixture
def faults(write: Callable[[str | bytes], Path]) -> Callable[..., list[str]]:
    """The lines of the error that a text gives; none if it loads."""

    def lines(text: str | bytes, **overrides: object) -> list[str]:
        named = {name.replace("__", "."): value for name, value in overrides.items()}
        try:
            load(write(text), named)
        except ScenarioError as error:
            return str(error).splitlines()
        return []

    return lines


@pytest.fixture
def broken(faults: Callable[..., list[str]]) -> Callable[[str, str], list[str]]:
    """The faults of `COMPLETE` with one text replaced, without the file name."""

    def lines(old: str, new: str) -> list[str]:
        assert COMPLETE.count(old) == 1, f"{old!r} occurs {COMPLETE.count(old)} times"
        return [line.removeprefix("t.yaml:") for line in faults(COMPLETE.replace(old, new))]

    return lines
