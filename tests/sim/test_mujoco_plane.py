"""Planar contours in MuJoCo: the pads are the chapter's springs, what holds sticks, and a slide."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.sim.mujoco_worlds import model
from wbc.arrays import Array
from wbc.contact.grasp import ContactMode
from wbc.contact.surfaces import SURFACES, Surface
from wbc.contact.surfaces.fourier_contour import FourierContour
from wbc.robot.model import RobotModel, load_robot
from wbc.sim.mujoco_plant import MujocoPlant

pytest.importorskip("mujoco")

CIRCLE = SURFACES["circle"](radius=0.3)
REST, STIFF = 5e-3, 5e4
SLIDE = """<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
  <axis xyz="{axis}"/><limit lower="-9" upper="9" velocity="9" effort="99"/></joint>
  <link name="{child}"><inertial><mass value="0.25"/>
  <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def _probe(folder: Path) -> RobotModel:
    """A fingertip on two slides, 0.25 kg along y and 0.5 kg along x."""
    joints = SLIDE.format(name="x", parent="base", child="xs", axis="1 0 0")
    joints += SLIDE.format(name="y", parent="xs", child="tip", axis="0 1 0")
    path = folder / "probe.urdf"
    path.write_text(f'<robot name="probe"><link name="base"/>{joints}</robot>')
    return load_robot(path)


def _plant(
    folder: Path, surface: Surface = CIRCLE, *, fixture: bool = True, mass: float = 1.0
) -> MujocoPlant:
    made = model(
        _probe(folder), ["tip"], surface, mass, inertia=(0.1, 0.1, 0.1), step=5e-4,
        sliding_friction=np.zeros(1),
    )  # fmt: skip
    return MujocoPlant(made, fixture=fixture)


def _pushed(plant: MujocoPlant, force: Array, ticks: int) -> list[Array]:
    """(q, force on the object, slip) after every tick, friction in the slides of 20 N s/m."""
    found, v = [], np.zeros(2)
    for _ in range(ticks):
        seen = plant.step(force - 20.0 * v, 1e-3)
        v = seen.v
        found.append(np.concatenate([seen.q, seen.force[0], seen.slip]))
    return found


@pytest.mark.parametrize("press", [1.0, 20.0])
def test_a_pad_is_a_spring_of_the_stiffness_given(press: float, tmp_path: Path) -> None:
    plant = _plant(tmp_path)
    plant.reset(np.array([0.3 + REST, 0.0]), np.zeros(2), np.zeros(3), np.eye(3))
    end = _pushed(plant, np.array([-press, 0.0]), 1500)[-1]
    assert end[2:5] == pytest.approx([-press, 0.0, 0.0], abs=1e-4)
    assert 0.3 + REST - end[0] == pytest.approx(press / STIFF, rel=1e-3)


def test_it_sticks_within_its_cone_and_slides_beyond(tmp_path: Path) -> None:
    for mode, across, sticks in (
        (ContactMode.FIXED, 7.0, True), (ContactMode.FIXED, 9.0, False),
        (ContactMode.SLIDING, 1.0, False),
    ):  # fmt: skip
        plant = _plant(tmp_path)
        plant.reset(np.array([0.3048, 0.0]), np.zeros(2), np.zeros(3), np.eye(3))
        plant.treat(np.array([mode]))
        found = _pushed(plant, np.array([-10.0, across]), 40)
        mu = 0.8 if mode == ContactMode.FIXED else 0.0
        end = found[-1]
        if sticks:
            assert end[3] == pytest.approx(across, abs=1e-6)
            assert abs(end[1]) < 1e-5 and abs(end[1] - found[19][1]) < 1e-8  # no creep
        else:
            normal = end[:2] / np.linalg.norm(end[:2])
            tangential = end[3] * normal[0] - end[2] * normal[1]
            assert tangential == pytest.approx(-mu * end[2:4] @ normal, rel=1e-3, abs=1e-3)
            assert end[1] > 5e-4
        assert (end[5] > 5e-4) == (not sticks and mode == ContactMode.FIXED)


def test_the_plate_follows_the_contour_under_a_tip_that_slides(tmp_path: Path) -> None:
    """All round a waisted contour, pressing by 5 N: normal and place are the closest point's."""
    contour = FourierContour(0.5, 0.36, 0.06)
    plant = _plant(tmp_path, contour)
    xi = np.array([[u, 0.0] for u in np.linspace(0.0, 2.0 * np.pi, 41)])
    for record in contour.charts(xi):
        normal = np.cross(record[1], record[2])
        normal /= np.linalg.norm(normal)
        turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
        origin = np.array([0.1, -0.2, 0.0])
        tip = origin + turn @ (record[0] + (REST - 1e-4) * normal)
        seen = plant.reset(tip[:2], np.zeros(2), origin, turn)
        plant.treat(np.array([ContactMode.SLIDING]))
        seen = plant.step(turn[:2, :2] @ (-5.0 * normal[:2]), 5e-4)
        direction = turn.T @ seen.force[0] / np.linalg.norm(seen.force[0])
        assert direction == pytest.approx(-normal, abs=1e-4)
        assert np.linalg.norm(seen.force[0]) == pytest.approx(5.0, rel=0.05)


def test_the_object_is_free_in_the_plane_and_only_there(tmp_path: Path) -> None:
    plant = _plant(tmp_path, fixture=False, mass=2.0)
    plant.reset(np.array([3.0, 0.0]), np.zeros(2), np.array([0.1, 0.2, 0.0]), np.eye(3))
    plant.disturb(np.array([4.0, -2.0, 5.0]), np.zeros(1, dtype=np.bool_))
    for _ in range(100):
        seen = plant.step(np.zeros(2), 1e-3)
    assert seen.object_position == pytest.approx([0.11, 0.195, 0.0], abs=2e-4)
    assert seen.object_rotation == pytest.approx(np.eye(3), abs=1e-9)
    assert not seen.force.any()


def test_a_contact_that_is_lost_bears_nothing(tmp_path: Path) -> None:
    plant = _plant(tmp_path)
    plant.reset(np.array([0.3 + REST - 2e-4, 0.0]), np.zeros(2), np.zeros(3), np.eye(3))
    assert plant.step(np.array([-10.0, 0.0]), 1e-3).force[0, 0] < -5.0
    plant.disturb(np.zeros(3), np.ones(1, dtype=np.bool_))
    assert not plant.step(np.array([-10.0, 0.0]), 1e-3).force.any()
