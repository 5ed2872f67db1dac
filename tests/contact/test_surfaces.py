"""Charts and contact frames of every surface of the table, and the closed forms of a few."""

from __future__ import annotations

import importlib
import inspect
import json
import math
import os
import pkgutil
import subprocess
import sys
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

import wbc.contact.surfaces
from contact.surface_table import (
    CASES,
    EXAMPLES,
    POLAR,
    build,
    chart_step,
    contacts,
    difference,
    extent,
    frames,
    smooth_contacts,
)
from wbc.contact.surfaces import SURFACES, Surface
from wbc.contact.surfaces.closest import follow
from wbc.errors import UnknownNameError, WbcError


def test_every_surface_has_a_row_and_examples():
    assert set(EXAMPLES) == set(SURFACES)
    found = set()
    for module in pkgutil.iter_modules(wbc.contact.surfaces.__path__):
        members = vars(importlib.import_module(f"wbc.contact.surfaces.{module.name}")).values()
        found |= {m for m in members if inspect.isclass(m) and issubclass(m, Surface)}
    assert {m for m in found if not inspect.isabstract(m)} == set(SURFACES.values())
    assert all(not final.__subclasses__() for final in SURFACES.values())


@pytest.mark.parametrize("case", CASES)
def test_chart_derivatives(case):
    surface = build(case)
    xi, face = smooth_contacts(case)
    charts = surface.charts(xi, face)
    scale = max(extent(surface), 1.0 if surface.planar else 0.0)
    step = chart_step(surface)
    for j in range(2):
        first = difference(lambda x: surface.charts(x, face)[:, 0], xi, j, step)
        assert np.max(np.abs(first - charts[:, 1 + j])) < 1e-7 * scale
        second = difference(lambda x: surface.charts(x, face)[:, 1:3], xi, j, step)
        assert np.max(np.abs(second - charts[:, 3 + j : 5 + j])) < 1e-6 * scale


