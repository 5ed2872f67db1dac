"""The pictures of planned forces: what they show is what was planned."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from wbc.recording.figures import COLORS, FORBIDDEN, WARNING, panels
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
    found, push, weight, resultant, _, tight, *_ = axes.texts
    assert (*found.xyann, *found.xy) == pytest.approx((-0.1, 0.0, 0.08, 0.0))  # 0.9 of the plan
    assert (*push.xyann, *push.xy) == pytest.approx((-0.1, 0.0, 0.1, 0.0))
    assert (*weight.xyann, *weight.xy) == pytest.approx((0.0, 0.1, 0.0, -0.2))
    assert (*resultant.xyann, *resultant.xy) == pytest.approx((0.0, 0.0, 0.0, 0.3))
    colors = [text.arrowprops["color"] for text in (found, push, weight, resultant, tight)]
    assert colors == ["#9926BF", "#0D9933", "#141419", "#D91A1F", "#FA6B00"]
