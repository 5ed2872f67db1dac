"""The pictures of planned forces: what they show is what was planned."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from wbc.recording.figures import COLORS, FORBIDDEN, WARNING, panels
from wbc.recording.force_figures import BLUE, GREEN, RED, fan, force_cones
from wbc.recording.force_marks import draw_forces
from wbc.recording.force_plots import forces
from wbc.recording.plots import plot
from wbc.recording.silhouette import View

from .runs import arrows, recorded, with_forces


def share(path: Path, color: str) -> float:
    """Part of a picture's pixels that have `color`, nearly."""
    pixels = matplotlib.image.imread(path)[..., :3]
    return float((np.abs(pixels - to_rgb(color)).max(axis=-1) < 0.02).mean())


def test_a_run_that_plans_forces_has_a_picture_of_them(tmp_path: Path) -> None:
    files = plot(with_forces(100), tmp_path)
    assert files[-1] == tmp_path / "forces.png"
    assert share(files[-1], COLORS[0]) > 1e-3 and share(files[-1], COLORS[1]) > 1e-4
    assert share(files[-1], FORBIDDEN) > 1e-3
    assert "forces.png" not in [f.name for f in plot(recorded(20), tmp_path / "other")]


def test_the_picture_tells_when_nothing_feasible_was_found() -> None:
    press, cones, torques, effort = forces(with_forces(100)).axes
    assert [text.get_text() for text in effort.get_legend().get_texts()] == ["infeasible friction"]
    for axes in (press, cones, torques, effort):
        (band,) = [c for c in axes.collections if np.allclose(c.get_facecolor()[0][:3],
                                                                to_rgb(WARNING))]  # fmt: skip
        x = band.get_paths()[0].vertices[:, 0]
        assert (x.min(), x.max()) == pytest.approx((0.9, 0.99))
    assert forces(with_forces(80)).axes[3].get_legend() is None
    free, touching = press.lines[-1].get_ydata()[[49, 50]]  # finger 2 touches at tick 50
    assert np.isnan(free) and touching == pytest.approx(0.5 * 3.5)


def test_a_fan_is_what_the_arrow_sweeps() -> None:
    # a quarter turn at 2 N, there and back at 1 N, to 45° on both sides
    angle = np.linspace(-np.pi / 4, np.pi / 4, 50)
    x = np.concatenate((2.0 * np.sin(angle), np.sin(angle[::-1])))
    z = np.concatenate((2.0 * np.cos(angle), np.cos(angle[::-1])))
    rim = fan(x, z)
    area = 0.5 * abs(
        np.sum(rim[:, 0] * np.roll(rim[:, 1], -1) - rim[:, 1] * np.roll(rim[:, 0], -1))
    )
    assert area == pytest.approx(np.pi, rel=0.03), "a quarter of a disk of 2 N"
    assert np.hypot(*rim.T).max() == pytest.approx(2.0, rel=1e-3)
    single = fan(np.array([0.0]), np.array([1.0]))
    assert np.hypot(*single.T).max() == pytest.approx(1.0)


def test_forces_stand_in_their_cones() -> None:
    """Contact 1 presses along x and is pulled along z: the picture shows just these two."""
    t = np.linspace(0.0, 1.0, 40)
    normals = np.tile([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], (40, 1, 1))
    free = 3.0 * normals
    free[:, 0, 2] = 1.5 * np.sin(2.0 * np.pi * t)
    figure = force_cones(["thumb", "index", "ring"], np.array([0, 0, 1]), np.full(3, 0.6),
                         normals, free, 0.5 * free)  # fmt: skip
    shown = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_title() for axes in shown] == ["thumb", "index", "ring"]
    assert len(figure.axes) == 4, "two hands, of two contacts at most"
    blue, red, cone = shown[0].lines
    assert [line.get_color() for line in (blue, red, cone)] == [BLUE, RED, GREEN]
    np.testing.assert_allclose(np.abs(blue.get_xdata()), np.abs(free[:, 0, 2]), atol=1e-9)
    np.testing.assert_allclose(blue.get_ydata(), 3.0)
    np.testing.assert_allclose(red.get_ydata(), 1.5)
    x, z = cone.get_xdata(), cone.get_ydata()
    np.testing.assert_allclose(np.abs(x), 0.6 * z)


def test_arrows_and_cones_of_the_strip() -> None:
    _, (axes,) = panels(1, 1)
    points = np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])
    normals = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    angle = np.arctan(0.5)
    for limited in (False, True):
        made = arrows(np.array([0.2, 0.0, 0.0]))._replace(limited=np.array([limited, False]))
        draw_forces(axes, made, points, normals, (angle, angle), View.from_above())
    (cone, _) = axes.patches  # contact 2 has neither force nor cone
    x, y = cone.get_path().vertices.T
    depth = 0.03 * np.cos(angle)
    assert (x.min(), x.max()) == pytest.approx((-0.1, -0.1 + depth))
    assert y.max() == pytest.approx(0.5 * depth, rel=0.02)
    push, weight, resultant, tight, *_ = axes.texts
    assert (*push.xyann, *push.xy) == pytest.approx((-0.1, 0.0, 0.1, 0.0))
    assert (*weight.xyann, *weight.xy) == pytest.approx((0.0, 0.1, 0.0, -0.2))
    assert (*resultant.xyann, *resultant.xy) == pytest.approx((0.0, 0.0, 0.0, 0.3))
    colors = [text.arrowprops["color"] for text in (push, weight, resultant, tight)]
    assert colors == ["#0D9933", "#141419", "#D91A1F", "#FA6B00"]
