"""A fingertip that slides over the pole of its chart, in the running controller."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wbc.control.state import Status

from .sliding import REACH, assemble, run

RADIUS = 0.06
LATITUDE = np.radians(50.0)
GOAL = (RADIUS + REACH) * np.array([-np.cos(LATITUDE), 0.0, np.sin(LATITUDE)])
SPHERE = {"type": "sphere", "radius": RADIUS}


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
def test_it_slides_over_the_pole(tmp_path: Path, integrator: str) -> None:
    overrides = {"simulation.integrator": integrator}
    slide = run(assemble(tmp_path, SPHERE, [0.2, LATITUDE], "poles_z", GOAL, overrides=overrides))
    assert (slide.face[0], slide.face[-1]) == (0, 2) and np.count_nonzero(np.diff(slide.face)) == 1
    assert np.abs(slide.xi[:, 1]).max() < np.radians(70.2)
    crossed = np.arctan2(slide.points[:, 1], slide.points[:, 0])
    assert abs(crossed[0] - 0.2) < 1e-9 and abs(crossed[-1]) > 3.1  # over the top, to the far side
    assert {record.status for record in slide.records} == {Status.OK}
    assert slide.object_error < (1e-9 if integrator == "rk4" else 1e-4)
    assert slide.records[-1].task_error[1] < 1e-5
    # at the event the velocity goes on as before: a step as the ticks around it make them
    event = int(np.flatnonzero(np.diff(slide.face))[0])
    steps = np.diff(slide.v, axis=0)
    bend = np.abs(steps[event + 1] - steps[event]).max()
    around = np.abs(np.diff(steps[event - 20 : event], axis=0)).max()
    assert np.abs(steps[event]).max() < 1e-3 and bend < 1.2 * around + 1e-9


def test_it_moves_as_in_a_chart_that_needs_no_change(tmp_path: Path) -> None:
    """The same contact, started in the chart the other run changes to."""
    changing = run(assemble(tmp_path, SPHERE, [0.2, LATITUDE], "poles_z", GOAL), 500)
    body = changing.assembly.controller.law.kin.grasp.surface
    xi, face = body.project(body.point(np.array([0.2, LATITUDE]), 0), 2)
    staying = run(assemble(tmp_path, SPHERE, list(xi), "poles_y", GOAL), 500)
    assert set(staying.face) == {face} and changing.face[-1] == face
    difference = np.abs(changing.states[-1].q - staying.states[-1].q).max()
    assert difference < 1e-9, difference
    np.testing.assert_allclose(changing.points[-1], staying.points[-1], rtol=0.0, atol=1e-9)


def test_a_start_at_a_pole_is_taken_in_another_chart(tmp_path: Path) -> None:
    start = assemble(tmp_path, SPHERE, [0.3, 0.5 * np.pi], "poles_x", GOAL).start
    assert start.contact.face[0] != 1
    assert np.abs(start.contact.xi[0, 1]) < np.radians(55.0)
