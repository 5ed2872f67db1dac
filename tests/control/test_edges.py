"""A fingertip that is pulled over the edge of the face it slides on stays on the face."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.control.limiting import guarded
from wbc.control.state import Measurement, Status
from wbc.errors import ScenarioError

from .sliding import REACH, Slide, assemble, run

BOX = {"type": "box", "size": [0.1, 0.08, 0.06]}
BEYOND_ONE = [0.09, 0.02, 0.03 + REACH]
BEYOND_TWO = [0.09, 0.07, 0.03 + REACH]
CYLINDER = {"type": "cylinder", "radius": 0.05, "length": 0.12}
KEPT = 1e-3  # [m] from an edge


def box(folder: Path, goal: list[float], ticks: int | None = None, **overrides: Any) -> Slide:
    names = {key.replace("__", "."): value for key, value in overrides.items()}
    return run(assemble(folder, BOX, [0.0, 0.0], "z+", goal, overrides=names), ticks)


def largest_step(slide: Slide) -> float:
    return float(np.abs(np.diff(slide.v, axis=0)).max())


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
def test_it_stops_before_the_edge_and_goes_on_along_it(tmp_path: Path, integrator: str) -> None:
    slide = box(tmp_path, BEYOND_ONE, simulation__integrator=integrator)
    assert slide.xi[:, 0].max() <= 0.05 - KEPT + 1e-9
    assert slide.xi[-1, 0] == pytest.approx(0.05 - KEPT, abs=1e-6)
    assert slide.xi[-1, 1] == pytest.approx(0.02, abs=1e-5)  # the other direction converges
    assert slide.object_error < (1e-9 if integrator == "rk4" else 1e-5)
    assert {record.status for record in slide.records} == {Status.OK, Status.AT_EDGE}
    assert all(record.limited.joint == -1 for record in slide.records)
    # it brakes: from well before the edge on, no faster than 1 m/s^2, and without a jump
    rate = np.diff(slide.xi[:, 0]) / 2e-3
    assert np.diff(rate).min() > -1.05 * 2e-3
    assert largest_step(slide) < 8e-3
    assert np.abs(slide.v[-1]).max() < 1e-4


def test_the_published_law_keeps_to_the_face_too(tmp_path: Path) -> None:
    slide = box(tmp_path, BEYOND_ONE, stack__form="printed")
    assert slide.xi[-1, 0] == pytest.approx(0.05 - KEPT, abs=1e-6)
    assert {record.status for record in slide.records} == {Status.OK, Status.AT_EDGE}
    assert slide.object_error < 1e-6 and largest_step(slide) < 1.5e-2


def test_in_a_corner_it_stands(tmp_path: Path) -> None:
    slide = box(tmp_path, BEYOND_TWO)
    assert (slide.xi.max(axis=0) <= np.array([0.05, 0.04]) - KEPT + 1e-9).all()
    np.testing.assert_allclose(slide.xi[-1], [0.05 - KEPT, 0.04 - KEPT], rtol=0.0, atol=1e-6)
    assert slide.object_error < 1e-9 and np.abs(slide.v[-1]).max() < 1e-9
    assert largest_step(slide) < 1.5e-2


def test_it_does_not_depend_on_the_tick(tmp_path: Path) -> None:
    coarse = box(tmp_path, BEYOND_ONE)
    fine = box(tmp_path, BEYOND_ONE, simulation__step="0.5 ms")
    np.testing.assert_allclose(fine.xi[::4], coarse.xi, rtol=0.0, atol=2e-4)
    np.testing.assert_allclose(fine.states[-1].q, coarse.states[-1].q, rtol=0.0, atol=1e-4)
    # the velocity bends where it brakes, so its steps shrink with the tick
    assert largest_step(fine) < 0.3 * largest_step(coarse)


def test_it_leaves_the_edge_when_it_is_wanted_inward(tmp_path: Path) -> None:
    assembly = assemble(tmp_path, BOX, [0.0, 0.0], "z+", BEYOND_ONE)
    there = run(assembly, 600)
    assert there.records[-1].status == Status.AT_EDGE
    controller, state = assembly.controller, there.states[-1]
    k = controller.task_names.index("pull")
    target = state.targets[k]
    assert target is not None
    state = controller.retarget(state, "pull", target - [0.09, 0.0, 0.0])
    for _ in range(800):
        record, state = controller.step(state)
        assert record.status == Status.OK
    assert state.contact.xi[0, 0] == pytest.approx(0.0, abs=1e-4)


def test_limits_of_the_joints_hold_beside_it(tmp_path: Path) -> None:
    slide = box(
        tmp_path, BEYOND_TWO, limits__acceleration="2 rad/s^2", limits__velocity_scale=0.03
    )  # fmt: skip
    assert np.abs(slide.v).max() <= 0.03 * 3.0 + 1e-9
    assert largest_step(slide) <= 2.0 * 2e-3 + 1e-9
    assert (slide.xi.max(axis=0) <= np.array([0.05, 0.04]) - KEPT + 1e-9).all()
    assert slide.object_error < 1e-5


def test_without_a_measurement_it_brakes_on_the_face(tmp_path: Path) -> None:
    assembly = assemble(tmp_path, BOX, [0.0, 0.0], "z+", BEYOND_ONE)
    state = run(assembly, 250).states[-1]
    assert state.contact.xi[0, 0] > 0.04
    for _ in range(300):
        bad = Measurement(np.full_like(state.q, np.nan))
        record, state = assembly.controller.step(state, bad)
        assert record.status & Status.BAD_MEASUREMENT
        assert state.contact.xi[0, 0] <= 0.05 - KEPT + 1e-9
    assert (record.v == 0.0).all()


@pytest.mark.parametrize("goal", [[0.03, 0.05, 0.1], [0.03, 0.05, -0.1]])
def test_the_side_of_a_cylinder_ends(tmp_path: Path, goal: list[float]) -> None:
    slide = run(assemble(tmp_path, CYLINDER, [0.0, 0.0], "side", goal))
    assert np.abs(slide.xi[:, 1]).max() <= 0.06 - KEPT + 1e-9
    assert abs(slide.xi[-1, 1]) == pytest.approx(0.06 - KEPT, abs=1e-6)
    assert slide.xi[-1, 0] == pytest.approx(np.arctan2(0.05, 0.03), abs=2e-2)
    assert slide.object_error < 1e-8


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
def test_the_end_of_a_cylinder_is_round(tmp_path: Path, integrator: str) -> None:
    """Pulled beyond the rim it slides along it to the point nearest to its goal."""
    goal = [0.03, 0.07, 0.06 + REACH]
    slide = run(assemble(
        tmp_path, CYLINDER, [0.03, 0.0], "top", goal,
        overrides={"simulation.integrator": integrator},
    ))  # fmt: skip
    radius = np.linalg.norm(slide.xi, axis=1)
    assert radius.max() < 0.05 - KEPT + 2e-5
    assert radius[-1] == pytest.approx(0.05 - KEPT, abs=1e-6)
    nearest = (0.05 - KEPT) * np.array(goal[:2]) / np.hypot(*goal[:2])
    np.testing.assert_allclose(slide.xi[-1], nearest, rtol=0.0, atol=1e-4)
    assert slide.object_error < 1e-5


def test_a_contact_beyond_the_edge_comes_back_only(tmp_path: Path) -> None:
    """As when the scenario's start lies in the strip that is kept free."""
    slide = run(assemble(tmp_path, BOX, [0.0496, 0.0], "z+", BEYOND_ONE))
    assert (np.diff(slide.xi[:, 0]) <= 1e-12).all()
    assert slide.xi[-1, 0] == pytest.approx(0.05 - KEPT, abs=1e-6)


