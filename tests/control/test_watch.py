"""The watchdogs by themselves: readings of every kind, fingers felt or not, odd times and paces."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from wbc.arrays import Array
from wbc.contact.grasp import ContactMode
from wbc.control.force_control import TorqueStatus
from wbc.control.pace import paced
from wbc.control.phases import unsupported
from wbc.control.readings import Readings
from wbc.control.references import Motion
from wbc.control.state import Measurement, PhaseState
from wbc.control.watch import View, Watch, WatchSettings, WatchState

from .drivers import Broken

DT = 2e-3
Q = np.zeros(2)
NORMALS = np.tile([0.0, -1.0, 0.0], (4, 1))
FIXED, FREE = int(ContactMode.FIXED), int(ContactMode.FREE)


class Robot:
    """Two joints and four fingers that hold, and what the watchdogs make of it."""

    def __init__(self, plan: Array) -> None:
        limit = np.full(2, 2.0)
        readings = Readings(-limit, limit, limit, 4, 10, 25)
        self.watch = Watch(WatchSettings(), readings, np.zeros(2, dtype=np.bool_), 4)
        self.state: WatchState = self.watch.init()._replace(
            mode=np.full(4, FIXED), normals=NORMALS, plan=-plan[:, None] * NORMALS
        )
        self._ticks = 0

    def look(self, press: Array, **other: Any) -> View:
        """A tick with normal forces (4,) [N]; a little noise, so that no sensor seems frozen."""
        self._ticks += 1
        noise = 1e-6 * (self._ticks % 7)
        force = -(press + noise)[:, None] * NORMALS
        given = {"q": Q + noise, "v": Q + noise, "force": force, **other}
        view, self.state = self.watch.look(self.state, Measurement(**given), Q, Q, DT)
        return view


FIVE = np.full(4, 5.0)


def test_sensors_that_are_not_there_are_no_reason_to_stand_and_one_that_falls_silent_is() -> None:
    robot, none = Robot(FIVE), np.full((4, 3), np.nan)
    for _ in range(100):
        view = robot.look(FIVE, v=None, force=none)
    assert view.status == TorqueStatus.BAD_MEASUREMENT
    assert view.pace == 1.0 and view.bears is None
    np.testing.assert_array_equal(view.measured.force, robot.state.plan)
    some = none.copy()
    some[:3] = -5.0 * NORMALS[:3]
    for k in range(100):
        view = robot.look(FIVE, v=None, force=some * (1.0 + 1e-6 * (k % 7)))
    assert view.status == TorqueStatus.BAD_MEASUREMENT
    assert view.pace == 1.0 and view.bears is not None and view.bears.all()
    for _ in range(12):
        view = robot.look(FIVE, v=None, force=none)
    assert view.status & TorqueStatus.BLIND
    assert robot.look(FIVE, q=np.full(2, np.nan)).status & TorqueStatus.BAD_MEASUREMENT


def test_a_velocity_that_nobody_measures_comes_of_positions() -> None:
    robot = Robot(FIVE)
    for k in range(200):
        view = robot.look(FIVE, q=np.full(2, 1e-4 * k), v=None)
    np.testing.assert_allclose(view.measured.v, 0.05, rtol=1e-3)
    assert view.status == TorqueStatus.BAD_MEASUREMENT and view.pace == 1.0


def test_buffers_that_a_driver_fills_again_are_copied() -> None:
    robot, q, v, force = Robot(FIVE), Q.copy(), Q.copy(), -FIVE[:, None] * NORMALS
    for k in range(60):
        q[:], v[:] = 1e-4 * k, 0.05
        force += 1e-4
        view, robot.state = robot.watch.look(robot.state, Measurement(q, v, force), Q + q, v, DT)
        assert not view.status
        assert not np.shares_memory(robot.state.readings.q, q)


class _Refuses:
    def __array__(self, *_: Any, **__: Any) -> Array:
        raise RuntimeError("no device")


@pytest.mark.parametrize(
    "values",
    [[10**400, 0.0], _Refuses(), Q + 1j, ["0", "0"], "00", {}, [[0.0], [0.0, 1.0]], b"ab",
     np.array(["2026-01-01"] * 2, dtype="datetime64[s]"), [object(), 0.0]],
)  # fmt: skip
def test_whatever_a_driver_hands_over_is_bridged(values: Any) -> None:
    robot = Robot(FIVE)
    robot.look(FIVE)
    view = robot.look(FIVE, q=values)
    assert view.status == TorqueStatus.BAD_MEASUREMENT
    assert np.isfinite(view.measured.q).all()


@pytest.mark.parametrize("field", ["q", "v", "force", "stamp"])
def test_a_field_that_raises_is_bridged(field: str) -> None:
    robot = Robot(FIVE)
    robot.look(FIVE, stamp=2.998)
    measured: Any = Broken(field, q=Q, v=Q, force=-FIVE[:, None] * NORMALS, stamp=3.0)
    view, _ = robot.watch.look(robot.state, measured, Q, Q, DT)
    assert view.status == TorqueStatus.BAD_MEASUREMENT
    assert np.isfinite(view.measured.q).all()


def test_a_joint_that_only_its_velocity_tells_stays_within_bounds_and_counts_as_off() -> None:
    robot = Robot(FIVE)
    for _ in range(15_000):  # 30 s at 0.2 rad/s, which it is not
        view = robot.look(FIVE, q=np.array([np.nan, 0.0]), v=np.array([0.2, 0.0]))
    assert np.abs(view.measured.q).max() <= 1.0
    assert view.status & TorqueStatus.TRACKING


@pytest.mark.parametrize("kind", [int, float, np.float32, np.float64, np.int64, Fraction])
def test_stamps_of_any_kind_of_number(kind: Any) -> None:
    robot = Robot(FIVE)
    assert not robot.look(FIVE, stamp=kind(3)).status
    assert robot.look(FIVE, stamp=kind(3)).status & TorqueStatus.STALE
    assert robot.look(FIVE, stamp=kind(4)).status & TorqueStatus.LATE


@pytest.mark.parametrize("stamp", ["3", np.nan, np.inf, 10**400, 1j, [3.0]])
def test_stamps_that_are_no_times_are_said(stamp: Any) -> None:
    assert Robot(FIVE).look(FIVE, stamp=stamp).status & TorqueStatus.BAD_MEASUREMENT


def test_a_gap_in_its_readings_does_not_hide_that_a_contact_is_lost() -> None:
    robot, gap = Robot(FIVE), np.array([5.0, 5.0, np.nan, 5.0])
    lost = np.array([5.0, 5.0, 0.0, 5.0])
    for k in range(40):
        view = robot.look(gap if k % 12 == 0 else lost)
    assert view.status & TorqueStatus.CONTACT_LOST and view.seeks.tolist() == [False] * 4
    for k in range(40):
        view = robot.look(gap if k % 12 == 0 else lost)
    assert view.seeks.tolist() == [False, False, True, False]


def test_a_second_lost_finger_and_one_found_again_pass_on_their_parts_without_a_step() -> None:
    robot, last = Robot(FIVE), np.zeros(4)
    for k in range(400):
        press = FIVE.copy()
        press[2] = 0.0 if k < 200 else 5.0
        press[3] = 0.0 if 60 <= k < 300 else 5.0
        spare = robot.look(press).spare
        assert np.abs(spare - last).max() <= DT / 0.05 + 1e-12
        last = spare
        if k == 199:
            assert spare.tolist() == [0.0, 0.0, 1.0, 1.0]
        if k == 299:
            np.testing.assert_allclose(spare, [0.0, 0.0, 0.0, 1.0], atol=0.01)


def released(view: View, balanced: bool = True) -> bool:
    """Whether the first two fingers may let go."""
    before, after = np.full(4, FIXED), np.array([FREE, FREE, FIXED, FIXED])
    return not unsupported(before, after, balanced, view.bears, view.asked)


def test_nobody_lets_go_of_what_no_one_is_felt_to_hold() -> None:
    assert released(Robot(FIVE).look(FIVE))
    assert not released(Robot(FIVE).look(FIVE), balanced=False)
    little = np.array([5.0, 5.0, 0.05, 0.05])  # planned: as good as nothing
    assert not released(Robot(little).look(np.array([5.0, 5.0, 0.0, 0.0])))
    passive = np.array([5.0, 5.0, 5.0, 0.05])
    assert released(Robot(passive).look(np.array([5.0, 5.0, 5.0, 0.0])))
    assert not released(Robot(passive).look(np.array([5.0, 5.0, 0.0, 1.0])))


def test_blind_is_not_the_same_as_never_measured() -> None:
    robot = Robot(FIVE)
    assert released(robot.look(FIVE, force=None))  # there are no sensors
    robot.look(FIVE)
    assert not released(robot.look(FIVE, force=None))
    robot = Robot(FIVE)
    robot.look(FIVE)
    assert not released(robot.look(np.array([5.0, 5.0, 5.0, np.nan])))
    robot = Robot(FIVE)
    none = np.array([5.0, 5.0, 5.0, np.nan])
    robot.look(none)
    assert released(robot.look(none))  # the fourth has none


@pytest.mark.parametrize(("pace", "taken"), [(np.nan, 0.0), (-1.0, 0.0), (2.0, 1.0), (0.5, 0.5)])
def test_paces_are_brought_into_their_range(pace: float, taken: float) -> None:
    none = np.zeros((2, 3))
    motion = Motion(0.0, 1.0, none, np.eye(3), none[0], np.zeros((2, 1)), np.zeros((2, 1, 3)), ())
    phase = paced(PhaseState(0, 0.0, motion, False, False, ()), 0.1, DT, pace)
    assert phase.motion.pace == taken and np.isfinite(phase.motion.quickening)