@pytest.mark.parametrize("case", CASES)
def test_frames(case):
    surface = build(case)
    xi, face = contacts(surface)
    charts, frame, _, _ = frames(surface, xi, face)
    identity = np.einsum("nji,njk->nik", frame, frame)
    assert np.max(np.abs(identity - np.eye(3))) < 1e-14
    assert np.allclose(np.linalg.det(frame), 1.0, atol=1e-14)
    assert np.all(np.einsum("ni,ni->n", charts[:, 1], frame[:, :, 0]) > 0.0)
    assert np.max(np.abs(np.einsum("nji,ni->nj", charts[:, 1:3], frame[:, :, 2]))) < 1e-14
    for c, n in zip(charts[:, 0], frame[:, :, 2], strict=True):
        assert abs(surface.level(c)) < 1e-13
        assert surface.level(c + 1e-3 * n) > 0.0 > surface.level(c - 1e-3 * n)
        # one sided: on an edge or a flat point the two sides differ
        assert np.allclose(surface.level_gradient(c + 1e-9 * n), n, atol=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_frame_rates(case):
    surface = build(case)
    xi, face = smooth_contacts(case)
    _, frame, normal_xi, spin = frames(surface, xi, face)
    for j in range(2):
        rate = difference(lambda x: frames(surface, x, face)[1], xi, j, chart_step(surface))
        size = max(1.0, float(np.max(np.abs(rate))))
        assert np.max(np.abs(rate[:, :, 2] - normal_xi[:, :, j])) < 1e-7 * size
        skew = np.einsum("nji,njk->nik", frame, rate)
        omega = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        assert np.max(np.abs(omega - spin[:, :, j])) < 1e-7 * size


def montana(surface, xi, face=0):
    """Metric, curvature and torsion of an orthogonal chart, from W = [E K M; T M]."""
    charts, _, _, spin = frames(surface, xi, face)
    metric = np.linalg.norm(charts[:, 1:3], axis=2)
    assert np.max(np.abs(np.einsum("ni,ni->n", charts[:, 1], charts[:, 2]))) < 1e-15
    turned = np.stack([spin[:, 1], -spin[:, 0]], axis=1)
    return metric, turned / metric[:, None, :], spin[:, 2] / metric


def test_closed_form_sphere():
    r = 0.05
    xi, _ = contacts(SURFACES["sphere"](r))
    for face in range(3):
        metric, curvature, torsion = montana(SURFACES["sphere"](r), xi, face)
        assert np.allclose(metric, np.column_stack([r * np.cos(xi[:, 1]), np.full(40, r)]))
        assert np.max(np.abs(r * curvature - np.eye(2))) < 1e-13
        assert np.allclose(torsion[:, 0], np.tan(xi[:, 1]) / r, rtol=1e-13)
        assert np.max(np.abs(r * torsion[:, 1])) < 1e-14


def test_closed_form_cylinder():
    surface = SURFACES["cylinder"](0.04, 0.2)
    xi = np.array([[0.3, 0.05], [-2.0, -0.09]])
    metric, curvature, torsion = montana(surface, xi)
    assert np.allclose(metric, [0.04, 1.0])
    assert np.allclose(curvature, [[25.0, 0.0], [0.0, 0.0]])
    assert np.max(np.abs(torsion)) < 1e-14


@pytest.mark.parametrize(("a", "b"), [(0.045, 0.06), (0.08, 0.03)])
def test_closed_form_spheroid(a, b):
    surface = SURFACES["spheroid"](a, b)
    xi, _ = contacts(surface)
    metric, curvature, torsion = montana(surface, xi)
    v = xi[:, 1]
    d = np.hypot(a * np.sin(v), b * np.cos(v))
    assert np.allclose(metric, np.column_stack([a * np.cos(v), d]), rtol=1e-13)
    assert np.allclose(curvature[:, 0, 0], b / (a * d), rtol=1e-12)
    assert np.allclose(curvature[:, 1, 1], a * b / d**3, rtol=1e-12)
    assert np.max(np.abs(curvature[:, 0, 1])) < 1e-11
    assert np.allclose(torsion[:, 0], np.tan(v) / d, rtol=1e-12)
    assert np.max(np.abs(torsion[:, 1])) < 1e-11


def test_contour_is_the_curvature_of_the_plane():
    surface = SURFACES["ellipse"](0.5, 0.3)
    xi, _ = contacts(surface)
    _, curvature, torsion = montana(surface, xi)
    u = xi[:, 0]
    expected = 0.5 * 0.3 / np.hypot(0.5 * np.sin(u), 0.3 * np.cos(u)) ** 3
    assert np.allclose(curvature[:, 0, 0], expected, rtol=1e-12)
    assert np.max(np.abs(curvature[:, 1])) == 0.0
    assert np.max(np.abs(torsion)) == 0.0


def test_exponent_two_is_the_ellipsoid():
    surface = SURFACES["superellipsoid"](0.045, 0.045, 0.06, 2)
    spheroid = SURFACES["spheroid"](0.045, 0.06)
    xi, face = contacts(surface)
    charts, frame, _, _ = frames(surface, xi, face)
    for c, n in zip(charts[:, 0], frame[:, :, 2], strict=True):
        other, k = spheroid.project(c)
        assert np.allclose(spheroid.point(other, k), c, atol=1e-15)
        assert np.allclose(spheroid.level_gradient(c), n, atol=1e-12)


@pytest.mark.parametrize("case", CASES)
def test_finite_everywhere(case):
    """Poles, axes, centres of flat sides, faces that do not exist: numbers, and proper frames."""
    surface = build(case)
    quarter = np.pi * np.arange(-4, 5) / 2.0
    xi = np.array([(u, v) for u in quarter for v in (-np.pi / 2, -np.pi / 4, 0.0, np.pi / 2)])
    xi = np.vstack([xi, xi + 1e-12, xi * 1e8])
    for face in (-7, -1, *range(len(surface.faces)), 1000):
        charts, frame, normal_xi, spin = frames(surface, xi, face)
        for values in (charts, frame, normal_xi, spin):
            assert np.all(np.isfinite(values))
        identity = np.einsum("nji,njk->nik", frame, frame)
        assert np.max(np.abs(identity - np.eye(3))) < 1e-9
    size = extent(surface)
    for p in np.vstack([np.zeros(3), size * np.eye(3), -size * np.eye(3), 1e6 * np.eye(3)]):
        assert math.isfinite(surface.level(p))
        assert np.all(np.isfinite(surface.level_gradient(p)))
        assert np.all(np.isfinite(surface.project(p)[0]))


@pytest.mark.parametrize("case", POLAR)
def test_frame_at_a_pole_is_the_limit(case):
    surface = build(case)
    for sign in (-1.0, 1.0):
        for face in range(3):
            xi = np.array([[0.4, sign * np.pi / 2], [0.4, sign * (np.pi / 2 - 1e-6)]])
            frame = frames(surface, xi, face)[1]
            assert np.allclose(frame[0], frame[1], atol=1e-4)
            outward = np.roll([0.0, 0.0, sign], face)
            assert np.allclose(frame[0, :, 2], outward, atol=1e-9)


@pytest.mark.parametrize("case", POLAR)
def test_another_face_describes_a_contact_at_a_pole(case):
    surface = build(case)
    for face in range(3):
        pole = np.array([0.3, math.radians(89.0)])
        assert not surface.regular(pole, face)
        c = surface.point(pole, face)
        xi, other = surface.project(c)
        assert surface.regular(xi, other)
        assert np.allclose(surface.point(xi, other), c, atol=1e-12)
        moved, k = surface.project(c, face=(face + 1) % 3)
        assert k == (face + 1) % 3
        assert abs(moved[1]) < math.radians(36.0)
    rng = np.random.default_rng(0)
    for d in rng.normal(size=(200, 3)):
        best = min(abs(surface.project(d, face=k)[0][1]) for k in range(3))
        assert best < math.radians(36.0)


def python_numbers():
    """Frames of all surfaces, as numbers, by a Python that compiles nothing."""
    program = (
        "import json, contact.test_surfaces as t;"
        "print(json.dumps([[a.tolist() for a in t.all_frames(c)] for c in t.CASES]))"
    )
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def all_frames(case):
    surface = build(case)
    xi, face = contacts(surface, 12)
    records = np.empty((12, 6, 3))
    moved = xi.copy()
    follow(surface, 1.01 * surface.charts(xi, face)[:, 0], moved, face, records)
    return [*frames(surface, xi, face), moved, records]


def test_compiled_and_plain_agree():
    plain = python_numbers()
    for case, numbers in zip(CASES, plain, strict=True):
        for one, other in zip(all_frames(case), numbers, strict=True):
            assert np.allclose(one, other, rtol=1e-12, atol=1e-12), case


@pytest.mark.parametrize("case", CASES)
def test_evaluation_is_pure(case):
    surface = build(case)
    xi, face = contacts(surface)
    kept_xi, kept_face = xi.copy(), face.copy()
    first = frames(surface, xi, face)
    kept = first[0].copy()
    again = frames(surface, xi, face)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    p = surface.point(xi[0], int(face[0])) * 1.1
    kept_p = p.copy()
    results = [(surface.level(p), *surface.level_gradient(p), *surface.project(p)[0]) for _ in "12"]
    assert results[0] == results[1]
    assert np.array_equal(p, kept_p)
    assert np.array_equal(xi, kept_xi) and np.array_equal(face, kept_face)
    assert np.array_equal(first[0], kept)
    p.setflags(write=False)
    xi.setflags(write=False)
    assert np.array_equal(surface.charts(xi, face), kept)
    surface.project(p)


@pytest.mark.parametrize("case", CASES)
def test_definitions_are_values(case):
    surface = build(case)
    assert surface == build(case)
    assert hash(surface) == hash(build(case))
    with pytest.raises(FrozenInstanceError):
        setattr(surface, fields(surface)[0].name, 1.0)
    for item in fields(surface):
        value = getattr(surface, item.name)
        assert not isinstance(value, np.ndarray) or not value.flags.writeable


@pytest.mark.parametrize(
    ("name", "sizes", "words"),
    [
        ("circle", {"radius": 0.0}, "radius = 0.0 must be positive"),
        ("circle", {"radius": math.nan}, "radius"),
        ("ellipse", {"a": 1.0, "b": -1.0}, "b = -1.0"),
        ("superellipse", {"a": 1.0, "b": 1.0, "p": 1.5}, "p = 1.5"),
        ("fourier_contour", {"a": 0.5, "b": 0.36, "h": math.inf}, "h = inf"),
        ("fourier_contour", {"a": 0.5, "b": 0.36, "h": 0.5}, "crosses itself"),
        (
            "fourier_contour",
            {"a": 0.5, "b": 0.3, "harmonics": [[1, -1.0, 0, 0, 0]]},
            "counterclock",
        ),
        ("fourier_contour", {"a": 0.5, "b": 0.3, "harmonics": [[1.5, 0, 0, 0, 0]]}, "order"),
        ("fourier_contour", {"a": 0.4, "b": 0.4, "harmonics": [[2, 0.2, 0, 0, 0.2]]}, "cusp"),
        ("sphere", {"radius": math.inf}, "radius = inf"),
        ("spheroid", {"a": 0.0, "b": 1.0}, "a = 0.0"),
        ("cylinder", {"radius": 1.0, "length": -2.0}, "length"),
        ("superellipsoid", {"ax": 1, "ay": 1, "az": 1, "p": 1000}, "p = 1000"),
        ("superellipsoid", {"ax": 1, "ay": 0, "az": 1, "p": 3}, "ay = 0"),
        ("box", {"size": [1.0, 2.0]}, "three lengths"),
        ("box", {"size": [1.0, 2.0, 0.0]}, "size"),
    ],
)
def test_bad_sizes_are_refused(name, sizes, words):
    with pytest.raises(WbcError, match=words) as caught:
        SURFACES[name](**sizes)
    assert "\n" not in str(caught.value)


def test_faces_by_name():
    box = SURFACES["box"]([0.1, 0.2, 0.3])
    for name in box.faces:
        axis, sign = "xyz".index(name[0]), float(name[1] + "1")
        normal = frames(box, np.zeros((1, 2)), box.face_index(name))[1][0, :, 2]
        assert np.array_equal(normal, sign * np.eye(3)[axis])
    with pytest.raises(UnknownNameError, match="did you mean"):
        box.face_index("z")
