"""What a disturbance does to a run, and that the controller is told nothing of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.conformance.robots import robot
from wbc.contact.surfaces import SURFACES, Surface
from wbc.control.force_control import ForceControl, Goal, TorqueState
from wbc.control.state import Measurement
from wbc.robot.dynamics import InverseDynamics
from wbc.rotations import log_so3
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic
from wbc.sim.compliant import CompliantPlant
from wbc.sim.disturbances import Disturbance, Lost, Push
from wbc.sim.trial import Trial, scaled

HAND = robot("hand")
ARMS = np.arange(HAND.nv) < 5


def _trial(**given: Any) -> Trial:
    return Trial(Disturbance(**given), HAND, ("a", "b"), ARMS, 2e-3)


def test_the_object_is_where_the_offset_puts_it() -> None:
    turn = (0.0, 0.02, -0.01)
    believed = np.array([1.0, 0.0, 0.0]), np.diag([1.0, -1.0, -1.0])
    position, rotation = _trial(position=(0.003, 0.0, -0.004), rotation=turn).placed(*believed)
    assert position == pytest.approx([1.003, 0.0, -0.004])
    assert log_so3(rotation @ believed[1].T) == pytest.approx(turn)
    assert np.array_equal(_trial().placed(*believed)[0], believed[0])


def test_events_last_as_long_as_they_are_said_to() -> None:
    trial = _trial(
        pushes=(Push(0.1, (1.0, 0.0, 0.0), 0.2), Push(0.2, (0.0, 2.0, 0.0), 0.3)),
        lost=(Lost("b", 0.1, 0.1),),
    )
    assert trial.eventful and not _trial(mass=1.2).eventful
    for t, force, lost in (
        (0.0, [0, 0, 0], [False, False]),
        (0.1, [1, 0, 0], [False, True]),
        (0.25, [1, 2, 0], [False, False]),
        (0.4, [0, 2, 0], [False, False]),
        (0.6, [0, 0, 0], [False, False]),
    ):
        push, gone = trial.happening(t)
        assert push.tolist() == force and gone.tolist() == lost


def test_arms_are_commanded_with_a_wrong_weight() -> None:
    q, tau = 0.3 * np.ones(HAND.nv), np.arange(float(HAND.nv))
    none = np.zeros(HAND.nv)
    weight = np.where(ARMS, InverseDynamics(HAND).torques(q, none, none), 0.0)
    assert np.abs(weight).max() > 1.0
    assert _trial(gravity=1.05).misjudged(tau, q) == pytest.approx(tau + 0.05 * weight)
    assert np.array_equal(_trial().misjudged(tau, q), tau)


@pytest.mark.parametrize(
    "surface",
    [
        SURFACES["box"]((0.1, 0.2, 0.3)),
        SURFACES["cylinder"](0.03, 0.2),
        SURFACES["superellipsoid"](0.03, 0.04, 0.05, 4.0),
        SURFACES["fourier_contour"](0.5, 0.36, 0.06),
        SURFACES["fourier_contour"](0.5, 0.15, 0.0, ((2.0, 0.0, 0.0, 0.25, 0.0),)),
        SURFACES["superellipse"](0.5, 0.4, 3.0),
    ],
)
def test_a_scaled_surface_is_the_same_but_larger(surface: Surface) -> None:
    """F is a length where it is one: zero on what is 1.1 times as far out."""
    larger = scaled(surface, 1.1)
    v = 0.0 if surface.planar else 0.02
    for point in surface.charts(np.array([[0.01, v], [0.02, -v]]), 0)[:, 0]:
        assert larger.level(1.1 * point) == pytest.approx(0.0, abs=1e-12)
    assert scaled(surface, 1.0) is surface


def test_mass_friction_and_size_reach_the_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    made: dict[str, Any] = {}
    init = CompliantPlant.__init__

    def watched(self: CompliantPlant, *args: Any, **more: Any) -> None:
        made.update(zip(("model", "tips", "surface", "body", "pads", "physics"), args, strict=True))
        init(self, *args, **more)

    monkeypatch.setattr(CompliantPlant, "__init__", watched)
    wrong = "{mass: 0.3, friction: 0.3, size: 0.02}"
    settings = {"simulation.disturbances": wrong, "simulation.seed": "5"}
    assembly = build(load("planar_exchange_dynamic", settings))
    assert build_dynamics(assembly) is not None
    mass, mu = made["body"].mass, made["physics"].friction[0] / 0.8
    assert 0.7 < mass < 1.3 and mass != 1.0 and made["body"].inertia[2] == pytest.approx(0.1 * mass)
    assert 0.7 < mu < 1.3 and mu != mass
    believed = assembly.controller.law.kin.grasp.surface
    assert made["surface"].a != believed.a == 0.5
    assert abs(made["surface"].a - 0.5) < 0.01


def test_the_controller_sees_the_sensors_and_the_log_the_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[Measurement] = []
    step = ForceControl.step

    def watched(
        self: ForceControl, state: TorqueState, goal: Goal, measured: Measurement, dt: float
    ) -> Any:
        seen.append(measured)
        return step(self, state, goal, measured, dt)

    monkeypatch.setattr(ForceControl, "step", watched)
    settings = {"simulation.disturbances": "{joint_noise: 1e-4 rad, position: 1 mm}"}

    def run() -> list[Any]:
        assembly = build(load("planar_exchange_dynamic", settings))
        dynamics = build_dynamics(assembly)
        assert dynamics is not None
        ticks = dynamic.run(assembly.controller, assembly.start, 20, dynamics)
        return [record.dynamics for record, _ in ticks]

    true = run()
    off = np.array([s.q - t.q for s, t in zip(seen, true, strict=True)])
    assert off.std() == pytest.approx(1e-4, rel=0.2)
    assert 0.0 < np.linalg.norm(true[0].object_position[:2]) < 1e-3
    first = [tuple(t) for t in true]
    again = [tuple(t) for t in run()]
    assert all(np.array_equal(a, b) for x, y in zip(first, again, strict=True)
               for a, b in zip(x, y, strict=True))  # fmt: skip
