"""Inside and outside, closest points, pieces, meshes and outlines of every surface."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from contact.surface_table import (
    CASES,
    CONVEX,
    PLANAR,
    WINDING,
    build,
    contacts,
    extent,
    frames,
)
from wbc.contact.surfaces import SURFACES
from wbc.contact.surfaces.closest import follow
from wbc.contact.surfaces.plane import convex_parts, is_simple, signed_area, triangles


def test_distances_are_signed_distances():
    p = np.array([0.3, -0.2, 0.4])
    assert SURFACES["sphere"](0.05).level(p) == pytest.approx(np.linalg.norm(p) - 0.05, abs=1e-15)
    assert SURFACES["circle"](0.5).level(p) == pytest.approx(math.hypot(0.3, 0.2) - 0.5, abs=1e-15)
    box = SURFACES["box"]([0.2, 0.2, 0.2])
    assert box.level(p) == pytest.approx(np.linalg.norm([0.2, 0.1, 0.3]))
    assert box.level(np.array([0.01, 0.02, -0.07])) == pytest.approx(-0.03)
    cylinder = SURFACES["cylinder"](0.1, 0.2)
    assert cylinder.level(p) == pytest.approx(math.hypot(math.hypot(0.3, 0.2) - 0.1, 0.3))
    assert cylinder.level(np.array([0.0, 0.02, 0.09])) == pytest.approx(-0.01)


@pytest.mark.parametrize("case", CASES)
def test_level_gradient(case):
    surface = build(case)
    size = extent(surface)
    xi, face = contacts(surface, 60, seed=3)
    _, frame, _, _ = frames(surface, xi, face)
    rng = np.random.default_rng(4)
    h = 1e-5 * size
    for x, k, n in zip(xi, face, frame[:, :, 2], strict=True):
        # from a little inside to well outside; kinks of the distance lie deeper
        p = surface.point(x, int(k)) + n * rng.uniform(-0.02, 1.0) * size
        gradient = surface.level_gradient(p)
        for axis in range(3):
            e = np.zeros(3)
            e[axis] = h
            near = surface.level(p + e) - surface.level(p - e)
            far = surface.level(p + 2 * e) - surface.level(p - 2 * e)
            assert gradient[axis] == pytest.approx((8 * near - far) / (12 * h), abs=1e-7)
        assert surface.planar <= (gradient[2] == 0.0)


@pytest.mark.parametrize("case", CASES)
def test_project_finds_the_contact_again(case):
    surface = build(case)
    xi, face = contacts(surface)
    for x, k in zip(xi, face, strict=True):
        c = surface.point(x, int(k))
        again, chart = surface.project(c)
        assert np.allclose(surface.point(again, chart), c, atol=1e-10 * extent(surface))
        assert surface.margin(again, chart) >= -1e-12
        again, chart = surface.project(c, face=int(k))
        assert chart == k
        assert np.allclose(again, x, atol=1e-8)


@pytest.mark.parametrize("case", CASES)
def test_project_is_closest(case):
    surface = build(case)
    size = extent(surface)
    xi, face = contacts(surface, 4000, seed=1, inside=1.0)
    cloud = surface.charts(xi, face)[:, 0]
    rng = np.random.default_rng(2)
    for _ in range(40):
        p = rng.uniform(-1.6, 1.6, 3) * size
        p[2] *= not surface.planar
        found, k = surface.project(p)
        gap = p - surface.point(found, k)
        distance = np.linalg.norm(gap)
        assert distance <= np.min(np.linalg.norm(cloud - p, axis=1)) + 1e-12
        assert (surface.level(p) > 0.0) == (gap @ surface.level_gradient(p) > 0.0)
        inner = surface.margin(found, k) > 1e-9
        normal = frames(surface, found[None], k)[1][0, :, 2]
        if inner:
            assert np.linalg.norm(gap - normal * (normal @ gap)) < 1e-7 * size


@pytest.mark.parametrize("case", PLANAR)
def test_height_does_not_matter_to_a_contour(case):
    surface = build(case)
    p, q = np.array([0.3, 0.2, 0.0]), np.array([0.3, 0.2, 7.0])
    assert surface.level(p) == surface.level(q)
    assert np.array_equal(surface.level_gradient(p), surface.level_gradient(q))
    assert np.array_equal(surface.project(p)[0], surface.project(q)[0])
    assert surface.project(q)[0][1] == 0.0


@pytest.mark.parametrize("case", CASES)
def test_follow_keeps_up_with_tips(case):
    surface = build(case)
    xi, face = contacts(surface, 12, inside=0.7)
    charts, frame, _, _ = frames(surface, xi, face)
    # 1 mm along the surface, 1 mm off it
    move = 1e-3 * (frame[:, :, 2] + frame[:, :, 0])
    points, moved, records = charts[:, 0] + move, xi.copy(), np.empty_like(charts)
    follow(surface, points, moved, face, records, rounds=6)
    assert np.array_equal(records, surface.charts(moved, face))
    gap = points - records[:, 0]
    slope = np.einsum("nji,ni->nj", records[:, 1:3], gap)
    assert np.max(np.abs(slope)) < 1e-12
    assert np.all(np.linalg.norm(gap, axis=1) < 1.42e-3)
    assert not surface.planar or np.all(moved[:, 1] == 0.0)


@pytest.mark.parametrize("case", CASES)
def test_follow_squares_the_error(case):
    """Tips a twentieth of the body off the surface, chart coordinates a little wrong."""
    surface = build(case)
    xi, face = contacts(surface, 30, inside=0.7)
    charts, frame, _, _ = frames(surface, xi, face)
    points = charts[:, 0] + 0.05 * extent(surface) * frame[:, :, 2]
    wrong = xi + 1e-4 * np.array([1.0, 0.0 if surface.planar else -1.0])
    follow(surface, points, wrong, face, charts, rounds=1)
    # of the first 1e-4 a step of linear convergence would leave a few 1e-6
    assert np.max(np.abs(wrong - xi)) < 3e-7


def half_spaces(pieces):
    return [ConvexHull(piece).equations for piece in pieces]


def covered(hulls, points, tolerance=1e-9):
    inside = [np.all(points @ e[:, :3].T + e[:, 3] <= tolerance, axis=1) for e in hulls]
    return np.any(inside, axis=0)


@pytest.mark.parametrize("case", CASES)
def test_convex_pieces_cover_the_body_closely(case):
    surface = build(case)
    excess = 5e-3 if case in WINDING else 1e-3
    pieces = surface.convex_pieces(excess=excess)
    hulls = half_spaces(pieces)
    assert len(pieces) == 1 if case in CONVEX else 2 <= len(pieces) <= 16
    xi, face = contacts(surface, 2000, seed=5, inside=1.0)
    points = surface.charts(xi, face)[:, 0]
    assert np.all(covered(hulls, points, 1e-7))
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    body = np.random.default_rng(6).uniform(low, high, (1000, 3))
    body = body[[surface.level(p) < 0.0 for p in body]]
    assert np.all(covered(hulls, body, 1e-7))
    for piece in pieces:
        for corner in piece:
            k = surface.project(corner * [1, 1, not surface.planar])
            gap = corner - surface.point(*k)
            outside = surface.level(corner) > 0.0
            assert not outside or np.linalg.norm(gap[: 2 if surface.planar else 3]) < 1.01 * excess
    if surface.planar:
        assert all(np.max(np.abs(np.abs(piece[:, 2]) - 1.0)) == 0.0 for piece in pieces)
        assert np.max(surface.convex_pieces(thickness=0.1)[0][:, 2]) == pytest.approx(0.05)


def test_hollows_stay_free():
    """A tip in the waist, 2 mm off the contour, is outside all pieces."""
    surface = SURFACES["fourier_contour"](0.5, 0.36, 0.06)
    hulls = half_spaces(surface.convex_pieces())
    xi = np.column_stack([np.linspace(-np.pi, np.pi, 400), np.zeros(400)])
    charts, frame, _, _ = frames(surface, xi, 0)
    assert not np.any(covered(hulls, charts[:, 0] + 2e-3 * frame[:, :, 2]))
    finer = half_spaces(surface.convex_pieces(excess=2e-4))
    assert not np.any(covered(finer, charts[:, 0] + 4e-4 * frame[:, :, 2]))


@pytest.mark.parametrize("case", CASES)
def test_mesh_is_closed_and_faces_outward(case):
    surface = build(case)
    points, faces = surface.mesh(48, half_thickness=0.02)
    assert faces.dtype == np.int64 and faces.min() == 0 and faces.max() == len(points) - 1
    edges = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    directed = {(int(a), int(b)) for a, b in edges}
    assert len(directed) == len(edges)
    assert all((b, a) in directed for a, b in directed)
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert np.min(np.linalg.norm(normals, axis=1)) > 0.0
    volume = float(np.sum(a * normals)) / 6.0
    box = np.prod(np.max(points, axis=0) - np.min(points, axis=0))
    assert 0.2 * box < volume <= box * (1 + 1e-12)
    ring = points if case[0] != "cylinder" else points[:-2]
    assert max(abs(surface.level(p)) for p in ring) < 1e-12
    assert not surface.planar or np.allclose(np.abs(points[:, 2]), 0.02)


@pytest.mark.parametrize("case", PLANAR)
def test_outline(case):
    surface = build(case)
    outline = surface.outline(200)
    assert outline.shape == (200, 3)
    assert is_simple(outline[:, :2]) and signed_area(outline[:, :2]) > 0.0
    assert max(abs(surface.level(p)) for p in outline) < 1e-12
    cut = triangles(outline[:, :2])
    assert cut.shape == (198, 3)
    areas = [signed_area(outline[t, :2]) for t in cut]
    assert min(areas) > 0.0
    assert sum(areas) == pytest.approx(signed_area(outline[:, :2]), rel=1e-12)


def test_convex_parts_of_a_comb():
    """Deep notches: the parts are convex and fill exactly the polygon."""
    comb = np.array(
        [[0, 0], [7, 0], [7, 3], [5, 3], [5, 1], [4, 1], [4, 3], [2, 3], [2, 1], [1, 3]]
    )
    parts = convex_parts(comb.astype(float), 1e-9)
    assert sum(signed_area(p) for p in parts) == pytest.approx(signed_area(comb.astype(float)))
    assert not is_simple(np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]))
