"""A hand in many postures: the ranges of its synergies (Figure 22), and a contact sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wbc.arrays import Array
from wbc.recording.figures import GREY, WARNING
from wbc.recording.raycast import Picture, half_extent
from wbc.recording.silhouette import View
from wbc.recording.strip import Shape
from wbc.recording.synergy_plots import FINGER_COLORS

_BLOCKS = 3  # synergies side by side
_MARGIN = 0.04  # of a picture's larger side, on each side
_PAGE, _DPI = 11.4, 200  # width of the sheet [inch], and its pixels per inch
_HEAD, _LINE = 0.27, 0.077  # heights of a name and of a line of small print, [inch]
_WORDS = ("minimum", "zero offset", "maximum")


@final
@dataclass(frozen=True, eq=False)
class HandLook:
    """What a hand looks like; its palm's frame is x distal, y radial or ulnar, z dorsal.

    Attributes:
        shapes: solids on the world or on bodies.
        bodies: row of each body's pose in a posture's poses; row 0 is the world's.
        fingers: number of the finger, from 0, of every body that is part of one.
        finger_names: of the fingers.
        thumb_side: +1 where the thumb is on the palm's +y side, as on a right hand, else -1.
    """

    shapes: tuple[Shape, ...]
    bodies: Mapping[str, int]
    fingers: Mapping[str, int]
    finger_names: tuple[str, ...]
    thumb_side: float

    def front(self) -> View:
        """From where the palm faces."""
        return _view((0.0, 0.0, -1.0))

    def side(self) -> View:
        """From the thumb's side."""
        return _view((0.0, self.thumb_side, 0.0))

    def aslant(self) -> View:
        """From the palm's and the thumb's side and a little from below: grips are open to it."""
        return _view((-0.25, 0.75 * self.thumb_side, -0.6))

    def frame(self, poses: Array, view: View) -> tuple[Array, Array]:
        """Corners (2,) around the fingers in all postures and the palm's origin, [m].

        Args:
            poses: (m, 1 + n_full, 4, 4), see `wbc.robot.hand.Hand.poses`.
        """
        points = [np.zeros(2)]
        for shape in self.shapes:
            if shape.body in self.fingers and shape.kind != "line":
                for posture in poses:
                    points += self._covered(shape, posture, view)
        low, high = np.min(points, axis=0), np.max(points, axis=0)
        margin = max(_MARGIN * float(np.max(high - low)), 1e-3)
        return low - margin, high + margin

    def _covered(self, shape: Shape, posture: Array, view: View) -> tuple[Array, Array]:
        """Corners (2,) of a box in the picture that holds a shape."""
        pose = self._pose(shape, posture)
        if shape.vertices is not None:
            seen = view.flat(shape.vertices @ pose[:3, :3].T + pose[:3, 3])
            return seen.min(axis=0), seen.max(axis=0)
        half = half_extent(shape.kind, shape.size)
        reach = np.abs(np.stack((view.right, view.up)) @ pose[:3, :3]) @ half
        middle = view.flat(pose[:3, 3])
        return middle - reach, middle + reach

    def _pose(self, shape: Shape, posture: Array) -> Array:
        pose: Array = posture[0 if shape.body is None else self.bodies[shape.body]]
        return pose @ shape.placement

    def image(self, posture: Array, view: View, corners: tuple[Array, Array], width: int) -> Array:
        """(rows, columns, 3) in 0..1 of the hand at the poses of one posture.

        Args:
            corners: (2,) low and high, in the picture, [m].
            width: [pixel].
        """
        picture = Picture(view, *corners, width)
        for shape in self.shapes:
            pose = self._pose(shape, posture)
            rgb = self._color(shape)
            if shape.kind == "mesh":
                assert shape.vertices is not None and shape.triangles is not None
                picture.mesh(shape.vertices, shape.triangles, pose, rgb)
            elif shape.kind != "line":
                picture.solid(shape.kind, shape.size, pose, rgb)
        return picture.image()

    def _color(self, shape: Shape) -> tuple[float, ...]:
        """Fingers are told apart by colour; joints stay dark, and pads are pale."""
        rgb = np.array(shape.rgba[:3])
        finger = self.fingers.get(shape.body) if shape.body is not None else None
        if finger is None or rgb.mean() < 0.4:
            return tuple(rgb)
        own = np.array(to_rgb(FINGER_COLORS[finger % len(FINGER_COLORS)]))
        if np.ptp(rgb) > 0.15:
            return tuple(0.62 + 0.38 * own)
        return tuple(0.35 * rgb + 0.65 * own)

    def legend(self) -> list[Patch]:
        """Which colour is which finger."""
        colors = [FINGER_COLORS[k % len(FINGER_COLORS)] for k in range(len(self.finger_names))]
        return [Patch(color=c, label=n) for c, n in zip(colors, self.finger_names, strict=True)]


def _view(towards: Sequence[float]) -> View:
    """From `towards` in the palm's axes, fingers up."""
    eye = np.array(towards) / np.linalg.norm(towards)
    right = np.cross((1.0, 0.0, 0.0), eye)
    right /= np.linalg.norm(right)
    return View(right, np.cross(eye, right), eye)


