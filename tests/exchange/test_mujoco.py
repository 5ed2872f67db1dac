"""The exchange under torques in MuJoCo's physics."""

from __future__ import annotations

import sys
from functools import cache
from typing import Any

import numpy as np
import pytest

from wbc.cli import main
from wbc.control.force_control import TorqueStatus
from wbc.control.state import DynamicsRecord, TickRecord
from wbc.errors import ScenarioError
from wbc.recording import installed_versions
from wbc.rotations import log_so3
from wbc.scenario import load
from wbc.scenario.build import Assembly, build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic
from wbc.sim.mujoco_plant import MujocoPlant

NAME = "dual_arm_exchange_mujoco"
BALL = "ball_exchange_mujoco"
PHYSICS = "simulation.physics"


def _assembly(**settings: str) -> Assembly:
    return build(load(NAME, {key.replace("__", "."): text for key, text in settings.items()}))


def _plant(assembly: Assembly) -> tuple[dynamic.Dynamics, MujocoPlant]:
    pytest.importorskip("mujoco")
    dynamics = build_dynamics(assembly)
    assert dynamics is not None and isinstance(dynamics.plant, MujocoPlant)
    return dynamics, dynamics.plant


def test_the_scenario_reaches_the_physics() -> None:
    assembly = _assembly(
        object__mass="0.15 kg", simulation__physics__friction="0.6",
        simulation__physics__armature="{'*_thumb_*': 3e-4 kg m^2}",
    )  # fmt: skip
    dynamics, plant = _plant(assembly)
    model, names = plant.model, assembly.model.joint_names
    assert model.body("object").mass[0] == 0.15
    assert model.geom("pad right_thumb_tip").friction[0] == 0.6
    assert model.geom("pad right_thumb_tip").size[0] == 5e-3
    for joint, torque, armature in (
        ("right_thumb_med", 0.5, 3e-4),
        ("left_little_abd", 0.3, 1e-4),
        ("left_arm_1", 176.0, 0.4),
    ):
        assert model.actuator(joint).ctrlrange[1] == pytest.approx(torque)
        assert model.joint(joint).armature[0] == pytest.approx(armature)
        assert dynamics.second.gains.tau_max[names.index(joint)] == pytest.approx(torque)


def test_the_fixture_lets_go_when_its_phase_begins() -> None:
    assembly = _assembly(simulation__physics__fixture="enter")
    dynamics, plant = _plant(assembly)
    held = []
    for record, _ in dynamic.run(assembly.controller, assembly.start, 410, dynamics):
        held.append((record.phase, plant.held))
    assert {phase for phase, on in held if on} == {0}
    assert {phase for phase, on in held if not on} == {1}


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({f"{PHYSICS}.fixture": "lfit"}, "did you mean 'lift'"),
        ({f"{PHYSICS}.table": "{size: [1 m, 1 m]}"}, "needs a 'height', 'posts' or both"),
        ({f"{PHYSICS}.control": "continuous"}, "continuous is of the compliant engine"),
        ({f"{PHYSICS}.table": "{posts: [[1 m, 0 m]]}"}, "nothing of the object is above"),
        ({f"{PHYSICS}.table.posts": "[[0 m, 5 cm], [0 m, 10 cm], [1 mm, 15 cm]]"}, "towards -y"),
        ({f"{PHYSICS}.table.height": "60 cm"}, "above the object's underside: at most 0.474"),
    ],
)
def test_what_does_not_fit_is_said_with_its_place(settings: dict[str, str], said: str) -> None:
    with pytest.raises(ScenarioError, match=said) as refusal:
        build(load(NAME, settings))
    assert "\n" not in str(refusal.value)


def test_without_mujoco_the_run_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert main(["run", NAME, "--out", str(tmp_path)]) != 0
    errors = capsys.readouterr().err
    assert "pip install -e '.[mujoco]'" in errors and "Traceback" not in errors


def test_a_check_without_mujoco_warns_in_the_words_of_the_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    main(["check", NAME])
    (line,) = (x for x in capsys.readouterr().out.splitlines() if "needs the package" in x)
    assert line.startswith("warning: ") and "pip install -e '.[mujoco]'" in line


def test_the_summary_names_its_version() -> None:
    pytest.importorskip("mujoco")
    assert "mujoco" in installed_versions()


def test_a_table_is_of_space() -> None:
    with pytest.raises(ScenarioError, match="an object in the plane lies on nothing"):
        load("planar_exchange_dynamic", {f"{PHYSICS}.table": "{height: 0.1 m}"})


