"""The planar exchange by torques: the published case on soft fingertips, and where it is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.exchange.dynamics import World, exchanged, figures, outcome
from wbc.arrays import Array, IntArray
from wbc.cli.session import run_meta
from wbc.control.force_control import TorqueStatus
from wbc.recording import Log, Recorder
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic, kinematic
from wbc.sim.plant import Plant, Sensed


@pytest.fixture(scope="module")
def log() -> Log:
    return exchanged()


def test_the_object_stays_where_it_should_be(log: Log) -> None:
    for phases in (("touch", "slide"), ("hand_over", "leave"), ("carry",)):
        found = figures(log, *phases)
        assert found.position <= 0.08 and found.angle <= 0.1  # [mm], [mrad]; asked for: 0.5, 1
    assert outcome(log)["dropped"] is False


def test_contact_forces_are_those_planned(log: Log) -> None:
    found = figures(log, "approach", "touch", "slide", "hand_over")
    assert (found.force <= 0.08).all()  # [N]; asked for: 0.1 of fingers 1, 2 and 0.3 of 3, 4
    assert not found.off.any()


def test_nothing_slips_and_the_joints_have_torque_to_spare(log: Log) -> None:
    facts = outcome(log)
    assert facts["success"], facts["reason"]
    assert facts["slip_max_m"] < 1e-6  # what f1, f2 do as they let go
    assert facts["contact_lost_s"] == 0.0
    assert facts["tau_max_ratio"] < 0.5
    assert not any(facts["torque_status"].values())


def test_the_first_stage_is_the_ideal_robots(log: Log) -> None:
    ideal = build(load("planar_exchange_dynamic", {"simulation.engine": "kinematic"}))
    assert build_dynamics(ideal) is None
    for k, (record, _) in enumerate(kinematic.run(ideal.controller, ideal.start, 300)):
        assert np.array_equal(record.q, log.q[k])
        assert record.dynamics is None


WRONG = {
    "contour 1 mm larger": World(surface=lambda s: replace(s, a=s.a + 1e-3, b=s.b + 1e-3)),
    "contour 1 mm smaller": World(surface=lambda s: replace(s, a=s.a - 1e-3, b=s.b - 1e-3)),
    "pads 30 % stiffer": World(pads=lambda p: p._replace(stiffness=1.3 * p.stiffness)),
    "pads 30 % softer": World(pads=lambda p: p._replace(stiffness=0.7 * p.stiffness)),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", WRONG)
def test_a_contour_or_pads_that_are_not_as_believed(what: str) -> None:
    log = exchanged({"simulation.duration": "4.4 s"}, WRONG[what])
    found = figures(log)
    assert found.position <= (0.6 if "contour" in what else 0.12)  # [mm]; asked for: 1
    assert found.angle <= 0.3
    assert outcome(log)["dropped"] is False
    assert not figures(log, "slide", "hand_over").off.any()


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"force_control.force": 0.5},  # 2.5 times the scenario's
        {"force_control.force": 0.3, "force_control.smoothing": 0},
        {"force_control.integral": "60 /s"},  # 3 times
        {"force_control.position": "4000 N/m"},  # twice
        {"force_control.damping": "10 Nm s/rad"},  # twice
        {"force_control.arms.damping": "120 Nm s/rad"},  # twice
        {"simulation.step": "3 ms"},  # a tick half as long again
        {"simulation.physics.step": "0.5 ms"},
        {"simulation.physics.step": "2 ms"},
        {"simulation.physics.sliding_friction": 0.1},
        {"force_control.position_in": "palm"},
        {
            "simulation.physics.control": "continuous",
            "force_control.force": 1.0,
            "force_control.smoothing": 0,
        },
    ],
    ids=lambda settings: " ".join(f"{key.split('.')[-1]}={x}" for key, x in settings.items()),
)
def test_held_torques_are_stable_with_a_margin(settings: dict[str, object]) -> None:
    log = exchanged({"simulation.duration": "4 s"} | settings)
    found = figures(log, "approach", "touch", "slide", "hand_over")
    assert found.position <= 0.2 and found.angle <= 0.2
    assert (found.force <= [0.12, 0.12, 0.3, 0.3]).all()  # 0.1 but for the friction that drags
    assert not found.off.any()


@pytest.mark.slow
def test_the_bar_is_passed_on_the_compliant_engine_as_in_mujoco() -> None:
    """Two engines that share neither contact nor integrator, one scenario."""
    assembly = build(load("dual_arm_exchange_mujoco", {"simulation.engine": "compliant"}))
    dynamics = build_dynamics(assembly)
    assert dynamics is not None
    recorder = Recorder(run_meta(assembly, dynamics), assembly.ticks)
    for record, _ in dynamic.run(assembly.controller, assembly.start, assembly.ticks, dynamics):
        recorder.append(record)
    facts = outcome(recorder.finish())
    assert facts["dropped"] is False
    assert facts["object_error_max_m"] < 5e-4 and facts["object_error_max_rad"] < 5e-3
    assert facts["slip_max_m"] < 2e-4 and facts["contact_lost_s"] <= 0.03


@pytest.mark.slow
@pytest.mark.parametrize(("step", "slack"), [("1 ms", 1.4), ("0.5 ms", 0.8), ("0.25 ms", 0.7)])
def test_mujoco_comes_to_what_the_compliant_engine_does(step: str, slack: float) -> None:
    """Twice what is asked of that one, and with the step more and more what it gives; at 1 ms all
    but the forces as tips 3, 4 come down, on an object that has slipped by 0.1 mm."""
    pytest.importorskip("mujoco")
    log = exchanged({"simulation.engine": "mujoco", "simulation.physics.step": step})
    found = figures(log, "approach", "touch", "slide", "hand_over")
    assert found.position <= slack * 0.2 and found.angle <= slack * 0.1
    assert (found.force <= slack * np.array([0.2, 0.2, 0.6, 0.6])).all()
    facts = outcome(log)
    assert facts["success"] and not facts["dropped"]
    assert facts["slip_max_m"] < slack * 2e-4 and facts["contact_lost_s"] <= 0.012


def test_a_push_disturbs_and_a_fixture_holds_on_the_compliant_engine() -> None:
    push = "{pushes: [{at: 0.1 s, force: [5 N, 0 N, 0 N], over: 0.1 s}]}"
    ways = []
    for settings in (
        {},
        {"simulation.disturbances": push},
        {"simulation.disturbances": push, "simulation.physics.fixture": "touch"},
    ):
        log = exchanged({"simulation.duration": "0.3 s"} | settings)
        ways.append(float(np.abs(log.object_pose_true[:, 0]).max()))
    assert ways[0] < 1e-4 < ways[1] < 5e-3
    assert ways[2] == 0.0


class Blind(Plant):
    """A plant whose sensors fail for some ticks."""

    def __init__(self, plant: Plant, bad: dict[int, str]) -> None:
        self._plant, self._bad, self._tick = plant, bad, 0

    def reset(self, q: Array, v: Array, position: Array, rotation: Array) -> Sensed:
        return self._plant.reset(q, v, position, rotation)

    def treat(self, mode: IntArray) -> None:
        self._plant.treat(mode)

    def step(self, tau: Array, dt: float) -> Sensed:
        assert np.isfinite(tau).all()
        self._tick += 1
        sensed = self._plant.step(tau, dt)
        if (name := self._bad.get(self._tick)) is None:
            return sensed
        broken = getattr(sensed, name).copy()
        broken.flat[0] = np.nan
        return sensed._replace(**{name: broken})


def test_sensors_that_fail_for_a_moment_cost_little_and_give_no_nan() -> None:
    assembly = build(load("planar_exchange_dynamic"))
    given = build_dynamics(assembly)
    assert given is not None
    bad = {100: "q", 101: "q", 150: "v", 200: "force", 201: "force", 202: "force"}
    dynamics = replace(given, plant=Blind(given.plant, bad))
    status, way = [], 0.0
    for record, _ in dynamic.run(assembly.controller, assembly.start, 300, dynamics):
        status.append(record.dynamics.status)
        assert np.isfinite(record.dynamics.tau).all()
        way = max(way, float(np.linalg.norm(record.dynamics.object_position)))
    assert {k: bits for k, bits in enumerate(status) if bits} == dict.fromkeys(
        bad, TorqueStatus.BAD_MEASUREMENT
    )
    assert way < 2e-3


def test_a_run_is_the_same_every_time() -> None:
    a, b = (exchanged({"simulation.duration": "0.3 s"}) for _ in range(2))
    for name in ("tau", "q_meas", "object_pose_true", "contact_force_meas"):
        assert np.array_equal(getattr(a, name), getattr(b, name))
