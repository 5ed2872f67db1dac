"""The supervisor on made-up forecasts: whom it removes, when it waits, when it puts back."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wbc.stack.activation import advance, start
from wbc.stack.supervisor import StackEvent, StackState, Supervisor

HIGH, LOW, DWELL, DT = 0.05, 0.02, 0.1, 2e-3
SUPERVISOR = Supervisor(remove_above=HIGH, insert_below=LOW, horizon=0.02, dwell=DWELL)


@dataclass
class Foretold:
    """Answers fixed in advance, and a record of what was asked.

    Attributes:
        cost: one tick ahead.
        rises: whether the law with every gain at its target still raises it.
        conflicts: P_h of each task.
        returning: cost a horizon ahead with each task at work.
    """

    cost: float
    rises: bool = True
    conflicts: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    returning: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    asked: list[object] = field(default_factory=list)

    def cost_next(self) -> float:
        self.asked.append("cost")
        return self.cost

    def still_rises(self) -> bool:
        self.asked.append("rises")
        return self.rises

    def conflict(self, task: int) -> float:
        self.asked.append(("conflict", task))
        return self.conflicts[task]

    def cost_with(self, task: int) -> float:
        self.asked.append(("with", task))
        return self.returning[task]


ORDER = (0, 1, 2, 3)


def state(wanted: str = "1111", allowed: str = "1111", changed_at: float = -np.inf) -> StackState:
    """From strings of 0 and 1, one digit per task."""
    masks = (np.array([c == "1" for c in mask]) for mask in (wanted, allowed))
    return StackState(*masks, changed_at, 0)


def decide(before: StackState, forecast: Foretold, t: float = 1.0, order=ORDER):  # type: ignore[no-untyped-def]
    """The decision; the state before must not have been touched."""
    wanted, allowed = before.wanted.copy(), before.allowed.copy()
    after, event = SUPERVISOR.decide(before, t, order, forecast)
    np.testing.assert_array_equal(before.wanted, wanted)
    np.testing.assert_array_equal(before.allowed, allowed)
    if event is None:
        assert after is before
    else:
        assert (after.changed_at, after.events) == (t, before.events + 1)
        assert (after.allowed != allowed).nonzero()[0].tolist() == [event.task]
        assert after.allowed[event.task] == event.inserted
        np.testing.assert_array_equal(after.wanted, wanted)
    return after, event


@pytest.mark.parametrize("least", ORDER)
def test_removes_the_task_with_the_least_left_of_the_gradient(least):
    """The minimum of P_h of (41), whatever its priority."""
    conflicts = tuple(0.1 if h == least else 0.5 + h for h in ORDER)
    _, event = decide(state(), Foretold(HIGH, conflicts=conflicts))
    assert event == StackEvent(least, False, HIGH)


def test_ties_go_to_the_higher_priority_in_a_fixed_way():
    _, event = decide(state(), Foretold(1.0), order=(2, 0, 1, 3))
    assert event is not None and event.task == 2


def test_removes_at_the_threshold_and_not_below():
    assert decide(state(), Foretold(HIGH))[1] is not None
    assert decide(state(), Foretold(np.nextafter(HIGH, 0.0)))[1] is None


def test_waits_while_a_removal_has_yet_to_take_effect():
    """Not while the law with every gain at its target already lowers the cost."""
    forecast = Foretold(10.0, rises=False)
    assert decide(state(allowed="1011"), forecast)[1] is None
    assert forecast.asked == ["cost", "rises"]


def test_only_tasks_in_the_stack_are_removed():
    """Not one that is out, not one that nobody wants, however much it conflicts."""
    forecast = Foretold(1.0, conflicts=(0.0, 0.0, 0.7, 0.6))
    assert decide(state(wanted="1011", allowed="0111"), forecast)[1] == StackEvent(3, False, 1.0)
    assert [x for x in forecast.asked if isinstance(x, tuple)] == [("conflict", 2), ("conflict", 3)]


def test_tasks_without_rows_in_force_are_not_removed():
    infinite = (np.inf,) * 4
    assert decide(state(), Foretold(1.0, conflicts=infinite))[1] is None
    _, event = decide(state(), Foretold(1.0, conflicts=(np.inf, np.inf, 3.0, np.inf)))
    assert event is not None and event.task == 2


def test_nothing_left_to_remove():
    assert decide(state(allowed="0000"), Foretold(9.0))[1] is None
    assert decide(state(wanted="0000"), Foretold(9.0))[1] is None


def test_puts_back_the_highest_priority_that_may_return():
    before = state(allowed="0001")
    forecast = Foretold(0.0, returning=(0.03, 0.01, 0.0, 0.0))
    assert decide(before, forecast)[1] == StackEvent(1, True, 0.01)
    assert forecast.asked == ["cost", ("with", 0), ("with", 1)]  # and asks no further
    # priority is the order given, not the index
    assert decide(before, Foretold(0.0), order=(3, 2, 1, 0))[1] == StackEvent(2, True, 0.0)


def test_does_not_put_back_what_would_raise_the_cost_or_nobody_wants():
    forecast = Foretold(0.0, returning=(np.nextafter(LOW, 1.0),) * 4)
    assert decide(state(allowed="0010"), forecast)[1] is None
    forecast = Foretold(0.0)
    assert decide(state(wanted="1101", allowed="1101"), forecast)[1] is None
    assert forecast.asked == ["cost"]
    assert decide(state(allowed="0111"), Foretold(0.0, returning=(LOW,) * 4))[1] is not None


@pytest.mark.parametrize("cost", [np.nextafter(LOW, 1.0), 0.03, np.nextafter(HIGH, 0.0)])
def test_between_the_thresholds_nothing_happens(cost):
    forecast = Foretold(cost)
    assert decide(state(allowed="0111"), forecast)[1] is None
    assert forecast.asked == ["cost"]


def test_dwell():
    """Within it after an event no task returns; a removal never waits, nor does the first event."""
    forecast = Foretold(0.0)
    just = state(allowed="0111", changed_at=1.0)
    assert decide(just, forecast, t=1.0 + 0.99 * DWELL)[1] is None
    assert forecast.asked == ["cost"]
    assert decide(just, forecast, t=1.0 + 1.01 * DWELL)[1] is not None
    assert decide(just, Foretold(9.0), t=1.0 + DT)[1] is not None
    assert decide(state(), Foretold(9.0), t=0.0)[1] is not None


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_long_random_life(seed):
    """A task returns a dwell after any event; only wanted tasks come and go, the others stay."""
    rng = np.random.default_rng(seed)
    now = StackState(rng.random(4) < 0.7, rng.random(4) < 0.7, -np.inf, 0)
    times = []
    for k in range(200):
        if rng.random() < 0.05:
            now = now._replace(wanted=rng.random(4) < 0.7)
        forecast = Foretold(
            10.0 ** rng.uniform(-3, 0), bool(rng.random() < 0.5),
            tuple(rng.choice([np.inf, 1.0, 2.0], 4)), tuple(10.0 ** rng.uniform(-3, 0, 4)),
        )  # fmt: skip
        was = now
        now, event = decide(now, forecast, t=k * 0.02, order=tuple(rng.permutation(4)))
        if event is not None:
            if event.inserted and times:
                assert k * 0.02 - times[-1] > DWELL - 1e-12
            times.append(k * 0.02)
            assert was.wanted[event.task]
            assert event.cost <= LOW if event.inserted else event.cost >= HIGH
        np.testing.assert_array_equal(now.within, now.wanted & now.allowed)
    assert len(times) == now.events


class Conflict:
    """A made-up plant: one cost, pushed up by tasks with a force each, pulled down by its gradient.

    Gains fade as they do in the controller, so that a removal takes its time to take effect.
    """

    def __init__(self, push: tuple[float, ...], patient: bool) -> None:
        self.push, self.patient = np.array(push), patient
        self.height, self.gains = 0.0, start(len(push))
        self.now = StackState(np.ones(len(push), bool), np.ones(len(push), bool), -np.inf, 0)
        self.events: list[StackEvent] = []

    def speed(self, rho: np.ndarray) -> float:
        return float(self.push @ rho) - 2.0 * self.height

    def cost_next(self) -> float:
        return self.height + DT * self.speed(self.gains.rho)

    def still_rises(self) -> bool:
        return self.speed(self.now.within.astype(float)) > 0.0 if self.patient else True

    def conflict(self, task: int) -> float:
        return 1.0 / (1e-3 + max(float(self.push[task]), 0.0))

    def cost_with(self, task: int) -> float:
        rho = self.now.within.astype(float)
        rho[task] = 1.0
        return self.height + SUPERVISOR.horizon * self.speed(rho)

    def run(self, supervisor: Supervisor, ticks: int) -> None:
        for k in range(ticks):
            order = tuple(range(len(self.push)))
            self.now, event = supervisor.decide(self.now, k * DT, order, self)
            if event is not None:
                self.events.append(event)
            self.gains = advance(self.gains, self.now.within.astype(float), 20.0, DT)
            self.height = max(0.0, self.height + DT * self.speed(self.gains.rho))


def test_no_cascade():
    """One task conflicts and one is removed. As printed, all go before its gain has faded."""
    eager = Supervisor(HIGH, LOW, SUPERVISOR.horizon, dwell=0.0)
    patient = Conflict((0.0, 2.0, 0.0), patient=True)
    patient.run(eager, 150)
    assert [e.task for e in patient.events] == [1]
    printed = Conflict((0.0, 2.0, 0.0), patient=False)
    printed.run(eager, 150)
    assert len([e for e in printed.events if not e.inserted]) == 3


def test_two_that_conflict_both_go_one_after_the_other():
    plant = Conflict((1.5, 0.0, 2.0), patient=True)
    plant.run(SUPERVISOR, 200)
    assert [(e.task, e.inserted) for e in plant.events[:2]] == [(2, False), (0, False)]
    assert plant.now.allowed[1]


def test_a_lasting_conflict_does_not_chatter():
    """In and out no more often than hysteresis and dwell allow."""
    plant = Conflict((0.0, 2.0, 0.0), patient=True)
    plant.run(SUPERVISOR, 5000)
    assert len(plant.events) <= 5000 * DT / DWELL
    assert {e.task for e in plant.events} == {1}
    signs = [e.inserted for e in plant.events]
    assert all(a != b for a, b in pairwise(signs))


def test_every_task_returns_when_the_conflict_is_over():
    plant = Conflict((1.5, 0.3, 2.0), patient=True)
    plant.run(SUPERVISOR, 300)
    assert not plant.now.allowed.all()
    plant.push = np.zeros(3)
    plant.run(Supervisor(HIGH, LOW, SUPERVISOR.horizon, 0.0), 3000)
    assert plant.now.allowed.all()