def test_the_compliant_engine_holds_what_lies_on_a_table_until_it_is_moved() -> None:
    assembly = _assembly(simulation__engine="compliant")
    dynamics = build_dynamics(assembly)
    names = [phase.name for phase in assembly.controller.phases.phases]
    assert dynamics is not None and dynamics.release == names.index("lift")
    assert _plant(_assembly())[0].release is None


@cache
def _whole(name: str) -> tuple[Assembly, list[tuple[TickRecord, DynamicsRecord]], bool]:
    """A run to its end, and whether its last phase was done."""
    assembly = build(load(name))
    dynamics, _ = _plant(assembly)
    found, done = [], False
    ticks = dynamic.run(assembly.controller, assembly.start, assembly.ticks, dynamics)
    for record, state in ticks:
        assert record.dynamics is not None
        found.append((record, record.dynamics))
        done = state.phase.done
    return assembly, found, done


def _error(record: TickRecord, true: DynamicsRecord) -> tuple[float, float]:
    """How far the true object is from its reference, [m], [rad]."""
    way = np.linalg.norm(true.object_position - record.reference_position)
    turn = log_so3(true.object_rotation @ record.reference_rotation.T)
    return float(way), float(np.linalg.norm(turn))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most"), [(NAME, 8.7e-3), (BALL, 0.02)])
def test_the_object_goes_from_hand_to_hand(name: str, most: float) -> None:
    """Within 0.5 mm all the way, and turned by little."""
    assembly, run, done = _whole(name)
    assert done
    phases = [phase.name for phase in assembly.controller.phases.phases]
    way, turn = np.array([_error(*tick) for tick in run]).T
    number = np.array([record.phase for record, _ in run])
    taken = number == phases.index("hand_over")
    print(f"{name}: {1e3 * way.max():.2f} mm, {1e3 * turn.max():.1f} mrad; at the hand-over "
          f"{1e3 * way[taken].max():.2f} mm, {1e3 * turn[taken].max():.1f} mrad")  # fmt: skip
    assert way.max() < 5e-4 and turn.max() < most
    assert way[taken].max() < 3e-4
    assert run[-1][1].slip.max() < 5e-4
    lifted = [true for record, true in run if record.phase >= phases.index("lift")]
    assert not any(true.status & TorqueStatus.SATURATED for true in lifted)
    # who holds is who was to
    force = np.linalg.norm([true.force for _, true in run], axis=2)
    right = np.array([f.startswith("r_") for f in assembly.controller.law.kin.grasp.fingers])
    for phase, holds in (("lift", right), ("approach", right), ("retreat", ~right),
                         ("carry", ~right)):  # fmt: skip
        now = force[number == phases.index(phase)]
        assert (now[:, holds] > 0.05).mean() > 0.99
        assert not now[:, ~holds].any()


@pytest.mark.slow
def test_fingertips_slide_under_torques_until_they_balance() -> None:
    """The published slide, in space: the object stays, the tips come to where they balance."""
    assembly, run, done = _whole("ball_slide_mujoco")
    assert done
    phases = [phase.name for phase in assembly.controller.phases.phases]
    number = np.array([record.phase for record, _ in run])
    sliding = np.flatnonzero(number == phases.index("slide"))
    first, last = run[sliding[0]][0], run[sliding[-1]][0]
    way, turn = np.array([_error(*run[k]) for k in sliding]).T
    slid = np.linalg.norm(last.contact_points - first.contact_points, axis=1)[3:]
    print(f"slide: {1e3 * way.max():.2f} mm, {1e3 * turn.max():.1f} mrad; tips slid "
          f"{1e3 * slid.min():.1f} to {1e3 * slid.max():.1f} mm")  # fmt: skip
    assert way.max() < 5e-4 and turn.max() < 0.012
    assert slid.min() > 1e-3
    assert max(last.residuals) < 1e-6 < max(first.residuals)
    force = np.linalg.norm([run[k][1].force for k in sliding], axis=2)
    assert (force[50:, 3:] > 0.02).mean() > 0.99  # they touch while they slide, once they do


@pytest.mark.slow
@pytest.mark.parametrize(("name", "mass"), [(NAME, 0.2), (BALL, 0.1)])
def test_measured_forces_bear_the_object_while_it_rests(name: str, mass: float) -> None:
    """Newton: at the end of what the left hand carries, the forces sum up to its weight."""
    _, run, _ = _whole(name)
    last = np.mean([true.force.sum(axis=0) for _, true in run[-100:]], axis=0)
    assert last == pytest.approx([0.0, 0.0, mass * 9.81], abs=0.02)
