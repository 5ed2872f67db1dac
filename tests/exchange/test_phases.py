"""The course of an exchange when it does not go as planned, and starts that cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc import resources
from wbc.control.state import Status
from wbc.errors import ScenarioError, SetupError, UrdfError

from .negative import summary
from .runs import REFERENCE, Run, assemble, check_laws, simulate
from .test_editing import REACH

EARLY: dict[str, Any] = {"phases.slide.until.time": "0.2 s"}


def late_slide(then: str) -> dict[str, Any]:
    """The slide given far too little time."""
    return {**EARLY, "phases.slide.timeout": {"after": "0.5 s", "then": then}}


def phase_names(run: Run) -> list[str]:
    """The phases in the order in which they were entered."""
    names = [phase.name for phase in run.assembly.controller.phases.phases]
    index = run.series("phase")
    return [names[index[0]], *(names[index[k + 1]] for k in np.flatnonzero(np.diff(index)))]


def timed_out_from(run: Run) -> float:
    """Time of the first tick whose status says that a phase timed out, [s]."""
    return float(run.t[np.flatnonzero(run.series("status").astype(int) & Status.PHASE_TIMEOUT)[0]])


def test_a_timeout_that_stops(reference: Run) -> None:
    """The sequence ends where it is; the robot goes on holding the object and minding its tasks."""
    run = simulate(overrides=late_slide("stop"), ticks=1900)
    check_laws(run)
    assert phase_names(run) == ["approach", "slide"]
    assert timed_out_from(run) == pytest.approx(1.3, abs=1e-6)
    assert run.state.phase.stopped and not run.state.phase.done
    assert run.object_error[-1] < 1e-9 and np.abs(run.v[-1]).max() < 0.05
    said = summary(run)
    assert not said["success"] and said["timeouts"] == ["slide"]
    assert "phase 'slide' timed out after 0.5 s" in said["reason"]


def test_a_timeout_that_goes_on(reference: Run) -> None:
    """Slid half-way, the fingers are told to hold: the object stays, and no success is claimed."""
    run = simulate(overrides=late_slide("next"))
    check_laws(run)
    assert phase_names(run)[:3] == ["approach", "slide", "hand_over"]
    assert timed_out_from(run) == pytest.approx(1.3, abs=1e-6)
    assert run.object_error.max() < 1e-4
    said = summary(run)
    assert not said["success"] and said["timeouts"] == ["slide"]


def test_a_timeout_that_holds_on(reference: Run) -> None:
    """It is noted, and the phase ends when it ends: the same exchange as without it."""
    run = simulate(overrides=late_slide("hold"))
    check_laws(run)
    assert run.state.phase.done and run.state.phase.timeouts == ("slide",)
    assert timed_out_from(run) == pytest.approx(1.3, abs=1e-6)
    np.testing.assert_array_equal(run.q, reference.q)
    assert not summary(run)["success"]


def test_a_finger_let_go_in_mid_slide() -> None:
    """Finger 3 leaves while it slides at speed: no jump beyond the limits, the object held."""
    release = {
        "name": "hand_over",
        "contacts": {"f1": "fixed", "f2": "fixed", "f4": "sliding"},
        "reach": {"f3": {"clearance": "0.1 m"}},
        "tasks": ["dexterity", "palm"],
        "over": "0.5 s",
        "until": {"time": "10 s"},
    }
    run = simulate(
        overrides={
            **late_slide("next"), "phases.hand_over": release, "simulation.duration": "2.2 s",
            # which this run does not come to
            "phases.leave.contacts": {"f4": "fixed"}, "phases.carry.contacts": {"f4": "fixed"},
        }
    )  # fmt: skip
    check_laws(run)
    assert Status.CLIPPED not in run.status
    sliding = np.abs(np.diff(run.series("contact_points")[640:650, 2], axis=0)).max() / 2e-3
    tip = run.assembly.controller.task_names.index("tip_f3")
    print(f"let go at {sliding:.2f} m/s; object error {run.object_error.max():.2g} m")
    assert sliding > 0.05
    assert run.object_error.max() < 1e-6
    assert run.records[-1].task_error[tip] < 1e-6


def test_contacts_out_of_reach() -> None:
    """The finger, how far it is short, and what stops it, before anything moves."""
    for place, finger in (([1.5, 0.3], "f1"), ([3.0, 3.0], "f1")):
        with pytest.raises(
            SetupError, match=rf"finger '{finger}' cannot reach .* mm short"
        ) as info:
            assemble(overrides={"contacts.f1.at": ["60 deg"], "object.pose.position": place})
        assert "\n" not in str(info.value) and "move the object" in str(info.value)


def test_a_start_outside_the_limits_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"left_trunk_1.* at 150 deg is outside its limits"):
        assemble(overrides={"robot.start.left_trunk_1": "150 deg"})


def test_a_joint_that_may_not_move_is_refused_with_its_line(tmp_path: Path) -> None:
    text = resources.find("urdf", "planar_bimanual").read_text()
    at = text.index('velocity="6"', text.index('<joint name="left_trunk_2"'))
    (tmp_path / "robot.urdf").write_text(text[:at] + 'velocity="0"' + text[at + 12 :])
    scenario = resources.find("tasks", REFERENCE).read_text()
    (tmp_path / "exchange.yaml").write_text(scenario.replace("planar_bimanual ", "robot.urdf "))
    line = text[:at].count("\n") + 1
    with pytest.raises(UrdfError, match=rf"robot.urdf:{line}: .*left_trunk_2"):
        assemble(tmp_path / "exchange.yaml")


@pytest.mark.parametrize("apart", [0.0, 1e-9, 0.02])
def test_a_start_with_links_in_one_another(tmp_path: Path, apart: float) -> None:
    """Two fingers of a hand upon each other: parted where a direction is known, else left alone."""
    text = REACH.replace("left_b_1: -50 deg", f"left_b_1: {50.0 - np.rad2deg(apart)} deg")
    text = text.replace("left_b_2: 70 deg", "left_b_2: -70 deg")
    cost = "costs: {apart: {type: collision, safety_distance: 5 cm, weight: 0.01}}\nstack:"
    (tmp_path / "reach.yaml").write_text(text.replace("stack:", cost))
    run = simulate(tmp_path / "reach.yaml", {"stack.priority": ["right"]}, ticks=500)
    check_laws(run)
    print(f"{apart} rad: {run.records[0].min_distance:.3g} to {run.records[-1].min_distance:.3g} m")
    assert run.records[0].min_distance < -0.02
    if apart > 1e-6:
        assert run.records[-1].min_distance > 0.02