def test_a_rate_once_held_is_kept_while_others_are_found(tmp_path: Path) -> None:
    """At the edge it is zero but for rounding: the sign of that must not turn it round."""
    assembly = assemble(tmp_path, BOX, [0.05 - KEPT, 0.0], "z+", BEYOND_TWO)
    state, law = assembly.start, assembly.controller.law
    settings, nv = assembly.controller.settings, len(state.q)
    here = guarded(state.q, state.contact, law.kin.grasp, settings.bounds)
    free, held, v = np.ones(nv), np.full(2, np.nan), np.zeros(nv + 2)
    v[nv] = 0.1
    assert here.stop(v, settings.dt, free, held)
    assert abs(held[0]) < 1e-9 and np.isnan(held[1]) and free.all()
    before = held[0]
    v[nv:] = -1e-18, 0.4
    assert here.stop(v, settings.dt, free, held)
    assert held[0] == before and held[1] == pytest.approx(np.sqrt(2.0 * 0.039), rel=0.02)
    v[nv:] = held
    assert not here.stop(v, settings.dt, free, held)
    assert [edge.finger for edge in here.locks(free, held).edges] == [0, 0]


def test_nothing_is_guarded_where_there_is_no_edge(tmp_path: Path) -> None:
    """No cost for round bodies, contours, and contacts that do not slide."""
    sphere = assemble(tmp_path, {"type": "sphere", "radius": 0.06}, [0.0, 0.0], "poles_z",
                      [0.06, 0.0, 0.0])  # fmt: skip
    boxed = assemble(tmp_path, BOX, [0.0, 0.0], "z+", BEYOND_ONE)
    for assembly, fixed in ((sphere, False), (boxed, True)):
        state, law = assembly.start, assembly.controller.law
        contact = state.contact
        if fixed:
            contact = contact._replace(mode=np.ones_like(contact.mode))
        bounds = assembly.controller.settings.bounds
        here = guarded(state.q, contact, law.kin.grasp, bounds)
        assert here.axes is None and here.bounds is bounds and here.position is state.q


@pytest.mark.parametrize(
    ("surface", "at", "face", "far"),
    [
        (BOX, [0.0, 0.043], "z+", "3 mm"),
        (CYLINDER, [1.0, -0.0612], "side", "1.2 mm"),
        (CYLINDER, [0.04, 0.04], "bottom", "6.57 mm"),
    ],
)
def test_a_start_beyond_the_edge_is_refused(
    tmp_path: Path, surface: dict[str, Any], at: list[float], face: str, far: str
) -> None:
    with pytest.raises(
        ScenarioError, match=f"contacts.a.at: .*{far} beyond .* '{re.escape(face)}'"
    ):
        assemble(tmp_path, surface, at, face, [0.0, 0.0, 0.1])
