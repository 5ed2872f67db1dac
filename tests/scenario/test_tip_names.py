"""A fingertip may have several names, one per contact point, and uses one of them at a time."""

from __future__ import annotations

from collections.abc import Callable

from wbc.scenario import load

from .hold import COMPLETE

HOLD = "contacts: {f1: fixed, f2: fixed}"
ONE_TIP = COMPLETE.replace("f2: tip_2", "f2: tip_1")
IN_TURN = ONE_TIP.replace(HOLD, "contacts: {f2: fixed}").replace(
    "    reach: {f2: {clearance: 1 cm}}\n", ""
)


def test_names_of_one_tip_in_different_phases(write: Callable[[str], object]) -> None:
    phases = load(write(IN_TURN)).scenario.phases
    assert [list(phase.contacts) for phase in phases] == [["f2"], ["f1"]]


def test_names_of_one_tip_in_one_phase(faults: Callable[..., list[str]]) -> None:
    said = "is the tip of 'f1', which is in this phase already"
    lines = [line.split(": ", 1)[1] for line in faults(ONE_TIP)]
    assert lines == [f"phases[0].contacts.f2: {said}", f"phases[1].reach.f2: {said}"]


def test_forces_that_balance_count_a_tip_once(faults: Callable[..., list[str]]) -> None:
    balance = IN_TURN.replace("tasks:\n", "tasks:\n  f: {type: equilibrium_force, gain: 1}\n", 1)
    (line,) = faults(balance)
    assert line.endswith("tasks.f: equilibrium_force would count the tip of 'f1' and 'f2' twice")
