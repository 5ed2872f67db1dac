"""Lines 10, 17, 19 and 25 of the fault table: fingers that lose the object, or never touch it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tests.faults.injection import DT, NAME, Run, run
from wbc.contact.grasp import ContactMode
from wbc.control.force_control import TorqueStatus
from wbc.control.state import Measurement
from wbc.recording.dynamic_facts import normal_forces, object_error_true
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics


def worst(found: Run) -> float:
    """Largest error of the true object [mm]."""
    return 1e3 * float(object_error_true(found.log)[0].max())


def test_a_contact_lost_for_a_moment_is_bridged() -> None:
    found = run(600, lost={"f3": (1.0, 1.01)})
    assert not found.ticks(TorqueStatus.CONTACT_LOST | TorqueStatus.HELD).size


def test_a_lost_contact_holds_the_motion_until_it_is_back() -> None:
    found = run(1100, lost={"f3": (1.0, 1.25)})  # its tip goes 2 mm into the object meanwhile
    lost, held = found.ticks(TorqueStatus.CONTACT_LOST), found.ticks(TorqueStatus.HELD)
    print("lost", lost[[0, -1]], "held", held[[0, -1]], worst(found))
    assert lost[0] * DT == pytest.approx(1.03, abs=0.01)
    assert (held[0] - lost[0]) <= 101
    assert lost[-1] * DT < 1.85 and not found.log.torque_status[-1]
    assert worst(found) < 4.0  # the tip was in the object when it began to press again


def test_a_finger_that_lost_the_object_goes_to_look_for_it_a_little() -> None:
    found = run(1130, lost={"f3": (1.0, 99.0)})
    log, lost = found.log, found.ticks(TorqueStatus.CONTACT_LOST)
    inward = -log.contact_normals[lost[0], 2]
    way = (log.contact_points[:, 2] - log.contact_points[lost[0], 2]) @ inward
    for since, least, most in ((0.05, -1e-5, 1e-5), (0.4, 4.6e-3, 5.2e-3), (1.2, 8e-3, 8.01e-3)):
        at = lost[0] + round(since / DT)
        print(f"{since} s after it was lost {1e3 * way[at]:.2f} mm further in")
        assert least <= way[at] <= most
    assert np.array_equal(lost, np.arange(lost[0], log.ticks))
    assert worst(found) < 1.0


@cache
def _never_closing() -> Run:
    """One of the receiver's fingers does not touch from when it is to take the object."""
    return run(2300, lost={"f4": (3.5, 99.0)})


def test_a_receiver_that_does_not_close_gets_nothing() -> None:
    found = _never_closing()
    assert not found.phase("leave").size
    held = found.ticks(TorqueStatus.HELD)
    _, measured = normal_forces(found.log)
    print(measured[-1], worst(found))
    late = found.log.t > 4.2
    assert held[-1] == found.log.ticks - 1 and late.any()
    assert (measured[late][:, :3] > 2.0).all()  # the others hold, in balance
    print("held from", found.log.t[held[0]], worst(found))
    assert worst(found) < 5.0


def test_a_giver_waits_for_a_receiver_that_is_not_felt() -> None:
    """The last moment: too late for a contact to count as lost, early enough not to let go."""
    plain = _phase_start("leave")
    found = run(plain + 120, lost={"f4": (DT * plain - 0.01, DT * plain + 0.02)})
    waits = found.waits()
    print("waits", waits, "plain", plain)
    assert waits[0] == plain and len(waits) >= 8
    assert found.phase("leave")[0] == waits[-1] + 1


@pytest.mark.parametrize("all_of_them", [False, True])
def test_a_giver_does_not_let_go_when_the_forces_are_no_longer_measured(all_of_them: bool) -> None:
    plain = _phase_start("leave")

    def seen(k: int, m: Measurement) -> Measurement:
        if not plain - 3 <= k < plain + 6:
            return m
        if all_of_them:
            return m._replace(force=None)
        force = m.force.copy()
        force[3] = np.nan
        return m._replace(force=force)

    found = run(plain + 30, seen=seen)
    assert list(found.waits()) == list(range(plain, plain + 6))
    assert found.phase("leave")[0] == plain + 6


