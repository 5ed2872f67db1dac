"""Lines 1 to 4 of the fault table: sensors that lie, fall silent, freeze, or come at odd times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.faults.injection import DT, Run, readable, run, undisturbed
from wbc.control.force_control import TorqueStatus
from wbc.control.state import Measurement
from wbc.recording.dynamic_facts import object_error_true

AT = 200  # a free hand reaches, the other holds
STOPPING = 110  # ticks from full speed to a stand, the bridged ones included


def spoiled(part: str, value: Any, last: int, one: bool = True) -> Callable[..., Measurement]:
    """A part of the measurement replaced from AT on up to a tick."""

    def seen(k: int, m: Measurement) -> Measurement:
        if not AT <= k < last:
            return m
        if not isinstance(value, float):
            return m._replace(**{part: value})
        bad = np.array(getattr(m, part))
        bad.flat[3 if one else slice(None)] = value
        return m._replace(**{part: bad})

    return seen


def worst(found: Run) -> float:
    """Largest error of the true object [mm]."""
    return 1e3 * float(object_error_true(found.log)[0].max())


CASES = {
    "one nan q": ("q", np.nan, True),
    "all nan q": ("q", np.nan, False),
    "inf q": ("q", np.inf, True),
    "q beyond reason": ("q", 1e6, True),
    "q jumps": ("q", 0.2, True),
    "q missing": ("q", None, True),
    "q wrong size": ("q", np.zeros(3), True),
    "q no numbers": ("q", "none", True),
    "all nan v": ("v", np.nan, False),
    "v missing": ("v", None, True),
    "v beyond reason": ("v", -1e4, True),
    "one nan force": ("force", np.nan, True),
    "force missing": ("force", None, True),
    "force beyond reason": ("force", 1e5, True),
}


@pytest.mark.parametrize("what", CASES)
def test_a_gap_is_bridged_and_said_at_once(what: str) -> None:
    part, value, one = CASES[what]
    found = run(AT + 60, seen=spoiled(part, value, AT + 8, one))
    bad = found.ticks(TorqueStatus.BAD_MEASUREMENT)
    assert bad[0] == AT and bad[-1] == AT + 7
    assert not found.ticks(TorqueStatus.BLIND).size
    assert not found.ticks(TorqueStatus.SLOWED | TorqueStatus.HELD).size
    assert np.array_equal(found.log.q, undisturbed(AT + 60).log.q)  # references went on
    print(f"{what}: {worst(found):.3f} mm")
    assert worst(found) < 0.5


@pytest.mark.parametrize("what", ["one nan q", "all nan v", "force missing", "all nan q"])
def test_a_blind_robot_stands_still_and_goes_on_when_it_sees(what: str, tmp_path: Path) -> None:
    part, value, one = CASES[what]
    back = AT + 200
    found = run(back + 200, seen=spoiled(part, value, back, one))
    blind, held = found.ticks(TorqueStatus.BLIND), found.ticks(TorqueStatus.HELD)
    assert blind[0] == AT + 10 and blind[-1] == back - 1
    assert held[0] - AT <= STOPPING and held[-1] == back - 1
    assert not found.ticks(TorqueStatus.SLOWED)[-1] >= back + 101
    assert np.abs(found.log.v[held]).max() < 1e-3
    print(f"{what}: held after {held[0] - AT} ticks, object {worst(found):.3f} mm")
    assert worst(found) < (5.0 if what == "all nan q" else 1.0)
    assert readable(found.log, tmp_path)


def test_a_frozen_joint_is_noticed() -> None:
    last: dict[str, float] = {}

    def seen(k: int, m: Measurement) -> Measurement:
        if k < AT:
            last.update(q=m.q[9], v=m.v[9])
            return m
        q, v = m.q.copy(), m.v.copy()
        q[9], v[9] = last["q"], last["v"]
        return m._replace(q=q, v=v)

    found = run(AT + 250, seen=seen)
    frozen = found.ticks(TorqueStatus.FROZEN)
    print("frozen joint", frozen[0] - AT, "ticks", worst(found))
    assert frozen[0] - AT <= 40
    assert found.ticks(TorqueStatus.HELD)[0] - frozen[0] <= STOPPING
    assert worst(found) < 1.0


def test_a_frozen_fingertip_is_noticed_once_its_force_should_change() -> None:
    start = int(undisturbed(2000).phase("hand_over")[0])
    since, last = start - 100, np.zeros(3)

    def seen(k: int, m: Measurement) -> Measurement:
        force = m.force.copy()
        if k < since:
            last[:] = force[0]
        force[0] = last
        return m._replace(force=force)

    found = run(start + 200, seen=seen)
    plan = found.log.contact_force_plan[since:, 0]
    other = since + int(np.flatnonzero(np.abs(plan - plan[0]).max(axis=1) >= 0.1)[0])
    frozen, held = found.ticks(TorqueStatus.FROZEN), found.ticks(TorqueStatus.HELD)
    print("frozen tip: after", frozen[0] - since, "0.1 N after", other - since, worst(found))
    assert other > since + 25 and abs(frozen[0] - other) <= 2
    assert held[0] - frozen[0] <= STOPPING and held[-1] == start + 199
    assert worst(found) < 1.0


def stuck(k: int, tau: np.ndarray, sensed: Any) -> np.ndarray:
    """A gear of the free arm jams: a spring holds the joint where it was."""
    if k < 100:
        stuck.at = sensed.q[8]  # type: ignore[attr-defined]
        return tau
    out = tau.copy()
    out[8] = 4e3 * (stuck.at - sensed.q[8]) - 60.0 * sensed.v[8]  # type: ignore[attr-defined]
    return out


def test_a_joint_that_is_stuck_stops_the_motion() -> None:
    found = run(500, motors=stuck)
    tracking = found.ticks(TorqueStatus.TRACKING)
    error = np.abs(found.log.q - found.log.q_meas)[:, 8]
    print(f"said at {error[tracking[0]]:.3f} rad, at most {error.max():.3f}, {worst(found):.3f} mm")
    assert 0.05 < error[tracking[0]] < 0.052  # half the threshold
    assert error.max() < 0.105
    assert found.log.torque_status[-1] & (TorqueStatus.SLOWED | TorqueStatus.HELD)
    assert worst(found) < 1.0


def stamped(times: Callable[[int], float]) -> Callable[..., Measurement]:
    return lambda k, m: m._replace(stamp=times(k))


def test_time_stamps_in_order_change_nothing() -> None:
    found = run(150, seen=stamped(lambda k: 7.0 + DT * k))
    assert not found.log.torque_status.any()
    assert np.array_equal(found.log.tau, undisturbed(150).log.tau)


@pytest.mark.parametrize(
    ("what", "flag"), [("late", "LATE"), ("same", "STALE"), ("back", "STALE"), ("ten", "LATE")]
)
def test_ticks_at_odd_times(what: str, flag: str) -> None:
    def times(k: int) -> float:
        if what == "late":  # each tick from AT on takes twice its time
            return DT * (k + max(k - AT + 1, 0) * (k < AT + 150) + 150 * (k >= AT + 150))
        if what == "ten":  # one tick takes ten times its time
            return DT * (k + 10 * (k >= AT))
        step = {"same": 0, "back": -1}[what]
        return DT * (AT - 1 + step * (k - AT + 1) if AT <= k < AT + 150 else k)

    found = run(AT + 300, seen=stamped(times))
    said = found.ticks(TorqueStatus[flag])
    assert said[0] == AT
    held = found.ticks(TorqueStatus.HELD)
    if what == "ten":
        assert list(said) == [AT] and not held.size
    else:
        assert held[0] - AT <= STOPPING and said[-1] - AT in (148, 149)
        assert not found.log.torque_status[-1]
    print(what, worst(found))
    assert worst(found) < 5.0
