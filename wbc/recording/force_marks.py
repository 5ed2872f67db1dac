"""Contact forces in the picture strip, as on the page (Figure 3 of the chapter)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from matplotlib.axes import Axes

from wbc.arrays import Array, BoolArray
from wbc.recording.silhouette import View, convex_hull

_FORCE, _LIMITED, _CONE = "#0D9933", "#FA6B00", "#FFDE00"
_MEASURED = "#9926BF"
_WEIGHT, _RESULTANT = "#141419", "#D91A1F"
_SLANT = 0.03  # of a cone, [m]
_SHORTEST = 5e-4  # arrow that is drawn, [m]
_AROUND = 24


class Arrows(Protocol):
    """Forces as lengths in the picture, see `wbc.view.scene.ForceArrows`."""

    @property
    def contact(self) -> Array: ...
    @property
    def measured(self) -> Array: ...
    @property
    def limited(self) -> BoolArray: ...
    @property
    def com(self) -> Array: ...
    @property
    def weight(self) -> Array: ...
    @property
    def resultant(self) -> Array: ...
    @property
    def origin(self) -> Array: ...


def draw_forces(
    axes: Axes, arrows: Arrows, points: Array, normals: Array, angles: tuple[float, ...], view: View
) -> None:
    """Cones and arrows of the contacts, weight and resultant; moments are left out: all is small.

    Args:
        points, normals: (N, 3) contact points and outward normals.
        angles: (N,) half angles of the friction cones.
    """
    lengths = np.linalg.norm((arrows.contact, arrows.measured), axis=2)
    drawn = (lengths > _SHORTEST).any(axis=0)
    for i in np.flatnonzero(drawn):
        outline = view.flat(_cone(points[i], normals[i], angles[i]))
        axes.fill(*convex_hull(outline).T, color=_CONE, alpha=0.35, linewidth=0)
    for i in np.flatnonzero(drawn):
        color = _LIMITED if arrows.limited[i] else _FORCE
        _arrow(axes, points[i], arrows.measured[i], _MEASURED, view, 1.8)
        _arrow(axes, points[i], arrows.contact[i], color, view)
    _arrow(axes, arrows.com, arrows.weight[:3], _WEIGHT, view)
    _arrow(axes, arrows.origin, arrows.resultant[:3], _RESULTANT, view)


def _cone(tip: Array, normal: Array, angle: float) -> Array:
    """(k, 3) points of a cone that opens against the outward normal."""
    side = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    side /= np.linalg.norm(side)
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)[:, None]
    rim = np.cos(turn) * side + np.sin(turn) * np.cross(normal, side)
    return np.vstack((tip, tip + _SLANT * (np.sin(angle) * rim - np.cos(angle) * normal)))


def _arrow(
    axes: Axes, start: Array, along: Array, color: str, view: View, width: float = 0.9
) -> None:
    if not np.isfinite(start).all() or not np.linalg.norm(along) > _SHORTEST:
        return
    foot, head = view.flat(np.stack((start, start + along)))
    axes.annotate(
        "", xy=(float(head[0]), float(head[1])), xytext=(float(foot[0]), float(foot[1])),
        arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": width, "shrinkA": 0,
                    "shrinkB": 0, "mutation_scale": 4}, zorder=6,
    )  # fmt: skip
