"""The picture strip: what is drawn is where it should be, for any robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from wbc.errors import WbcError
from wbc.recording.silhouette import View, convex_hull, matrices, outline
from wbc.recording.strip import draw_strip, moments
from wbc.rotations import exp_so3
from wbc.view import ObjectShape, Scene, SceneShape, Snapshot, extrude

from .runs import META, arrows, recorded

BLUE, GREEN, ORANGE = "#2040C0", "#20A040", "#F2AD3D"
SQUARE = np.array([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])


def rgba(color: str) -> tuple[float, float, float, float]:
    return (*to_rgb(color), 1.0)


def scene(planar: bool = True) -> Scene:
    """A blue arm on the left, a green ball on the right, a square object between them."""
    vertices, triangles = extrude(SQUARE, -0.02, 0.02)
    turned = np.eye(4)
    turned[:3, :3] = exp_so3(np.array([0.0, np.pi / 2, 0.0]))
    return Scene(
        title="arm and ball",
        shapes=(
            SceneShape("rod", "capsule", "arm", (0.05, 0.4), rgba=rgba(BLUE), placement=turned),
            SceneShape("ball", "sphere", "ball", (0.1,), rgba=rgba(GREEN)),
            SceneShape("table", "box", None, (50.0, 50.0, 0.01), rgba=(1.0, 1.0, 1.0, 1.0)),
        ),
        object=ObjectShape(
            vertices, triangles, rgba(ORANGE), np.column_stack((SQUARE, np.zeros(4)))
        ),
        body_names=("arm", "ball"),
        contact_names=("f1", "f2"),
        phase_names=("reach", "slide"),
        planar=planar,
    )


def pose(x: float, y: float = 0.0) -> np.ndarray:
    return np.array([x, y, 0.0, 0.0, 0.0, 0.0, 1.0])


def snapshot(t: float, x: float = 0.0) -> Snapshot:
    nan3 = np.full(3, np.nan)
    return Snapshot(
        t=t,
        bodies=np.stack((pose(-0.5), pose(0.5))),
        object_pose=pose(x),
        contact_points=np.array([(-0.1, 0.0, 0.0), nan3]),
        contact_normals=np.array([(-1.0, 0.0, 0.0), nan3]),
        contact_mode=np.array([1, 1]),
        in_stack=np.array([True]),
        activation=np.array([1.0]),
        phase=1,
    )


def place(path: Path, color: str) -> tuple[float, float]:
    """Mean column and row of the pixels of a colour; fails where there are none."""
    pixels = matplotlib.image.imread(path)[..., :3]
    rows, columns = np.nonzero(np.abs(pixels - to_rgb(color)).max(axis=-1) < 0.03)
    assert len(rows) > 50, f"no {color}"
    return float(columns.mean()), float(rows.mean())


def test_bodies_and_object_are_where_they_should_be(tmp_path: Path) -> None:
    path = draw_strip(scene(), [snapshot(0.0, x=0.1)], tmp_path / "new" / "strip.png")
    arm, ball, item = (place(path, c) for c in (BLUE, GREEN, ORANGE))
    # metres per pixel from the two bodies, one metre apart
    scale = ball[0] - arm[0]
    assert scale > 100
    assert (item[0] - arm[0]) / scale == pytest.approx(0.6, abs=0.02)
    assert arm[1] == pytest.approx(ball[1], abs=3) and item[1] == pytest.approx(ball[1], abs=3)


def test_up_in_the_plane_is_up_in_the_picture(tmp_path: Path) -> None:
    up = replace(snapshot(0.0), object_pose=pose(0.0, 0.3))
    path = draw_strip(scene(), [up], tmp_path / "strip.png")
    assert place(path, ORANGE)[1] < place(path, BLUE)[1] - 20


def test_pictures_of_one_strip_share_a_scale(tmp_path: Path) -> None:
    path = draw_strip(scene(), [snapshot(0.0, -0.2), snapshot(1.0, 0.2)], tmp_path / "strip.png")
    pixels = matplotlib.image.imread(path)[..., :3]
    blue = np.abs(pixels - to_rgb(BLUE)).max(axis=-1) < 0.03
    rows, columns = np.nonzero(blue)
    # wherever the layout put the two pictures, each holds half of the arm's pixels
    split = np.median(columns) if np.ptp(columns) > np.ptp(rows) else np.median(rows)
    first = (columns if np.ptp(columns) > np.ptp(rows) else rows) < split
    assert first.mean() == pytest.approx(0.5, abs=0.02)


def test_contacts_are_drawn_only_where_they_are(tmp_path: Path) -> None:
    red = "#B2182B"
    touching = draw_strip(scene(), [snapshot(0.0)], tmp_path / "touching.png")
    assert place(touching, red)[0] < place(touching, ORANGE)[0]
    free = replace(snapshot(0.0), contact_mode=np.array([0, 0]))
    with pytest.raises(AssertionError, match="no #B2182B"):
        place(draw_strip(scene(), [free], tmp_path / "free.png"), red)


def test_a_spatial_scene_is_seen_obliquely(tmp_path: Path) -> None:
    path = draw_strip(scene(planar=False), [snapshot(0.0)], tmp_path / "strip.png")
    # from the front right: what lies further along x is further right and nearer, so lower
    assert place(path, GREEN)[0] > place(path, BLUE)[0]
    assert place(path, GREEN)[1] > place(path, BLUE)[1]


@pytest.mark.parametrize("count", [1, 2, 5, 7])
def test_any_number_of_pictures(tmp_path: Path, count: int) -> None:
    instants = [snapshot(0.1 * k) for k in range(count)]
    path = draw_strip(scene(), instants, tmp_path / "strip.png")
    again = draw_strip(scene(), instants, tmp_path / "again.png")
    assert path.read_bytes() == again.read_bytes()


def test_poses_that_were_never_computed_are_left_out(tmp_path: Path) -> None:
    lost = replace(snapshot(0.0), bodies=np.stack((pose(np.nan), np.zeros(7))))
    draw_strip(scene(), [lost, snapshot(1.0)], tmp_path / "strip.png")
    nowhere = replace(lost, object_pose=np.full(7, np.nan))
    with pytest.raises(WbcError, match="no body has a finite pose"):
        draw_strip(scene(), [nowhere], tmp_path / "none.png")
    with pytest.raises(WbcError, match="no instant was given"):
        draw_strip(scene(), [], tmp_path / "none.png")


def test_a_scene_without_object_or_phases(tmp_path: Path) -> None:
    bare = replace(scene(), object=None, phase_names=(), contact_names=())
    path = draw_strip(bare, [replace(snapshot(0.0), phase=-1)], tmp_path / "strip.png")
    place(path, BLUE)


def test_moments_show_the_phases_first() -> None:
    log = recorded(100)
    assert moments(log, 1).tolist() == [0]
    assert moments(log, 2).tolist() == [0, 99]
    assert moments(log, 3).tolist() == [0, 50, 99]
    assert moments(log, 5).tolist() == [0, 25, 50, 74, 99]
    assert moments(recorded(3), 5).tolist() == [0, 1, 2]
    assert moments(recorded(1), 5).tolist() == [0]
    assert moments(recorded(0), 5).tolist() == []


def test_moments_prefer_where_fingers_touch_or_leave() -> None:
    """Ten phases of ten ticks; a finger comes at 50 and leaves at 70."""
    names = tuple(f"p{k}" for k in range(10))
    changes = {
        k: {"phase": k // 10, "mode": np.array([1, 2 if 50 <= k < 70 else 0])} for k in range(100)
    }
    log = recorded(100, changes, replace(META, phase_names=names))
    assert moments(log, 4).tolist() == [0, 50, 70, 99]
    assert moments(log, 5).tolist() == [0, 20, 50, 70, 99]
    assert len(moments(log, 11)) == 11 and set(range(0, 100, 10)) <= set(moments(log, 11).tolist())


def test_fingertips_take_the_colour_of_their_contact(tmp_path: Path) -> None:
    whole = scene(planar=False)
    ball = replace(whole.shapes[1], finger="f2")
    marked = replace(whole, shapes=(whole.shapes[0], ball, whole.shapes[2]))
    free = replace(snapshot(0.0), contact_mode=np.array([1, 0]))
    sliding = replace(snapshot(0.0), contact_mode=np.array([1, 2]))

    def mean(instant: Snapshot) -> np.ndarray:
        pixels = matplotlib.image.imread(draw_strip(marked, [instant], tmp_path / "s.png"))
        right = pixels[:, pixels.shape[1] // 2 :, :3]
        return np.array(right[np.ptp(right, axis=2) > 0.2].mean(axis=0))

    assert mean(free)[1] > mean(free)[2], "green, its own"
    assert mean(sliding)[2] > mean(sliding)[1], "blue"


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def turned(w: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = exp_so3(np.array(w, dtype=float)), at
    return out


ACROSS = (0.0, np.pi / 2, 0.0)
SOLIDS = [
    ("sphere", (0.2,), turned((1, 2, 3)), np.pi * 0.04),
    ("capsule", (0.1, 0.6), turned((0, 0, 0)), np.pi * 0.01),
    ("capsule", (0.1, 0.6), turned(ACROSS), np.pi * 0.01 + 0.12),
    ("cylinder", (0.1, 0.6), turned((0, 0, 1)), np.pi * 0.01),
    ("cylinder", (0.1, 0.6), turned(ACROSS), 0.12),
    ("box", (0.1, 0.2, 0.3), turned((0, 0, 0.4)), 0.02),
    ("box", (0.1, 0.2, 0.3), turned(ACROSS), 0.06),
]


@pytest.mark.parametrize(("kind", "size", "at", "expected"), SOLIDS)
def test_areas_of_silhouettes(
    kind: str, size: tuple[float, ...], at: np.ndarray, expected: float
) -> None:
    moved = at.copy()
    moved[:3, 3] = 3.0, -2.0, 7.0
    (polygon,) = outline(kind, size, None, None, moved, View.from_above())
    assert area(polygon) == pytest.approx(expected, rel=0.02)  # circles have 24 corners
    np.testing.assert_allclose(polygon.mean(axis=0), (3.0, -2.0), atol=0.02)


def test_a_box_from_a_corner_is_a_hexagon() -> None:
    (polygon,) = outline(
        "box", (1.0, 1.0, 1.0), None, None, np.eye(4), View.along((1.0, -1.4, 0.9))
    )
    assert len(polygon) == 6
    # of a unit cube: the sum of the parts of its faces that look at the eye
    assert area(polygon) == pytest.approx(np.abs(View.along((1.0, -1.4, 0.9)).towards).sum())


def test_views_are_orthonormal_and_right_handed() -> None:
    for view in (View.from_above(), View.along((1.0, -1.4, 0.9))):
        axes = np.stack((view.right, view.up, view.towards))
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(axes) == pytest.approx(1.0)
    assert View.along((1.0, -1.4, 0.9)).up[2] > 0.0


def test_meshes_come_from_back_to_front() -> None:
    vertices = np.array([(x, y, z) for z in (1.0, 0.0) for x, y in ((0, 0), (1, 0), (0, 1))])
    triangles = np.array([(0, 1, 2), (3, 4, 5)])
    faces = outline("mesh", (), vertices, triangles, np.eye(4), View.from_above())
    assert len(faces) == 2 and faces[0].shape == (3, 2)
    lifted = vertices.copy()
    lifted[:3, 0] += 5.0
    faces = outline("mesh", (), lifted, triangles, np.eye(4), View.from_above())
    assert faces[1][0, 0] == 5.0  # the upper one is drawn last


@pytest.mark.parametrize("seed", range(5))
def test_hulls_hold_every_point(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(40, 2))
    hull = convex_hull(points)
    edges = np.roll(hull, -1, axis=0) - hull
    for p in points:
        offset = p - hull
        assert (edges[:, 0] * offset[:, 1] - edges[:, 1] * offset[:, 0] >= -1e-12).all()
    assert area(hull) > 0.0


def test_hulls_of_what_has_no_area() -> None:
    assert len(convex_hull(np.zeros((4, 2)))) <= 2
    line = np.array([(0.0, 0.0), (1.0, 1.0), (0.5, 0.5)])
    assert sorted(map(tuple, convex_hull(line))) == [(0.0, 0.0), (1.0, 1.0)]


def test_poses_as_matrices_or_quaternions() -> None:
    half = np.sqrt(0.5)
    got = matrices(np.array([1.0, 2.0, 3.0, 0.0, 0.0, 2 * half, 2 * half]))
    np.testing.assert_allclose(got[0], turned((0, 0, np.pi / 2), (1, 2, 3)), atol=1e-15)
    np.testing.assert_array_equal(matrices(got), got)


@pytest.mark.parametrize("planar", [True, False])
def test_planned_forces_stand_at_their_contacts(tmp_path: Path, planar: bool) -> None:
    forces = arrows(np.array([0.5, 0.0, 0.0]))
    shot = replace(snapshot(0.0), forces=forces)
    path = draw_strip(
        replace(scene(planar), friction_angles=(0.5, 0.5)), [shot], tmp_path / "strip.png"
    )
    assert place(path, BLUE)[0] < place(path, "#0D9933")[0] < place(path, GREEN)[0]
