"""Contact, fixture and repeatability of the MuJoCo plant."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.sim.mujoco_worlds import BOX, FAR, PAD, model, stools, table_below
from wbc.contact.grasp import ContactMode
from wbc.contact.surfaces import SURFACES
from wbc.errors import WbcError
from wbc.sim.mujoco_plant import MujocoPlant
from wbc.sim.mujoco_shapes import mujoco as package
from wbc.sim.plant import Sensed

pytest.importorskip("mujoco")

TIPS = ["tip_0", "tip_1", "tip_2"]
GRAVITY = 9.81
MASSES = np.array([0.1, 0.2, 0.3])
TICK = 2e-3
ON_TOP = np.array([0.0, 0.0, 0.2 + PAD + 0.02])
"""Where a box rests on the three posts."""


def _held(plant: MujocoPlant, seen: Sensed, ticks: int, push: Any = 0.0) -> Sensed:
    """Posts kept at their heights by springs."""
    for _ in range(ticks):
        seen = plant.step(GRAVITY * MASSES - 3e3 * seen.q - 20.0 * seen.v + push, TICK)
    return seen


@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_forces_on_an_object_at_rest_are_its_weight(kind: str, tmp_path: Path) -> None:
    """They point up, on the object, and the posts that are nearer to its centre bear more."""
    surface = BOX if kind == "box" else SURFACES["superellipsoid"](0.05, 0.05, 0.02, 60.0)
    made = model(stools(tmp_path), TIPS, surface, 0.3, com=(0.004, 0.002, 0.0))
    plant = MujocoPlant(made)
    seen = plant.reset(np.zeros(3), np.zeros(3), ON_TOP + np.array([0.0, 0.0, 1e-4]), np.eye(3))
    seen = _held(plant, seen, 500)
    assert seen.force.sum(axis=0) == pytest.approx([0.0, 0.0, 0.3 * GRAVITY], abs=1e-3)
    assert np.all(seen.force[:, 2] > 0.0)
    corners = np.array([(0.03, 0.0), (-0.02, 0.03), (-0.02, -0.03)])
    share = np.linalg.solve(np.vstack([np.ones(3), corners.T]), [1.0, 0.004, 0.002])
    assert seen.force[:, 2] == pytest.approx(0.3 * GRAVITY * share, rel=0.02)


def test_an_object_on_the_table_needs_no_fingers(tmp_path: Path) -> None:
    lying = np.array([0.3, 0.0, 0.521])
    plant = MujocoPlant(model(stools(tmp_path), TIPS, table=table_below(lying, 0.5)))
    seen = plant.reset(np.zeros(3), np.zeros(3), lying, np.eye(3))
    seen = _held(plant, seen, 250)
    assert seen.object_position == pytest.approx([0.3, 0.0, 0.52], abs=2e-4)
    assert not seen.force.any()


def test_fixture_holds_until_released(tmp_path: Path) -> None:
    """Also against a push, which it gives way to by less than a micrometre."""
    plant = MujocoPlant(model(stools(tmp_path), TIPS), fixture=True)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    seen = plant.reset(np.zeros(3), np.zeros(3), ON_TOP, turned)
    seen = _held(plant, seen, 250, push=2.0)
    assert plant.held
    assert np.abs(seen.object_position - ON_TOP).max() < 1e-6
    assert np.abs(seen.object_rotation - turned).max() < 1e-5
    assert seen.force[:, 2] == pytest.approx(2.0 - 3e3 * seen.q, abs=1e-3)
    plant.release()
    assert not plant.held
    assert _held(plant, seen, 100, push=2.0).object_position[2] > ON_TOP[2] + 1e-4
    plant.reset(np.zeros(3), np.zeros(3), ON_TOP, turned)
    assert plant.held


def test_a_free_object_falls(tmp_path: Path) -> None:
    plant = MujocoPlant(model(stools(tmp_path), TIPS, com=(0.02, 0.0, 0.0)))
    seen = plant.reset(np.zeros(3), np.zeros(3), FAR, np.eye(3))
    for _ in range(50):
        seen = plant.step(GRAVITY * MASSES, TICK)
    fallen = FAR - [0.0, 0.0, 0.5 * GRAVITY * 0.1**2]
    assert seen.object_position == pytest.approx(fallen, abs=1e-3)
    assert np.abs(seen.object_rotation - np.eye(3)).max() < 1e-9


def test_slip_counts_while_a_contact_is_to_hold(tmp_path: Path) -> None:
    """A box of little friction on posts at a slant slides down; the way it goes is the slip, but
    for the moments in which it jumps."""
    low = np.full(3, 0.1)
    made = model(stools(tmp_path), TIPS, friction=low, sliding_friction=low)
    tilt = np.deg2rad(15.0)
    for mode in (ContactMode.FIXED, ContactMode.SLIDING):
        plant = MujocoPlant(made)
        seen = plant.reset(np.zeros(3), np.zeros(3), ON_TOP, np.eye(3))
        plant.treat(np.full(3, mode))
        seen = _held(plant, seen, 250)
        assert seen.slip.max() < 1e-5
        start = seen.object_position[0]
        plant.model.opt.gravity[:] = GRAVITY * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
        seen = _held(plant, seen, 50)
        way = seen.object_position[0] - start
        expected = 0.5 * GRAVITY * (np.sin(tilt) - 0.1 * np.cos(tilt)) * 0.1**2
        assert way == pytest.approx(expected, rel=0.1)
        if mode == ContactMode.FIXED:
            assert 0.7 * way < seen.slip.max() < 1.01 * way
            assert seen.slip.min() > 0.3 * way
        else:
            assert not seen.slip.any()


def test_tips_that_slide_on_purpose_may_have_another_friction(tmp_path: Path) -> None:
    made = model(stools(tmp_path), TIPS)
    plant = MujocoPlant(made)
    plant.treat(np.array([ContactMode.FIXED, ContactMode.SLIDING, ContactMode.FREE]))
    assert plant.model.geom_friction[made.pad_geom, 0] == pytest.approx([0.8, 0.05, 0.8])
    plant.treat(np.full(3, ContactMode.FIXED))
    assert plant.model.geom_friction[made.pad_geom, 0] == pytest.approx([0.8, 0.8, 0.8])
    assert made.model.geom_friction[made.pad_geom, 0] == pytest.approx([0.8, 0.8, 0.8])


def test_pushes_move_the_object_and_lost_contacts_bear_nothing(tmp_path: Path) -> None:
    none = np.zeros(3, dtype=np.bool_)
    plant = MujocoPlant(model(stools(tmp_path), TIPS, com=(0.02, 0.0, 0.0), inertia=[1e-3] * 3))
    plant.reset(np.zeros(3), np.zeros(3), FAR, np.eye(3))
    plant.disturb(np.array([0.0, 3.0, 0.3 * GRAVITY]), none)
    for _ in range(5):
        seen = plant.step(GRAVITY * MASSES, TICK)
    spin = plant.data.qvel[-3:]  # about the centre of mass, 2 cm ahead of where it is pushed
    assert spin == pytest.approx([0.0, 0.3 * GRAVITY * 0.02 / 1e-3 * 0.01, -0.6], rel=0.01)
    plant.reset(np.zeros(3), np.zeros(3), ON_TOP, np.eye(3))
    seen = _held(plant, seen, 1)
    plant.disturb(np.zeros(3), np.array([True, False, False]))
    seen = _held(plant, seen, 20)
    assert seen.object_rotation[2, 0] < -1e-3  # it tips over
    assert not seen.force[0].any()
    plant.reset(np.zeros(3), np.zeros(3), ON_TOP, np.eye(3))
    assert _held(plant, seen, 100).force[:, 2].min() > 0.25


def test_two_runs_are_the_same_to_the_bit(tmp_path: Path) -> None:
    """One plant reset, and another one of the same model."""
    made = model(stools(tmp_path), TIPS)
    one, other = MujocoPlant(made), MujocoPlant(made)
    runs = []
    for plant in (one, one, other):
        seen = plant.reset(
            np.zeros(3), np.zeros(3), ON_TOP + np.array([0.001, 0.0, 0.002]), np.eye(3)
        )
        runs.append(np.concatenate([np.ravel(x) for x in _held(plant, seen, 200)]).tobytes())
    assert runs[0] == runs[1] == runs[2]


def test_ticks_that_are_no_multiple_of_the_physics_step(tmp_path: Path) -> None:
    """Time passes as asked for, in steps no longer than the model's."""
    plant = MujocoPlant(model(stools(tmp_path), TIPS))
    plant.reset(np.zeros(3), np.zeros(3), FAR, np.eye(3))
    for dt in (2e-3, 2.5e-3, 4e-4, 1e-3):
        before = plant.data.time
        plant.step(GRAVITY * MASSES, dt)
        assert plant.data.time - before == pytest.approx(dt, rel=1e-12)