def test_a_second_loss_does_not_step_the_planned_forces() -> None:
    """f4 goes while it is being given the object, and f3, which pressed against it, soon after."""
    start = _phase_start("hand_over")
    found = run(start + 150, lost={"f4": (DT * start + 0.2, 99.0)})
    planned, _ = normal_forces(found.log)
    steps = np.abs(np.diff(found.log.contact_force_plan, axis=0)).max(axis=(1, 2))[start + 105 :]
    print(steps.max(), planned.min(), worst(found))
    assert steps.max() < 1.0  # from 13 N to nothing takes 50 ms
    assert planned.min() > -1e-9
    assert worst(found) < 10.0


def test_a_tick_in_which_a_finger_looks_for_the_object_depends_on_the_state_alone() -> None:
    assembly = build(load(NAME, {}))
    dynamics = build_dynamics(assembly)
    assert dynamics is not None
    control, start = dynamics.control(assembly.controller), assembly.controller.law.kin.start
    sensed = dynamics.plant.reset(assembly.start.q, np.zeros(14), start.position, start.rotation)
    loop, mode = control.init(assembly.start), np.full(4, -1)
    early = None
    for k in range(660):
        m = sensed.measurement
        if k > 550:  # f3 slides along the object
            force = m.force.copy()
            force[2] = 0.0
            m = m._replace(force=force)
        before, (tick, loop) = loop, control.step(loop, m)
        early = (before, m) if k == 5 else early
        if not np.array_equal(mode, tick.record.mode):
            mode = tick.record.mode
            dynamics.plant.treat(mode)
        sensed = dynamics.plant.step(tick.command.tau, DT)
    assert before.sought[2] > 0.0 and mode[2] == ContactMode.SLIDING and early is not None
    control.step(*early)
    again, other = control.step(before, m)
    np.testing.assert_array_equal(again.command.tau, tick.command.tau)
    np.testing.assert_array_equal(other.first.contact.shift, loop.first.contact.shift)


def _phase_start(name: str) -> int:
    return int(_never_closing_free().phase(name)[0])


@cache
def _never_closing_free() -> Run:
    return run(1900)


def test_noise_delay_coarse_sensors_and_a_wrong_mass() -> None:
    random, held = np.random.default_rng(3), list[np.ndarray]()

    def seen(k: int, m: Measurement) -> Measurement:
        held.append(m.force * (1.0 + 0.05 * random.standard_normal(m.force.shape)))
        coarse = 2.0 * np.pi / 2**16
        noise = 0.02 * random.standard_normal(m.v.shape)
        return Measurement(np.round(m.q / coarse) * coarse, m.v + noise, held[max(k - 2, 0)])

    settings = {"simulation.disturbances": "{mass: 0.5}"}
    found = run(900, seen=seen, settings=settings)
    print("noise", worst(found), np.unique(found.log.torque_status))
    assert not (found.log.torque_status & ~int(TorqueStatus.SATURATED)).any()
    assert worst(found) < 2.0


def test_joints_too_weak_slow_the_motion() -> None:
    weak = np.array([200.0] * 3 + [50.0] * 4 + [200.0] * 3 + [50.0] * 4)
    weak[7:10] = 3.0
    found = run(600, gains={"tau_min": -weak, "tau_max": weak})
    over = found.ticks(TorqueStatus.OVERLOADED)
    saturated = found.ticks(TorqueStatus.SATURATED)
    print("saturated", saturated[:3], "over", over[:3], worst(found))
    assert saturated.size
    if over.size:
        assert found.ticks(TorqueStatus.SLOWED).size
    assert worst(found) < 1.0