def synergy_ranges(look: HandLook, weights: Array, poses: Array) -> Figure:
    """Figure 22: each synergy's minimum, the zero offset and its maximum; front above side.

    Args:
        weights: (k, 3) of the synergy alone, [deg].
        poses: (k, 3, 1 + n_full, 4, 4), see `wbc.robot.hand.Hand.poses`.
    """
    count = len(weights)
    blocks = min(count, _BLOCKS)
    bands = -(-count // blocks)
    views = (look.front(), look.side())
    flat = poses.reshape(-1, *poses.shape[2:])
    corners = [look.frame(flat, view) for view in views]
    sizes = [high - low for low, high in corners]
    width = max(float(size[0]) for size in sizes)
    # one scale for all: the narrower view is drawn as wide as the wider one
    for k, (low, high) in enumerate(corners):
        spare = np.array((0.5 * (width - float(sizes[k][0])), 0.0))
        corners[k] = (low - spare, high + spare)
    ratios = [float(size[1]) / width for size in sizes]
    inch = 1.55
    height = bands * (inch * sum(ratios) + 0.65)
    figure = Figure(figsize=(3 * blocks * inch + 0.3, height), dpi=150)
    FigureCanvasAgg(figure)
    outer = figure.add_gridspec(bands, blocks, left=0.01, right=0.99, bottom=0.01,
                                top=1.0 - 0.52 / height, wspace=0.06, hspace=0.2)  # fmt: skip
    for s in range(count):
        place = outer[s // blocks, s % blocks].get_position(figure)
        figure.text(0.5 * (place.x0 + place.x1), place.y1 + 0.36 / height, f"Synergy {s + 1}",
                    fontsize=10.0, fontweight="bold", ha="center")  # fmt: skip
        grid = outer[s // blocks, s % blocks].subgridspec(
            2, 3, height_ratios=ratios, wspace=0.02, hspace=0.03
        )
        for row, view in enumerate(views):
            for column in range(3):
                axes = figure.add_subplot(grid[row, column])
                _show(axes, look, poses[s, column], view, corners[row], 300)
                if row == 0:
                    value = weights[s, column] + 0.0
                    axes.set_title(
                        f"{_WORDS[column]}\n$\\alpha_{{{s + 1}}}$ = {value:.1f}°".replace("-", "−"),
                        fontsize=8.0, pad=3.0, loc="center", fontweight="normal",
                    )  # fmt: skip
    return figure


def contact_sheet(
    look: HandLook,
    names: Sequence[str],
    notes: Sequence[Sequence[str]],
    poses: Array,
    *,
    columns: int = 9,
) -> Figure:
    """All postures by name, row by row, on a page of A4 laid flat.

    Args:
        names: (m,) a second line after a line break is printed smaller.
        notes: (m,) of each posture lines in small print; one with a line is marked by a triangle.
        poses: (m, 1 + n_full, 4, 4), see `wbc.robot.hand.Hand.poses`.
    """
    view, inch = look.aslant(), _PAGE / columns
    low, high = look.frame(poses, view)
    rows = [slice(k, k + columns) for k in range(0, len(names), columns)]  # as tall as each needs
    tops = [look.frame(poses[row], view)[1][1] for row in rows]
    scale = inch / float(high[0] - low[0])  # [inch/m]
    heads = [_HEAD + _LINE * max(map(len, notes[row])) for row in rows]
    tall = [scale * float(top - low[1]) for top in tops]
    size = np.array((_PAGE + 0.1, sum(heads) + sum(tall) + 0.4))
    figure = Figure(figsize=(float(size[0]), float(size[1])), dpi=_DPI)
    FigureCanvasAgg(figure)
    bottom = float(size[1])
    for row, head, height, top in zip(rows, heads, tall, tops, strict=True):
        bottom -= head + height
        corners = (low, np.array((high[0], top)))
        for k in range(row.start, min(row.stop, len(names))):
            left = 0.05 + (k - row.start) * inch
            box = np.array((left, bottom, inch, height)) / np.tile(size, 2)
            axes = figure.add_axes((box[0], box[1], box[2], box[3]))
            _show(axes, look, poses[k], view, corners, round(inch * _DPI))
            _caption(figure, (left + 0.05, bottom + height + head), names[k], notes[k])
    figure.legend(handles=look.legend(), loc="lower left", ncols=max(len(look.finger_names), 1),
                  bbox_to_anchor=(0.01, 0.0))  # fmt: skip
    if any(notes):
        figure.text(0.99, 0.18 / size[1],
                    "▼ clipped to the hand's ranges: joint and how far it was beyond",
                    fontsize=8.0, color=WARNING, ha="right")  # fmt: skip
    return figure


def _caption(figure: Figure, at: tuple[float, float], name: str, notes: Sequence[str]) -> None:
    """A posture's name and small print, below and to the right of `at`, [inch]."""
    size = figure.get_size_inches()
    x, y = at
    head, _, second = name.partition("\n")
    figure.text(x / size[0], (y - 0.2) / size[1], head, fontsize=9.0, fontweight="bold")
    aside = x + 0.1 + 0.085 * len(head)
    if notes:
        figure.text(aside / size[0], (y - 0.19) / size[1], "▼", fontsize=6.5, color=WARNING)
        aside += 0.13
    figure.text(aside / size[0], (y - 0.195) / size[1], second, fontsize=6.5, color=GREY)
    figure.text(x / size[0], (y - 0.24) / size[1], "\n".join(notes), fontsize=4.8, color=WARNING,
                va="top", linespacing=1.05)  # fmt: skip


def _show(
    axes: Any, look: HandLook, posture: Array, view: View, corners: tuple[Array, Array], width: int
) -> None:
    low, high = corners
    axes.imshow(
        look.image(posture, view, corners, width), extent=(low[0], high[0], low[1], high[1]),
        interpolation="antialiased",
    )  # fmt: skip
    axes.set_axis_off()