def test_numbers_that_are_none_do_not_raise(tmp_path: Path) -> None:
    plant = MujocoPlant(model(stools(tmp_path), TIPS))
    plant.reset(np.zeros(3), np.zeros(3), FAR, np.eye(3))
    assert not np.isfinite(plant.step(np.array([np.nan, 0.0, np.inf]), TICK).q).any()
    assert not np.isfinite(plant.step(GRAVITY * MASSES, TICK).force).any()  # for good
    seen = plant.reset(np.zeros(3), np.zeros(3), FAR, np.eye(3))
    assert np.isfinite(plant.step(GRAVITY * MASSES, TICK).q).all()
    assert np.isfinite(seen.q).all()


def test_what_diverges_is_said_and_does_not_begin_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo's own answer is to go back to its start; and to leave a log in the working folder."""
    monkeypatch.chdir(tmp_path)
    plant = MujocoPlant(model(stools(tmp_path), TIPS))
    plant.reset(np.zeros(3), np.zeros(3), FAR, np.eye(3))
    push = 1e3
    for _ in range(100):
        seen = plant.step(np.full(3, push), TICK)
        push *= -1e3 if push < 1e200 else 1.0
    assert not np.isfinite(seen.q).any()
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_without_mujoco_one_line_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(WbcError, match=r"pip install 'wbc\[mujoco\]'") as refusal:
        package()
    assert "\n" not in str(refusal.value)
