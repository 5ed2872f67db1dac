"""The shaded picture: what covers what, how large, and how bright."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.contact.surfaces.sphere import Sphere
from wbc.recording.raycast import Picture
from wbc.recording.silhouette import View
from wbc.rotations import exp_so3

from .test_strip import ACROSS, SOLIDS, turned

RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)
LOW, HIGH = np.array([-0.5, -0.4]), np.array([0.5, 0.4])
WIDTH = 400


def picture(view: View | None = None) -> Picture:
    return Picture(view or View.from_above(), LOW, HIGH, WIDTH)


def covered(image: np.ndarray) -> float:
    """Area of what is not white, [m²]."""
    return float((image.min(axis=2) < 0.95).sum()) * (1.0 / WIDTH) ** 2


def is_red(pixel: np.ndarray) -> bool:
    return bool(pixel[0] > 2.0 * pixel[2])


def test_the_picture_has_the_shape_of_its_frame() -> None:
    assert picture().image().shape == (320, 400, 3)
    assert (picture().image() == 1.0).all()


@pytest.mark.parametrize(("kind", "size", "at", "expected"), SOLIDS)
def test_areas(kind: str, size: tuple[float, ...], at: np.ndarray, expected: float) -> None:
    shot = picture()
    shot.solid(kind, size, at, RED)
    assert covered(shot.image()) == pytest.approx(expected, rel=0.06)  # a pixel at the edge counts


@pytest.mark.parametrize("kind", ["sphere", "capsule", "cylinder", "box"])
@pytest.mark.parametrize("seed", range(4))
def test_hits_lie_on_the_surface_and_normals_look_at_the_eye(kind: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    size = {"sphere": (0.2,), "box": (0.2, 0.3, 0.4)}.get(kind, (0.1, 0.3))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = exp_so3(random.normal(size=3)), 0.05 * random.normal(size=3)
    view = View.along((0.8, -0.3, 0.4))
    shot = picture(view)
    shot.solid(kind, size, pose, RED)
    j, i = np.nonzero(np.isfinite(shot._depth))
    u, v = (LOW[k] + (n + 0.5) * shot._step for k, n in ((0, i), (1, j)))
    world = np.outer(u, view.right) + np.outer(v, view.up)
    world += shot._depth[j, i, None] * view.towards
    x, y, z = np.abs(((world - pose[:3, 3]) @ pose[:3, :3]).T)
    across = np.hypot(x, y)
    off = {
        "sphere": lambda: np.hypot(across, z) - 0.2,
        "box": lambda: np.max((x - 0.1, y - 0.15, z - 0.2), axis=0),
        "cylinder": lambda: np.maximum(across - 0.1, z - 0.15),
        "capsule": lambda: np.hypot(across, np.maximum(z - 0.15, 0.0)) - 0.1,
    }[kind]()
    assert len(off) > 1000
    np.testing.assert_allclose(off, 0.0, atol=1e-12)
    normals = shot._normal[j, i]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    assert (normals[:, 2] >= -1e-9).all()


@pytest.mark.parametrize("red_first", [True, False])
def test_what_is_nearer_covers_what_is_behind_in_any_order(red_first: bool) -> None:
    shot = picture()
    solids = [
        ("sphere", (0.1,), turned((0, 0, 0), (0.0, 0.0, 1.0)), RED),
        ("capsule", (0.2, 0.4), turned(ACROSS), BLUE),
    ]
    for kind, size, at, rgb in solids if red_first else solids[::-1]:
        shot.solid(kind, size, at, rgb)
    image = shot.image()
    assert is_red(image[160, 200]), "the ball in front"
    assert not is_red(image[160, 320]), "the rod beside it"


def test_solids_that_cross_are_cut_where_they_cross() -> None:
    """What no order of painting could show."""
    shot = picture()
    tilt = np.deg2rad(20.0)
    shot.solid("box", (0.8, 0.3, 0.01), turned((0, tilt, 0)), RED)
    shot.solid("box", (0.8, 0.3, 0.01), turned((0, -tilt, 0)), BLUE)
    image = shot.image()
    assert is_red(image[160, 100]) and not is_red(image[160, 300])


def test_a_mesh_is_its_solid() -> None:
    ball, mesh = picture(), picture()
    ball.solid("sphere", (0.2,), np.eye(4), RED)
    mesh.mesh(*Sphere(0.2).mesh(96), np.eye(4), RED)
    difference = np.abs(ball.image() - mesh.image()).max(axis=2)
    assert (difference > 0.1).mean() < 0.004, "apart from the edge"
    inside_out, triangles = Sphere(0.2).mesh(96)
    turned_over = picture()
    turned_over.mesh(inside_out, triangles[:, ::-1], np.eye(4), RED)
    np.testing.assert_allclose(turned_over.image(), mesh.image(), atol=1e-12)


def test_large_and_small_triangles_and_such_beyond_the_picture() -> None:
    shot = picture()
    square = np.array([(-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (9.0, 9.0, 0.0), (-9.0, 9.0, 0.0)])
    shot.mesh(square, np.array([(0, 1, 2), (0, 2, 3)]), np.eye(4), RED)
    shot.mesh(np.full((3, 3), np.nan), np.array([(0, 1, 2)]), np.eye(4), BLUE)
    shot.mesh(square * (1e-6, 1e-6, 1.0) + (5.0, 0, 1), np.array([(0, 1, 2)]), np.eye(4), BLUE)
    image = shot.image()
    np.testing.assert_allclose(image, np.broadcast_to(image[0, 0], image.shape), atol=1e-9)
    assert is_red(image[0, 0])


def test_a_solid_beside_the_picture_is_not_drawn() -> None:
    shot = picture()
    shot.solid("sphere", (0.2,), turned((0, 0, 0), (3.0, 0.0, 0.0)), RED)
    assert (shot.image() == 1.0).all()


def test_light_comes_from_above_the_eye() -> None:
    shot = picture()
    shot.solid("sphere", (0.2,), np.eye(4), RED)
    image = shot.image()
    assert image[120, 200, 0] > image[160, 200, 0] > image[200, 200, 0]
